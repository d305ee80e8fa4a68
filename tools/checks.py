"""Run the checks and tests, and count. Called by tools/test."""

import fnmatch
import json
import os
import queue
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
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
WORKSPACE = ROOT / ".ws"
BIN = ROOT / ".venv" / "bin"
LIMIT = 75 * 60.0  # [s] for all parts together
PART_LIMIT = 600.0  # [s] for one program
AT_A_TIME = 2  # rostests; most of their time they wait
LINK_STATES_MD5 = "48c080191eb15c41858319b4d8a609c2"


@dataclass
class Outcome:
    """Cases of one part: a count, and a text for each that did not pass."""

    passed: int = 0
    failed: list = field(default_factory=list)
    skipped: list = field(default_factory=list)
    details: str = ""  # output of the program, shown when something failed

    def add(self, other):
        """Count the cases of another outcome in."""
        self.passed += other.passed
        self.failed += other.failed
        self.skipped += other.skipped
        self.details += other.details

    def check(self, good, text):
        """Count one case, with a text for when it is not good."""
        if good:
            self.passed += 1
        else:
            self.failed.append(text)

    def __str__(self):
        """Count in words."""
        return (
            f"{self.passed} passed, {len(self.failed)} failed, "
            f"{len(self.skipped)} skipped"
        )


class Runner:
    """Runs programs in a folder of their own and leaves none behind."""

    def __init__(self, folder):
        """Take the environment of the built workspace.

        Args:
            folder: Where results, logs and ROS's own files go.
        """
        self.folder = folder
        folder.mkdir()
        self.mark = new_mark()
        self.is_stopped = False
        self.deadline = time.monotonic() + LIMIT
        os.environ.update(
            ROS_HOSTNAME="localhost",
            ROS_HOME=f"{folder}/ros",
            ROS_LOG_DIR=f"{folder}/ros/log",
            ROS_MASTER_URI=f"http://localhost:{free_port()}",
        )
        for name in ("DISPLAY", "ROS_IP"):
            os.environ.pop(name, None)
        self.plain = dict(os.environ)
        underlay = Path("/opt/ros/noetic/setup.bash")
        if underlay.exists():
            self.plain = self.sourced(underlay)
        self.built = self.sourced(WORKSPACE / "devel" / "setup.bash")

    def sourced(self, setup):
        """Give the environment that a setup file makes."""
        text = subprocess.run(
            ["bash", "-c", '. "$1" && exec env -0', "bash", setup],
            env=self.plain,
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        ).stdout
        return dict(line.split("=", 1) for line in text.split("\0") if "=" in line)

    def start(self, command, environment=None, output=subprocess.DEVNULL, cwd=ROOT):
        """Start a program with the mark, in a session of its own."""
        return subprocess.Popen(
            [str(word) for word in command],
            cwd=cwd,
            env=marked_environment(self.mark, environment or self.built),
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )

    def run(self, command, environment=None, limit=PART_LIMIT):
        """Run a program to its end.

        Args:
            command: Program and arguments.
            environment: Its environment; None is that of the workspace.
            limit: Time it may take, in [s].

        Returns:
            Exit code and output; the code is None if it was out of time.
        """
        limit = max(0.0, min(limit, self.deadline - time.monotonic()))
        with open(self.folder / "output.txt", "w+", errors="replace") as output:
            process = self.start(command, environment, output)
            try:
                code = process.wait(limit)
            except subprocess.TimeoutExpired:
                code = None
                end_processes(self.mark)
                process.wait()
                output.write(f"\nout of time after {limit:.0f} s\n")
            output.seek(0)
            return code, output.read()

    def check(self, command, environment=None, expected=""):
        """Run a program as one case: it must end well and print what is expected."""
        code, text = self.run(command, environment)
        outcome = Outcome()
        words = " ".join(str(word) for word in command)
        outcome.check(code == 0 and expected in text, f"{words}\n{text}")
        return outcome

    def stop(self):
        """End all it started, and run nothing more."""
        self.is_stopped, self.deadline = True, 0.0
        end_processes(self.mark)

    def leftover(self):
        """Take each process that is still there for a failure, and end it."""
        wait_for_end(self.mark, 5.0)
        left = marked_processes(self.mark)
        end_processes(self.mark)
        return Outcome(failed=[f"left behind: {line}" for line in left.values()])


def free_port():
    """Find a TCP port that nobody listens on."""
    with socket.socket() as listener:
        listener.bind(("localhost", 0))
        return listener.getsockname()[1]


def read_junit(file):
    """Count the cases of a result file in JUnit's format."""
    outcome = Outcome()
    try:
        cases = ElementTree.parse(file).iter("testcase")
    except ElementTree.ParseError as error:  # the program was ended while it wrote
        return Outcome(failed=[f"{file.name} cannot be read: {error}"])
    for case in cases:
        name = f"{case.get('classname')}.{case.get('name')}"
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


