"""Run catkin's test targets, and the checks of style; print what came of each part."""

import fnmatch
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from processes import (
    end_processes,
    marked_environment,
    marked_processes,
    new_mark,
    wait_for_end,
)

ROOT = Path(__file__).resolve().parents[1]
PLACE = Path(os.environ.get("G1_DESCRIPTION_PLACE", ROOT))
"""Where the environment and the workspace are; another Python has its own."""
BIN = PLACE / ".venv" / "bin"
BUILD = PLACE / ".ws" / "build"
RESULTS = BUILD / "test_results" / "g1_description"
PACKAGE = ROOT / ".ws" / "src" / "g1_description"
LINTED = (PACKAGE, *sorted(PACKAGE.glob("interfaces/*")))
"""catkin_lint looks for no package inside a package."""
STYLE = {
    "ruff": [BIN / "ruff", "check"],
    "format": [BIN / "ruff", "format", "--check"],
    "mypy": [BIN / "mypy"],
    "catkin_lint": ["catkin_lint", "-W2", "--strict", "--offline", *LINTED],
}
ROSTESTS = {f"rostest/{f.stem}": f for f in (ROOT / "test/rostest").glob("*.test")}
FOLDERS = sorted({f.parent.name for f in (ROOT / "test").glob("*/test_*.py")})
PYTESTS = [name for name in FOLDERS if name != "rostest"]
QUICK = (*STYLE, *PYTESTS, "rostest/display")
AT_A_TIME = 4
"""Targets that run beside each other on two cores: rostests wait much of the time."""
LIMIT = 75 * 60.0
"""[s] for all parts together."""
SLOWEST = 10
"""Cases that are named for the time they take."""
OUTPUT = BUILD / "run_tests.log"


@dataclass
class Outcome:
    """Cases of a part: a count, and a text for each that did not pass."""

    passed: int = 0
    failed: list = field(default_factory=list)
    skipped: list = field(default_factory=list)
    times: list = field(default_factory=list)  # [s] and name of each case

    def __str__(self):
        """Count in words."""
        return (
            f"{self.passed} passed, {len(self.failed)} failed, "
            f"{len(self.skipped)} skipped"
        )

    def add(self, other):
        """Count the cases of another outcome in."""
        self.passed += other.passed
        self.failed += other.failed
        self.skipped += other.skipped
        self.times += other.times


def read_results(file):
    """Count the cases of a result file in JUnit's format."""
    outcome = Outcome()
    try:
        cases = ElementTree.parse(file).iter("testcase")
    except (OSError, ElementTree.ParseError) as error:
        return Outcome(failed=[f"{file.name} cannot be read: {error}"])
    for case in cases:
        name = f"{case.get('classname')}.{case.get('name')}"
        outcome.times.append((float(case.get("time") or 0.0), name))
        faults = [*case.iter("failure"), *case.iter("error")]
        skip = case.find("skipped")
        if faults:
            text = "\n".join(fault.text or fault.get("message", "") for fault in faults)
            outcome.failed.append(f"{name}\n{text}")
        elif skip is not None:
            outcome.skipped.append(f"{name}: {skip.get('message')}")
        else:
            outcome.passed += 1
    return outcome


def read_rostest(name):
    """Count the cases of a rostest: those of its nodes, of which each has a file."""
    outcome = Outcome()
    tests = ElementTree.parse(ROSTESTS[name]).iter("test")
    for test in tests:
        outcome.add(read_results(RESULTS / f"rosunit-{test.get('test-name')}.xml"))
    # rostest's own file tells of nodes that gave no results at all.
    own = RESULTS / f"rostest-test_rostest_{ROSTESTS[name].stem}.xml"
    if not outcome.failed:
        outcome.failed += read_results(own).failed
    return outcome


def target_of(name):
    """Give the make target of a part, by the part's name."""
    if name in ROSTESTS:
        return f"run_tests_g1_description_rostest_test_rostest_{ROSTESTS[name].name}"
    kind = "roslaunch-check_launch" if name == "launch" else f"pytest_{name}"
    return f"run_tests_g1_description_{kind}"


def part_of(results):
    """Give a part's name and its outcome, by its result file."""
    kind, _, name = Path(results).stem.partition("-")
    if kind == "rostest":
        name = f"rostest/{name[len('test_rostest_') :]}"
        return name, read_rostest(name)
    name = "launch" if kind == "roslaunch" else name
    return name, read_results(Path(results))


