"""Run catkin's test targets, and the checks of style; print what came of each part."""

import fcntl
import fnmatch
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
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
LOGS = BUILD / "test_logs"
"""What the parts of the last run printed, and what their nodes logged."""
PACKAGE = ROOT / ".ws" / "src" / "g1_description"
LINTED = (PACKAGE, *sorted(PACKAGE.glob("interfaces/*")))
"""catkin_lint looks for no package inside a package."""
STYLE = {
    "ruff": [BIN / "ruff", "check"],
    "format": [BIN / "ruff", "format", "--check"],
    "mypy": [BIN / "mypy"],
    "catkin_lint": ["catkin_lint", "-W2", "--strict", "--offline", *LINTED],
    "site": [BIN / "mkdocs", "build", "--strict"],
}
ROSTESTS = {f"rostest/{f.stem}": f for f in (ROOT / "test/rostest").glob("*.test")}
FOLDERS = sorted({f.parent.name for f in (ROOT / "test").glob("*/test_*.py")})
PYTESTS = [name for name in FOLDERS if name != "rostest"]
WITHOUT_NODES = [name for name in PYTESTS if name != "install"]
QUICK = (*STYLE, *WITHOUT_NODES, "rostest/display")
AT_A_TIME = 2
"""Parts that run beside each other: more only wait for each other on two cores."""
LIMIT = 75 * 60.0
"""[s] for all parts together."""
FIRST = (
    *(
        "rostest/motion",
        "rostest/examples",
        "rostest/poses",
        "sim",
        "rostest/web",
        "rostest/doctor",
    ),
    *("web", "install", "repository", "rostest/bridge", "rostest/nodes"),
)
"""Parts that begin first, as the end would wait for them."""
NOT_THE_USERS = (
    "DISPLAY",
    "PYTEST_ADDOPTS",
    "PYTHONDONTWRITEBYTECODE",
    "ROS_IP",
    "ROS_MASTER_URI",
)
"""Variables that the tests run without. Nodes compile our modules once, for all."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SLOWEST = 10
"""Cases that are named for the time they take."""


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
            texts = (f"{f.get('message')}\n{f.text or ''}" for f in faults)
            outcome.failed.append("\n".join([name, *texts]))
        elif skip is not None:
            outcome.skipped.append(f"{name}: {skip.get('message')}")
        else:
            outcome.passed += 1
    return outcome


def files_of(name):
    """Give the result files of a part that catkin runs.

    A rostest has one for each of its nodes, and one of its own, which comes last and
    tells of nodes that gave no results at all.
    """
    if name not in ROSTESTS:
        kind = "roslaunch-check_launch" if name == "launch" else f"pytest-{name}"
        return [RESULTS / f"{kind}.xml"]
    try:
        tests = ElementTree.parse(ROSTESTS[name]).iter("test")
    except ElementTree.ParseError:  # which rostest tells
        tests = ()
    files = [RESULTS / f"rosunit-{test.get('test-name')}.xml" for test in tests]
    return [*files, RESULTS / f"rostest-test_rostest_{ROSTESTS[name].stem}.xml"]


def results_of(name):
    """Count the cases of a part that catkin ran."""
    outcome = Outcome()
    *files, last = files_of(name)
    for file in files:
        outcome.add(read_results(file))
    if not files:
        return read_results(last)
    if not outcome.failed:
        outcome.failed += read_results(last).failed
    return outcome


def target_of(name):
    """Give the make target of a part, by the part's name.

    The fast one looks for no change of CMake's files, which the build has just read:
    two parts would write them at the same time.
    """
    kind = "roslaunch-check_launch" if name == "launch" else f"pytest_{name}"
    if name in ROSTESTS:
        kind = f"rostest_test_rostest_{ROSTESTS[name].name}"
    return f"run_tests_g1_description_{kind}/fast"


class Run:
    """One run of the parts that were asked for."""

    def __init__(self, folder, is_quick):
        """Take the environment: nothing of it is the user's.

        Args:
            folder: Where ROS's own files go.
            is_quick: Whether to leave out the tests that are marked as slow.
        """
        self.mark, self.total, self.is_over = new_mark(), Outcome(), False
        self.begin = time.monotonic()
        self._lock = threading.Lock()
        environment = marked_environment(self.mark)
        for name in NOT_THE_USERS:
            environment.pop(name, None)
        environment.update(ROS_HOSTNAME="localhost", ROS_HOME=folder)
        environment["ROS_LOG_DIR"] = str(LOGS / "ros")
        if is_quick:
            environment["PYTEST_ADDOPTS"] = "-m 'not slow'"
        self.environment = environment

    def run_program(self, command, log):
        """Run a program; give its exit code and its processor time in [s]."""
        with log.open("w") as output:
            process = subprocess.Popen(
                [str(word) for word in command],
                cwd=ROOT,
                env=self.environment,
                start_new_session=True,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.WEXITSTATUS(status) or os.WTERMSIG(status)
            return process.returncode, used.ru_utime + used.ru_stime

    def run_part(self, name):
        """Run a part, print its line, and all that is known of its failures."""
        if self.is_over:
            return
        if name == "site" and not (BIN / "mkdocs").exists():
            self.total.skipped.append(f"{name}: mkdocs needs Python 3.11")
            return
        begin = time.monotonic()
        command = STYLE.get(name, ["make", "-C", BUILD, target_of(name)])
        log = LOGS / f"{name.replace('/', '_')}.log"
        code, processor = self.run_program(command, log)
        seconds = time.monotonic() - begin
        if self.is_over:
            return
        if name in STYLE:
            outcome = Outcome(int(code == 0))
            if code:
                outcome.failed = [f"{name}\n{log.read_text(errors='replace')}"]
            outcome.times = [(seconds, name)]
        else:
            outcome = results_of(name)
            if code and not outcome.failed:
                outcome.failed.append(f"make ended with {code}")
            if not outcome.passed + len(outcome.failed) + len(outcome.skipped):
                outcome.failed.append("no test ran")
            outcome.times = [(time, f"{name}: {case}") for time, case in outcome.times]
        word = "FAILED" if outcome.failed else "ok"
        spent = f"({seconds:.1f} s, {processor:.1f} s of processor)"
        with self._lock:
            self.total.add(outcome)
            print(f"{word:6} {name:24} {outcome} {spent}")
            if outcome.failed:
                print(*outcome.failed, f"Its output: {log}", sep="\n")
            sys.stdout.flush()

    def run(self, names):
        """Run parts beside each other, in their order.

        One make per part, as a make of several of CMake's targets runs one at a time.
        """
        for file in RESULTS.glob("*.xml"):  # of parts that are gone, too
            file.unlink()
        shutil.rmtree(LOGS, ignore_errors=True)
        LOGS.mkdir()
        if not {*names} <= {*STYLE}:
            log = LOGS / "build.log"
            if self.run_program(["make", "-C", BUILD], log)[0]:
                text = log.read_text(errors="replace")
                sys.exit(f"{text}tools/test: the workspace cannot be built")
        with ThreadPoolExecutor(AT_A_TIME) as pool:
            try:
                for _ in pool.map(self.run_part, names):
                    pass
            except KeyboardInterrupt:
                for number in SIGNALS:  # another one must not keep it from ending them
                    signal.signal(number, signal.SIG_IGN)
                self.end()
                raise
        if self.is_over:
            self.total.failed.append(f"{LIMIT / 60:.0f} minutes were not enough")
        wait_for_end(self.mark, 60.0)
        left = marked_processes(self.mark).values()
        self.total.failed += [f"left behind: {line}" for line in left]

    def end(self):
        """End all that runs, and begin nothing more."""
        self.is_over = True
        end_processes(self.mark)

    def tell_all(self):
        """Print what took longest, what was skipped, what failed, and the count."""
        for seconds, name in sorted(self.total.times, reverse=True)[:SLOWEST]:
            print(f"{seconds:6.1f} s {name}")
        lines = [re.sub(r"\[[^]]*\]:", ":", line) for line in self.total.skipped]
        for line, count in Counter(lines).items():
            print(f"skipped {line}{f' ({count} cases)' if count > 1 else ''}")
        for failure in self.total.failed:
            print(f"FAILED {failure.splitlines()[0]}")
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
        names = [*STYLE, *tests]
    else:  # what needs nodes needs tf2_py for that Python
        names = tests if (PLACE / "ros" / "tf2_py").exists() else WITHOUT_NODES
    return [n for n in FIRST if n in names] + [n for n in names if n not in FIRST]


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
        # As a shell completes them, too: test/robot, test/rostest/display.test
        name = re.sub(r"^test/(?=.)|/$|[.]test$", "", pattern)
        fits = [n for n in names if fnmatch.fnmatch(n, name)]
        fits += [n for n in names if n.startswith(f"{name}/")]
        fits = fits or [n for n in names if fnmatch.fnmatch(n, f"rostest/{name}")]
        if not fits:
            sys.exit(f"tools/test: no part '{pattern}'; there are {' '.join(names)}")
        found += fits
    return [name for name in names if name in found]


def main():
    """Run what was asked for."""
    is_quick = sys.argv[1:] == ["quick"]
    quick = [name for name in QUICK if name in available()]
    names = chosen(quick if is_quick else sys.argv[1:])
    # Also where SIGINT is ignored, as in the background: so the programs here do not.
    for number in SIGNALS:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    lock = open(BUILD / "tests.lock", "w")  # noqa: SIM115  (until the end)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        sys.exit("tools/test: another one runs in this clone; wait for its end")
    with tempfile.TemporaryDirectory(prefix="g1_test_") as folder:
        run = Run(folder, is_quick)
        limit = threading.Timer(LIMIT, run.end)
        limit.daemon = True
        limit.start()
        try:
            run.run(names)
        except KeyboardInterrupt:
            print("tools/test: interrupted", file=sys.stderr)
            sys.exit(128 + signal.SIGINT)
        finally:
            run.end()
    sys.exit(run.tell_all())


if __name__ == "__main__":
    main()