def run_pytest(runner, folder):
    """Run the tests in a folder."""
    results = runner.folder / "pytest.xml"
    results.unlink(missing_ok=True)
    pytest = (BIN / "python", "-m", "pytest", "-q", "-n", "auto")
    code, text = runner.run([*pytest, f"--junitxml={results}", folder])
    if code is None or not results.exists():
        return Outcome(failed=[f"pytest {folder}\n{text}"])
    outcome = read_junit(results)
    if code != 0 and not outcome.failed:
        outcome.failed.append(f"pytest {folder} ended with {code}\n{text}")
    return outcome


def run_rostest(runner, file):
    """Run one rostest; believe the result files rather than the exit code."""
    home = runner.folder / "rostest"
    shutil.rmtree(home, ignore_errors=True)
    home.mkdir()
    skips, errors = home / "skipped", home / "errors"
    path = os.pathsep.join([f"{ROOT}/tools/rosunit", runner.built["PYTHONPATH"]])
    environment = {
        **runner.built,
        "G1_DESCRIPTION_SKIPPED": str(skips),
        "G1_DESCRIPTION_ERRORS": str(errors),
        "PYTHONPATH": path,
        "ROS_HOME": str(home),
        "ROS_LOG_DIR": str(home / "log"),
    }
    link = WORKSPACE / "src" / "g1_description" / file.relative_to(ROOT)
    code, text = runner.run(["rostest", link], environment)

    outcome = Outcome()
    results = list((home / "test_results").glob("*/rosunit-*.xml"))
    for result in results:
        outcome.add(read_junit(result))
    # rosunit takes a skipped test for one that passed.
    if skips.exists():
        outcome.skipped += skips.read_text().splitlines()
        outcome.passed -= len(outcome.skipped)
    # It does not say what went wrong in subtests and around tests, as in setUpClass.
    if errors.exists():
        outcome.failed.append(errors.read_text())
    # Its own file tells of tests that gave no results at all.
    for result in (home / "test_results").glob("*/rostest-*.xml"):
        outcome.failed += read_junit(result).failed
    asked = len(list(ElementTree.parse(file).iter("test")))
    if not outcome.failed and (code != 0 or len(results) != asked):
        outcome.failed.append(
            f"{len(results)} of {asked} tests gave results; rostest ended with {code}"
        )
    outcome.details = text
    return outcome


def run_urdf(runner):
    """Let urdfdom read every robot."""
    outcome = Outcome()
    for file in sorted((ROOT / "urdf").glob("*.urdf")):
        outcome.add(runner.check(["check_urdf", file], expected="Successfully Parsed"))
    return outcome


def run_launch(runner):
    """Let roslaunch check every launch file."""
    outcome = Outcome()
    _, folder = runner.run(["rospack", "find", "roslaunch"])
    checker = Path(folder.splitlines()[-1]) / "scripts" / "roslaunch-check"
    package = WORKSPACE / "src" / "g1_description"
    files = {*package.glob("launch/*.launch"), *package.glob("interfaces/*/launch/*")}
    for file in sorted(files):
        results = runner.folder / "launch.xml"
        outcome.add(runner.check([checker, "-o", results, file]))
    return outcome


def run_install(runner):
    """Install as a user would, and start the nodes from there.

    A workspace of its own, where the package is a link to the clone. CMake runs
    twice, as then it must not take our own interfaces for somebody else's.
    """
    workspace = runner.folder / "workspace"
    install = workspace / "install"
    (workspace / "src").mkdir(parents=True)
    (workspace / "src" / "g1_description").symlink_to(ROOT)
    build = ["catkin_make", "-C", workspace, f"-DPYTHON_EXECUTABLE={BIN}/python"]
    outcome = runner.check([*build, "-DCATKIN_ENABLE_TESTING=OFF"], runner.plain)
    outcome.add(runner.check([*build, "--force-cmake", "install"], runner.plain))
    if outcome.failed:
        return outcome
    built = runner.sourced(install / "setup.bash")
    message = ["rosmsg", "md5", "gazebo_msgs/LinkStates"]
    outcome.add(runner.check(message, built, LINK_STATES_MD5))
    version = ["rosrun", "gazebo_ros", "gzserver", "--version"]
    outcome.add(runner.check(version, built, "stand-in"))
    outcome.add(run_installed_nodes(runner, built, install))
    return outcome


def run_installed_nodes(runner, environment, install):
    """Launch the display from an install space until joint states flow."""
    environment = {**environment, "ROS_MASTER_URI": f"http://localhost:{free_port()}"}
    log = runner.folder / "roslaunch.txt"
    command = ["roslaunch", "g1_description", "display.launch", "rviz:=false"]
    with open(log, "w") as output:
        roslaunch = runner.start(command, environment, output, cwd=runner.folder)
    meter = [sys.executable, ROOT / "tools" / "joint_states.py", "--patience=60"]
    code, text = runner.run(meter, environment)
    nodes = [line for line in marked_processes(runner.mark).values() if ".py" in line]
    strays = [line for line in nodes if str(WORKSPACE / "devel") in line]
    roslaunch.send_signal(signal.SIGINT)
    wait_for_end(runner.mark, 30.0)
    end_processes(runner.mark)
    ended = roslaunch.wait()

    outcome = Outcome(details=f"{text}\n{log.read_text()}")
    names = json.loads(text.splitlines()[-1])["names"] if code == 0 else []
    outcome.check(len(names) == 29, f"29 joints wanted, {len(names)} came")
    outcome.check(
        nodes and not strays, f"nodes from elsewhere than {install}: {strays}"
    )
    outcome.check(ended == 0, f"roslaunch ended with {ended}")
    return outcome


