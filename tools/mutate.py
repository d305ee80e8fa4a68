"""Change random lines of the package, one at a time, and run the tests they concern.

Which tests execute a line is in a map, which is made once for each state of src and
test. Nothing happens in the working tree: clones of the last commit are changed.
"""

# Of mutmut and cosmic-ray, no version for Python 3.8 chooses tests by line or knows
# rostests, so we have our own.

import argparse
import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path

from mutants import draw
from processes import end_processes, marked_environment, new_mark

ROOT = Path(__file__).resolve().parents[1]
MAPS = ROOT / ".ws" / "maps"
SOURCE = "src/g1_description/"
CONTEXT = "G1_DESCRIPTION_TEST"
"""Names the test to coverage.py in the processes of the test."""
SETTINGS = """[run]
parallel = true
sigterm = true
relative_files = true
data_file = {folder}/data
disable_warnings = no-data-collected
source = {source}
context = ${{{context}-}}
[paths]
source =
    src/g1_description
    */src/g1_description
"""
START = (
    "import os; 'COVERAGE_PROCESS_START' in os.environ and "
    "__import__('coverage').process_startup()"
)
"""What each Python of the clone begins with while the map is made."""
IN_WORKSPACE = '. tools/common.sh; source_workspace; exec "$@"'
ROSTESTS = 3
"""Most rostests for one mutant."""


def git(*words):
    """Give what git prints of the repository."""
    command = ["git", "-C", str(ROOT), *words]
    return subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout


class Clone:
    """A clone of the last commit, set up to run tests."""

    def __init__(self, folder):
        """Make it, or bring the one that is there to the last commit."""
        self.folder = folder
        commit = git("rev-parse", "HEAD").strip()
        if not folder.exists():
            git("clone", "--quiet", str(ROOT), str(folder))
        words = (["fetch", "--quiet"], ["checkout", "--quiet", "--force", commit])
        for word in words:
            subprocess.run(["git", *word], cwd=folder, check=True)
        subprocess.run(["tools/setup", "--tests"], cwd=folder, check=True)

    def run(self, command, timeout=None, **variables):
        """Run a command in the workspace; whatever it starts ends with it.

        Returns:
            The exit code, and None if it did not end in time [s].
        """
        mark = new_mark()
        environment = marked_environment(mark)
        environment.update(variables, ROS_HOSTNAME="localhost")
        with tempfile.TemporaryDirectory(prefix="g1_mutate_ros_") as home:
            environment.update(ROS_HOME=home, ROS_LOG_DIR=f"{home}/log")
            process = subprocess.Popen(
                ["bash", "-c", IN_WORKSPACE, "tools/mutate", *command],
                cwd=self.folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            try:
                return process.wait(timeout)
            except subprocess.TimeoutExpired:
                return None
            finally:
                end_processes(mark)
                process.wait()

    def pytest(self, words, **options):
        """Run pytest."""
        command = [".venv/bin/python", "-m", "pytest", "-q", "-p", "no:cacheprovider"]
        return self.run([*command, *words], **options)

    def rostest(self, name, **options):
        """Run a rostest by the name of its file."""
        return self.run(["rostest", "g1_description", f"{name}.test"], **options)


class Map:
    """Which tests execute which lines, and how long they take."""

    def __init__(self):
        """Read what is known of the last commit's state of src and test."""
        state = git("rev-parse", "HEAD:src", "HEAD:test").split()
        self.file = MAPS / f"{'_'.join(name[:12] for name in state)}.json"
        self.seconds, self.lines, self.statements = {}, {}, {}
        if self.file.exists():
            known = json.loads(self.file.read_text())
            self.seconds, self.lines = known["seconds"], known["lines"]
            self.statements = known["statements"]

    def has(self, kind):
        """Tell whether tests of a folder were recorded."""
        return any(name.startswith(kind) for name in self.seconds)

    def record(self, clone, jobs, with_rostests):
        """Run all tests with coverage.py; rostests one after the other."""
        with tempfile.TemporaryDirectory(prefix="g1_mutate_map_") as folder:
            settings, times = Path(folder, "settings"), Path(folder, "times")
            settings.write_text(
                SETTINGS.format(
                    folder=folder, source=clone.folder / SOURCE, context=CONTEXT
                )
            )
            for place in clone.folder.glob(".venv/lib/python3*/site-packages"):
                text = f"{START}\n{clone.folder / 'tools'}\n"
                (place / "coverage_start.pth").write_text(text)
            variables = {"COVERAGE_PROCESS_START": str(settings)}
            if not self.has("test/"):
                print("running the tests of pytest", flush=True)
                words = ["-p", "contexts", "-n", str(jobs), "test"]
                clone.pytest(words, COVERAGE_TIMES=str(times), **variables)
                for line in times.read_text().splitlines():
                    seconds, name = line.split(" ", 1)
                    self.seconds[name] = self.seconds.get(name, 0.0) + float(seconds)
            names = sorted(f.stem for f in clone.folder.glob("test/rostest/*.test"))
            for name in names if with_rostests else []:
                test = f"rostest/{name}"
                if test in self.seconds:
                    continue
                begin = time.monotonic()
                code = clone.rostest(name, timeout=900, **{CONTEXT: test, **variables})
                took = time.monotonic() - begin
                print(f"{test}: {code} ({took:.0f} s)", flush=True)
                self.seconds[test] = took if code == 0 else float("inf")
            self.read(clone, folder, settings)
        MAPS.mkdir(exist_ok=True)
        known = {"seconds": self.seconds, "lines": self.lines}
        self.file.write_text(json.dumps({**known, "statements": self.statements}))

    def read(self, clone, folder, settings):
        """Add what coverage.py wrote."""
        result = Path(folder, "result.json")
        options = [f"--rcfile={settings}", "-q"]
        python = [".venv/bin/python", "-m", "coverage"]
        clone.run([*python, "combine", *options, folder])
        clone.run([*python, "json", *options, "--show-contexts", "-o", str(result)])
        for name, found in json.loads(result.read_text())["files"].items():
            statements = {*found["executed_lines"], *found["missing_lines"]}
            self.statements[name] = sorted(statements)
            lines = self.lines.setdefault(name, {})
            for line, tests in found["contexts"].items():
                known = lines.setdefault(line, [])
                known += sorted({*tests} - {*known})

    def of_line(self, name, line):
        """Give the tests that execute a line."""
        return {*self.lines.get(name, {}).get(str(line), ())} & {*self.seconds}

    def of_file(self, name):
        """Give the tests that execute any line of a file."""
        return set().union(*(self.of_line(name, n) for n in self.lines.get(name, {})))

    def tests_of(self, name, mutant):
        """Give the tests that a mutant concerns, the cheapest first."""
        if mutant.is_inside:
            tests = self.of_line(name, mutant.line)
            tests = tests or self.of_line(name, mutant.statement)
        else:  # whoever came first has imported it, so all are asked
            folder = f"test/{name[len(SOURCE) :].split('/')[0]}/"
            own = {test for test in self.seconds if test.startswith(folder)}
            tests = own or self.of_file(name)
        return sorted(tests, key=lambda test: (self.seconds[test], test))

    def tell(self):
        """Print the coverage of each package."""
        counts = defaultdict(lambda: [0, 0])
        for name, statements in self.statements.items():
            words = name[len(SOURCE) :].split("/")
            count = counts[words[0] if len(words) > 1 else "."]
            count[0] += len(statements)
            count[1] += sum(str(line) in self.lines[name] for line in statements)
        counts["all"] = [sum(column) for column in zip(*counts.values())]
        for name, (lines, executed) in sorted(counts.items()):
            print(f"{name:12}{lines:7} lines {100.0 * executed / lines:6.1f} %")
        if not self.has("rostest/"):
            print("without rostests")


def within(tests, seconds, limit):
    """Take tests from the begin as long as they fit in a time; at least one."""
    taken, total = [], 0.0
    for test in tests:
        total += seconds[test]
        if (taken and total > limit) or total == float("inf"):
            break
        taken.append(test)
    return taken


def judge(clone, known, name, mutant, limit):
    """Run the tests that a mutant concerns, in a clone.

    Returns:
        The verdict, and in words which tests ran.
    """
    tests = known.tests_of(name, mutant)
    quick = [test for test in tests if test.startswith("test/")]
    taken = within(quick, known.seconds, limit)
    slow = [test for test in tests if test not in quick][:ROSTESTS]
    ran = [f"{len(taken)} of {len(quick)} tests"] if quick else []
    file = clone.folder / name
    data, stat = file.read_bytes(), file.stat()
    file.write_bytes(mutant.apply(data))
    # The compiled file of the original stays the valid one.
    variables = {"PYTHONDONTWRITEBYTECODE": "1"}
    try:
        code = 0
        if taken:
            most = 120.0 + 5.0 * sum(known.seconds[test] for test in taken)
            code = clone.pytest(["-x", *taken], timeout=most, **variables)
        for test in slow:
            if code == 0:
                ran.append(test)
                most = 120.0 + 3.0 * known.seconds[test]
                code = clone.rostest(test.split("/")[1], timeout=most, **variables)
    finally:
        file.write_bytes(data)
        os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    verdict = "timeout" if code is None else "killed" if code else "SURVIVED"
    return verdict, ", ".join(ran) or "no test executes it"


def run(clones, known, sample, limit):
    """Judge mutants, one per clone at a time, and print each; count the survivors."""
    left, lock, survivors = queue.Queue(), threading.Lock(), []
    for one in sample:
        left.put(one)

    def work(clone):
        while True:
            try:
                name, mutant = left.get_nowait()
            except queue.Empty:
                return
            old = (clone.folder / name).read_bytes()
            verdict, ran = judge(clone, known, name, mutant, limit)
            pair = old.splitlines(), mutant.apply(old).splitlines()
            before, after = (text[mutant.line - 1].decode().strip() for text in pair)
            with lock:
                print(f"{verdict:8} {name}:{mutant.line} ({ran})")
                print(f"    - {before}\n    + {after}", flush=True)
                survivors.extend([name] if verdict == "SURVIVED" else [])

    threads = [threading.Thread(target=work, args=[clone]) for clone in clones]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return len(survivors)


def main():
    """Draw, run, and report."""
    parser = argparse.ArgumentParser(prog="tools/mutate", description=__doc__)
    parser.add_argument("--sample", type=int, default=20, metavar="N", help="of lines")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the draw")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="at a time")
    parser.add_argument("--seconds", type=float, default=120.0, help="for one mutant")
    parser.add_argument("--map", action="store_true", help="only make the map")
    parser.add_argument("--rostests", action="store_true", help="of these, too")
    parser.add_argument("--coverage", action="store_true", help="only print it")
    parser.add_argument("--clones", type=Path, help="a folder that keeps the clones")
    given = parser.parse_args()
    begin, known = time.monotonic(), Map()
    if given.coverage and known.seconds:
        known.tell()
        return
    with tempfile.TemporaryDirectory(prefix="g1_mutate_") as folder:
        place = given.clones or Path(folder)
        first = Clone(place / "clone_0")
        missing = given.rostests and not known.has("rostest/")
        if not known.has("test/") or missing:
            known.record(first, given.jobs, given.rostests)
        if given.coverage or given.map:
            known.tell()
            return
        others = [Clone(place / f"clone_{number}") for number in range(1, given.jobs)]
        sample = draw(first.folder, given.sample, given.seed)
        count = run([first, *others], known, sample, given.seconds)
    seconds = time.monotonic() - begin
    print(f"{count} of {len(sample)} survived ({seconds:.0f} s)")


if __name__ == "__main__":
    sys.exit(main())