class Run:
    """One run of the parts that were asked for."""

    def __init__(self, folder, is_quick):
        """Take the environment: nothing of it is the user's.

        Args:
            folder: Where ROS's own files go.
            is_quick: Whether to leave out the tests that are marked as slow.
        """
        self.mark, self.total, self.seen = new_mark(), Outcome(), set()
        self.begin = time.monotonic()
        self._lock = threading.Lock()
        environment = marked_environment(self.mark)
        for name in ("DISPLAY", "ROS_IP", "ROS_MASTER_URI"):
            environment.pop(name, None)
        environment.update(ROS_HOSTNAME="localhost", ROS_HOME=folder)
        environment["ROS_LOG_DIR"] = f"{folder}/log"
        if is_quick:
            environment["PYTEST_ADDOPTS"] = "-m 'not slow'"
        self.environment = environment

    def start(self, command, **options):
        """Start a program in a session of its own."""
        return subprocess.Popen(
            [str(word) for word in command],
            cwd=ROOT,
            env=self.environment,
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            **options,
        )

    def tell(self, name, outcome):
        """Print a part's line, and all that is known of its failures."""
        with self._lock:
            self.seen.add(name)
            seconds = sum(time for time, _ in outcome.times)
            outcome.times = [(time, f"{name}: {case}") for time, case in outcome.times]
            self.total.add(outcome)
            word = "FAILED" if outcome.failed else "ok"
            print(f"{word:6} {name:26} {outcome} ({seconds:.1f} s)")
            print(*outcome.failed, sep="\n", end="\n" if outcome.failed else "")
            sys.stdout.flush()

    def check_style(self, names):
        """Run the linters and the type check, one after the other."""
        for name in names:
            begin = time.monotonic()
            process = self.start(STYLE[name])
            text, _ = process.communicate()
            outcome = Outcome(passed=1) if process.returncode == 0 else Outcome()
            if process.returncode != 0:
                outcome.failed.append(text)
            outcome.times = [(time.monotonic() - begin, name)]
            self.tell(name, outcome)

    def make(self, targets):
        """Let catkin run targets, and tell of each part when its results are there."""
        command = ["catkin_make", "-C", BUILD.parent, *targets, f"-j{AT_A_TIME}"]
        process = self.start(command)
        with open(OUTPUT, "w") as log:
            for line in process.stdout:
                log.write(line)
                results = re.search(r'run_tests.py: verify result "(.+)"', line)
                if results:
                    self.tell(*part_of(results.group(1)))
        if process.wait() != 0:
            end = "".join(OUTPUT.read_text(errors="replace").splitlines(True)[-20:])
            self.total.failed.append(
                f"catkin_make ended with {process.returncode}\n{end}"
            )

    def run(self, names):
        """Run parts."""
        style = [name for name in names if name in STYLE]
        tests = [name for name in names if name not in STYLE]
        thread = threading.Thread(target=self.check_style, args=[style], daemon=True)
        thread.start()
        if tests:
            is_all = len(tests) == len(available()) - len(STYLE)
            self.make(["run_tests"] if is_all else [target_of(name) for name in tests])
        thread.join()
        missing = [name for name in names if name not in self.seen]
        self.total.failed += [f"{name} gave no results" for name in missing]
        wait_for_end(self.mark, 5.0)
        left = marked_processes(self.mark).values()
        self.total.failed += [f"left behind: {line}" for line in left]

    def tell_all(self):
        """Print what took longest, what was skipped, and the count."""
        for seconds, name in sorted(self.total.times, reverse=True)[:SLOWEST]:
            print(f"{seconds:6.1f} s {name}")
        lines = [re.sub(r"\[[^]]*\]:", ":", line) for line in self.total.skipped]
        for line, count in Counter(lines).items():
            print(f"skipped {line}{f' ({count} cases)' if count > 1 else ''}")
        minutes, seconds = divmod(round(time.monotonic() - self.begin), 60)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = used.ru_utime + used.ru_stime
        print(
            f"{self.total} ({minutes}:{seconds:02} min, {processor:.0f} s of processor)"
        )
        return 1 if self.total.failed else 0


def available():
    """List all parts."""
    tests = ["launch", *PYTESTS, *sorted(ROSTESTS)]
    if PLACE == ROOT:
        return [*STYLE, *tests]
    has_nodes = (PLACE / "ros" / "tf2_py").exists()
    return tests if has_nodes else PYTESTS


def chosen(patterns):
    """Choose the parts that the user named; all if none is.

    Raises:
        SystemExit: If there is no such part.
    """
    names = available()
    if not patterns:
        return names
    found = []
    for pattern in patterns:
        fits = [n for n in names if fnmatch.fnmatch(n, pattern)]
        fits += [n for n in names if n.startswith(f"{pattern}/")]
        fits = fits or [n for n in names if fnmatch.fnmatch(n, f"rostest/{pattern}")]
        if not fits:
            sys.exit(f"tools/test: no part '{pattern}'; there are {' '.join(names)}")
        found += fits
    return [name for name in names if name in found]


def main():
    """Run what was asked for."""
    is_quick = sys.argv[1:] == ["quick"]
    names = chosen(QUICK if is_quick else sys.argv[1:])
    # Also where SIGINT is ignored, as under nohup: so the programs here do not.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="g1_test_") as folder:
        run = Run(folder, is_quick)
        limit = threading.Timer(LIMIT, end_processes, [run.mark])
        limit.daemon = True
        limit.start()
        try:
            run.run(names)
        except KeyboardInterrupt:
            sys.exit("tools/test: interrupted")
        finally:
            end_processes(run.mark)
    sys.exit(run.tell_all())


if __name__ == "__main__":
    main()