def parts():
    """List all parts.

    Returns:
        Functions of a Runner that give an Outcome, by name, in the order to run.
    """
    ruff = BIN / "ruff"
    package = WORKSPACE / "src" / "g1_description"
    # It looks for no package inside a package.
    packages = [package, *sorted(package.glob("interfaces/*"))]
    lint = ["catkin_lint", "-W2", "--strict", "--offline", *packages]
    found = {
        "ruff": lambda runner: runner.check([ruff, "check"]),
        "format": lambda runner: runner.check([ruff, "format", "--check"]),
        "mypy": lambda runner: runner.check([BIN / "mypy"]),
        "catkin_lint": lambda runner: runner.check(lint),
        "launch": run_launch,
        "urdf": run_urdf,
        "unit": lambda runner: run_pytest(runner, "test/unit"),
        "sim": lambda runner: run_pytest(runner, "test/sim"),
    }
    for file in sorted((ROOT / "test" / "ros").glob("*.test")):
        found[f"ros/{file.stem}"] = lambda runner, file=file: run_rostest(runner, file)
    found["install"] = run_install
    return found


def chosen(names, patterns):
    """Choose the parts that the user named; all if none is.

    Raises:
        SystemExit: If there is no such part.
    """
    if not patterns:
        return names
    for pattern in patterns:
        if not any(matches(name, pattern) for name in names):
            sys.exit(f"tools/test: no part '{pattern}'; there are {' '.join(names)}")
    return [name for name in names if any(matches(name, p) for p in patterns)]


def matches(name, pattern):
    """Tell whether a part is meant by what the user wrote."""
    return fnmatch.fnmatch(name, pattern) or name.startswith(f"{pattern}/")


def run_part(runner, name, function, word="FAILED"):
    """Run one part and print its line.

    Args:
        runner: What runs it.
        name: Its name.
        function: Of a runner; gives the outcome.
        word: What to call it where something failed.
    """
    start = time.monotonic()
    outcome = attempt(runner, function)
    if runner.is_stopped:
        return outcome
    print_part(word if outcome.failed else "ok", name, outcome, start)
    return outcome


def run_in_pairs(runners, parts):
    """Run parts, as many at a time as there are runners.

    What runs against the clock may fail when the machine is held up: what fails beside
    another runs once more, alone, and its first failure is printed all the same.

    Args:
        runners: One for each part that runs at the same time.
        parts: Pairs of name and function.
    """
    idle = queue.Queue()
    for runner in runners:
        idle.put(runner)

    def run_beside_others(part):
        runner = idle.get()
        try:
            return run_part(runner, *part, word="AGAIN")
        finally:
            idle.put(runner)

    with ThreadPoolExecutor(len(runners)) as pool:
        try:
            outcomes = list(pool.map(run_beside_others, parts))
        except KeyboardInterrupt:
            for runner in runners:
                runner.stop()
            raise
    total = Outcome()
    for part, outcome in zip(parts, outcomes):
        total.add(run_part(runners[0], *part) if outcome.failed else outcome)
    return total


def attempt(runner, function):
    """Run one part, and end what it leaves behind."""
    if time.monotonic() > runner.deadline:
        return Outcome(failed=[f"not run: {LIMIT / 60:.0f} minutes are over"])
    outcome = function(runner)
    outcome.add(runner.leftover())
    return outcome


def print_part(word, name, outcome, start):
    """Print a part's line, and all that is known of its failures."""
    seconds = time.monotonic() - start
    lines = [f"{word:6} {name:20} {outcome} ({seconds:.1f} s)"]
    if outcome.failed:
        lines += [*outcome.failed, outcome.details]
    print("\n".join(lines), flush=True)


def print_skipped(lines):
    """Name what was skipped, in one line per test for all its parameters."""
    counts = Counter(re.sub(r"\[[^]]*\]:", ":", line) for line in lines)
    for line, count in counts.items():
        print(f"skipped {line}{f' ({count} cases)' if count > 1 else ''}")


def main():
    """Run what was asked for."""
    available = parts()
    names = chosen(list(available), sys.argv[1:])
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    total = Outcome()
    with tempfile.TemporaryDirectory(prefix="g1_test_") as folder:
        runners = [Runner(Path(folder) / str(number)) for number in range(AT_A_TIME)]
        rostests = [name for name in names if name.startswith("ros/")]
        try:
            for name in names:
                if name not in rostests:
                    total.add(run_part(runners[0], name, available[name]))
            pairs = [(name, available[name]) for name in rostests]
            total.add(run_in_pairs(runners, pairs))
        except KeyboardInterrupt:
            sys.exit("tools/test: interrupted")
        finally:
            for runner in runners:
                runner.stop()
    print_skipped(total.skipped)
    print(total)
    sys.exit(1 if total.failed else 0)


main()
