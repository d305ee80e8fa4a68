"""Change random lines of the package, one at a time, and run the tests they concern.

Which tests execute a line is in a map, which is made once for each state of src and
test. Nothing happens in the working tree: clones of the last commit are changed.
"""

# Of mutmut and cosmic-ray, no version for Python 3.8 chooses tests by line or knows
# rostests, so we have our own.

import argparse
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections import defaultdict
from functools import partial
from pathlib import Path

from coverage import CoverageData
from coverage.parser import PythonParser

from mutants import draw
from processes import end_processes, marked_environment

ROOT = Path(__file__).resolve().parents[1]
MAPS = ROOT / ".ws" / "maps"
SOURCE = "src/g1_description/"
CONTEXT = "G1_DESCRIPTION_TEST"
"""Names the test to coverage.py in the processes of the test."""
SETTINGS = """[run]
parallel = true
sigterm = true
relative_files = true
data_file = {data}
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
        self.mark = f"G1_DESCRIPTION_MUTANT={uuid.uuid4().hex}"  # tests set their own
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
        environment = marked_environment(self.mark)
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
                end_processes(self.mark)
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
        self.file = MAPS / f"{'_'.join(name[:12] for name in state)}.coverage"
        self.times = self.file.with_suffix(".times")
        self.seconds = read_times(self.times) if self.times.exists() else {}
        self._data = CoverageData(str(self.file))
        self._data.read()
        self._lines = {}

    def has(self, kind):
        """Tell whether tests of a folder were recorded."""
        return any(name.startswith(kind) for name in self.seconds)

    def record(self, clone, run):
        """Add the lines and the times of tests, which a function runs.

        Args:
            clone: Where they run.
            run: Given the variables with which coverage.py starts, and the file that
                takes the times: in each line the seconds and the name of a test.
        """
        MAPS.mkdir(exist_ok=True)
        (packages,) = clone.folder.glob(".venv/lib/python3*/site-packages")
        start = packages / "coverage_start.pth"
        with tempfile.TemporaryDirectory(prefix="g1_mutate_map_") as folder:
            settings, times = Path(folder, "settings"), Path(folder, "times")
            data, source = f"{folder}/data", clone.folder / SOURCE
            text = SETTINGS.format(data=data, source=source, context=CONTEXT)
            settings.write_text(text)
            start.write_text(f"{START}\n{clone.folder / 'tools'}\n")
            run({"COVERAGE_PROCESS_START": str(settings)}, times)
            start.unlink()
            combine = ["-m", "coverage", "combine", "-q", f"--rcfile={settings}"]
            clone.run([".venv/bin/python", *combine, folder])
            found = CoverageData(data)
            found.read()
            self._data.update(found)
            self._data.write()
            with self.times.open("a") as file:
                file.write(times.read_text())
        self.seconds = read_times(self.times)

    def record_all(self, clone, jobs, with_rostests):
        """Add all tests that are missing, rostests one after the other."""

        def run_pytest(variables, times):
            words = ["-p", "contexts", "test"]
            clone.pytest(words, COVERAGE_TIMES=str(times), **variables)

        def run_rostest(test, variables, times):
            begin, name = time.monotonic(), test.split("/")[1]
            code = clone.rostest(name, timeout=900.0, **{CONTEXT: test}, **variables)
            seconds = time.monotonic() - begin if code == 0 else float("inf")
            print(f"{test}: {seconds:.0f} s", flush=True)
            times.write_text(f"{seconds:.1f} {test}\n")

        if not self.has("test/"):
            self.record(clone, run_pytest)
        files = (
            sorted(clone.folder.glob("test/rostest/*.test")) if with_rostests else []
        )
        for test in (f"rostest/{file.stem}" for file in files):
            if test not in self.seconds:
                self.record(clone, partial(run_rostest, test))

    def lines(self, name):
        """Give the tests that execute the lines of a file."""
        if name not in self._lines:
            self._lines[name] = self._data.contexts_by_lineno(name)
        return self._lines[name]

    def tests_of(self, name, mutant):
        """Give the tests that a mutant concerns, the cheapest of each group first.

        Those that execute the line, then those of the package's folder if an import
        executes it, then those that execute other lines of the file: an import, a cache
        or a fixture runs a line for the first test alone. None if nothing executes it.
        """
        lines = self.lines(name)
        executing = lines.get(mutant.line) or lines.get(mutant.statement) or []
        if not executing:
            return []
        folder = f"test/{name[len(SOURCE) :].split('/')[0]}/"
        groups = [executing, [], set().union(*lines.values())]
        if not mutant.is_inside or "" in executing:
            groups[1] = [test for test in self.seconds if test.startswith(folder)]
        if not mutant.is_inside:
            groups[0] = []
        order, found = self.seconds.get, {}
        for group in groups:
            known = sorted({*group} & {*self.seconds})
            found.update(dict.fromkeys(sorted(known, key=order)))
        return [*found]

    def tell(self):
        """Print the coverage of each package."""
        counts = defaultdict(lambda: [0, 0])
        for name in git("ls-files", f"{SOURCE}*.py").split():
            parser = PythonParser(text=git("show", f"HEAD:{name}"))
            parser.parse_source()
            words, lines = name[len(SOURCE) :].split("/"), self.lines(name)
            executed = {parser.first_line(line) for line in lines}
            count = counts[words[0] if len(words) > 1 else "(top)"]
            count[0] += len(parser.statements)
            count[1] += len(parser.statements & executed)
        counts["all"] = [sum(column) for column in zip(*counts.values())]
        for name, (lines, executed) in sorted(counts.items()):
            print(f"{name:12}{lines:7} lines {100.0 * executed / max(lines, 1):6.1f} %")
        print(self.title())

    def title(self):
        """Say which tests are known."""
        return "with rostests" if self.has("rostest/") else "without rostests"


def read_times(file):
    """Read the seconds of test functions, whose cases have lines of their own."""
    seconds = defaultdict(float)
    for line in file.read_text().splitlines():
        time_of_case, name = line.split(" ", 1)
        seconds[name] += float(time_of_case)
    return dict(seconds)


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
            most = 60.0 + 3.0 * sum(known.seconds[test] for test in taken)
            code = clone.pytest(["-x", *taken], timeout=most, **variables)
        for test in slow:
            if code == 0:
                ran.append(test)
                most = 60.0 + 3.0 * known.seconds[test]
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

    threads = [threading.Thread(target=work, args=[c], daemon=True) for c in clones]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return len(survivors)


def main():
    """Draw, run, and report."""
    parser = argparse.ArgumentParser(prog="tools/mutate", description=__doc__)
    for name, default in (("sample", 20), ("seed", 1), ("jobs", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    for name in ("map", "rostests", "coverage"):
        parser.add_argument(f"--{name}", action="store_true")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--clones", type=Path)
    given = parser.parse_args()
    # Also where SIGINT is ignored, as under nohup.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    known, clones = Map(), []
    if given.coverage and known.has("test/"):
        return known.tell()
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="g1_mutate_") as folder:
        place = (given.clones or Path(folder)).resolve()
        try:
            for number in range(given.jobs):
                clones.append(Clone(place / f"clone_{number}"))
            known.record_all(clones[0], given.jobs, given.rostests)
            if given.coverage or given.map:
                return known.tell()
            sample = draw(clones[0].folder, given.sample, given.seed)
            print(f"seed {given.seed}, at most {given.seconds:.0f} s for a mutant")
            print(known.title(), flush=True)
            count = run(clones, known, sample, given.seconds)
        except KeyboardInterrupt:
            sys.exit("tools/mutate: interrupted")
        finally:
            for clone in clones:
                end_processes(clone.mark)
    seconds = time.monotonic() - begin
    print(f"{count} of {len(sample)} survived ({seconds:.0f} s)")


if __name__ == "__main__":
    main()
