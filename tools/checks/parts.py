"""The parts of tools/test: what each runs, and how its cases are counted."""

import json
import os
import shutil
import signal
import sys
from pathlib import Path
from xml.etree import ElementTree

from .outcome import Outcome, read_junit
from .runner import BIN, PACKAGE, PLACE, ROOT, WORKSPACE, free_port
from processes import end_processes, marked_processes, wait_for_end

LINK_STATES_MD5 = "48c080191eb15c41858319b4d8a609c2"
QUICK = ("ruff", "format", "mypy", "catkin_lint", "unit", "sim", "ros/display")
"""Parts of `tools/test quick`."""
LONGEST = (
    *("sim", "ros/drop_in", "unit", "ros/fuzz", "ros/poses", "ros/snapshot"),
    *("ros/bridge_health", "ros/golden", "install", "ros/busy_poses"),
    *("ros/bridge_time", "ros/spawn_model", "ros/rviz_vendor", "ros/interrupts"),
    *("ros/doctor", "ros/record", "ros/motion", "ros/clips", "ros/web"),
    *("ros/lifecycle", "ros/bridge_robots", "ros/hold"),
)
"""Parts that begin first, as the end would wait for them."""


def run_pytest(runner, folder, without_slow):
    """Run the tests in a folder.

    Args:
        runner: What runs them.
        folder: Their folder, as seen from the repository.
        without_slow: Whether to leave out those that are marked as slow.
    """
    results = runner.folder / "pytest.xml"
    results.unlink(missing_ok=True)
    pytest = [BIN / "python", "-m", "pytest", "-q", "-n", "auto"]
    if without_slow:
        pytest += ["-m", "not slow"]
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
    file = file.relative_to(ROOT)
    if file.parts[0] == "examples":  # a package of its own, that is not built here
        paths = [str(ROOT / "examples"), environment["ROS_PACKAGE_PATH"]]
        environment["ROS_PACKAGE_PATH"] = os.pathsep.join(paths)
        link = ROOT / file
    else:
        link = PACKAGE / file
    code, text = runner.run(["rostest", link], environment)

    outcome = Outcome()
    results = list((home / "test_results").glob("*/rosunit-*.xml"))
    for result in results:
        outcome.add(read_junit(result))
    # rosunit takes a skipped test for one that passed, but not a class that is skipped.
    if skips.exists():
        skipped = skips.read_text().splitlines()
        outcome.skipped += skipped
        outcome.passed -= sum(not line.startswith("setUpClass ") for line in skipped)
    # It does not say what went wrong in subtests and around tests, as in setUpClass.
    if errors.exists():
        outcome.failed.append(errors.read_text())
    # Its own file tells of tests that gave no results at all.
    for result in (home / "test_results").glob("*/rostest-*.xml"):
        outcome.failed += read_junit(result).failed
    asked = len(list(ElementTree.parse(link).iter("test")))
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
    files = {*PACKAGE.glob("launch/*.launch"), *PACKAGE.glob("interfaces/*/launch/*")}
    for file in sorted(files):
        results = runner.folder / "launch.xml"
        outcome.add(runner.check([checker, "-o", results, file]))
    return outcome


def run_install(runner):
    """Install as a user would, and start the nodes from there.

    A workspace of its own, where the package is a link to the clone. CMake runs
    twice, as then it must not take our own interfaces for somebody else's. Messages
    are made for Python alone; tools/setup has made them for every language.
    """
    workspace = runner.folder / "workspace"
    install = workspace / "install"
    (workspace / "src").mkdir(parents=True)
    (workspace / "src" / "g1_description").symlink_to(ROOT)
    build = ["catkin_make", "-C", workspace, f"-DPYTHON_EXECUTABLE={BIN}/python"]
    others = "gencpp:geneus:genlisp:gennodejs"
    plain = {**runner.plain, "ROS_LANG_DISABLE": others}
    outcome = runner.check([*build, "-DCATKIN_ENABLE_TESTING=OFF"], plain)
    outcome.add(runner.check([*build, "--force-cmake", "install"], plain))
    if outcome.failed:
        return outcome
    built = runner.sourced(install / "setup.bash")
    message = ["rosmsg", "md5", "gazebo_msgs/LinkStates"]
    outcome.add(runner.check(message, built, LINK_STATES_MD5))
    version = ["rosrun", "gazebo_ros", "gzserver", "--version"]
    outcome.add(runner.check(version, built, "stand-in"))
    robot = "from g1_description import Robot; print(Robot().name)"
    outcome.add(runner.check(["/usr/bin/python3", "-c", robot], built, "g1_29dof"))
    outcome.add(run_installed_nodes(runner, built, install))
    return outcome


def run_installed_nodes(runner, environment, install):
    """Launch the display from an install space until joint states flow."""
    environment = {**environment, "ROS_MASTER_URI": f"http://localhost:{free_port()}"}
    log = runner.folder / "roslaunch.txt"
    command = ["roslaunch", "g1_description", "display.launch", "rviz:=false"]
    with open(log, "w") as output:
        roslaunch = runner.start(command, environment, output, cwd=runner.folder)
    meter = [sys.executable, ROOT / "tools" / "joint_states.py", "--timeout=60"]
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


def parts(is_quick=False):
    """List all parts.

    Args:
        is_quick: Whether to leave out the tests that are marked as slow.

    Returns:
        Functions of a Runner that give an Outcome, by name, in the order to run.
    """
    ruff = BIN / "ruff"
    # It looks for no package inside a package.
    packages = [PACKAGE, *sorted(PACKAGE.glob("interfaces/*"))]
    lint = ["catkin_lint", "-W2", "--strict", "--offline", *packages]
    found = {
        "ruff": lambda runner: runner.check([ruff, "check"]),
        "format": lambda runner: runner.check([ruff, "format", "--check"]),
        "mypy": lambda runner: runner.check([BIN / "mypy"]),
        "catkin_lint": lambda runner: runner.check(lint),
        "launch": run_launch,
        "urdf": run_urdf,
        "unit": lambda runner: run_pytest(runner, "test/unit", is_quick),
        "sim": lambda runner: run_pytest(runner, "test/sim", is_quick),
        "install": run_install,
    }
    for file in sorted((ROOT / "test" / "ros").glob("*.test")):
        found[f"ros/{file.stem}"] = lambda runner, file=file: run_rostest(runner, file)
    for file in sorted((ROOT / "examples").glob("*/test/*.test")):
        name = f"example/{file.stem}"
        found[name] = lambda runner, file=file: run_rostest(runner, file)
    found = {**{name: found[name] for name in LONGEST}, **found}
    return {name: found[name] for name in found if goes_with_the_interpreter(name)}


def goes_with_the_interpreter(name):
    """Tell whether a part can run with the Python that was chosen, by the part's name.

    Only tests can with another one, and nodes only where it has tf2_py.
    """
    with_nodes = name.startswith(("ros/", "example/"))
    has_nodes = (PLACE / "ros" / "tf2_py").exists()
    return PLACE == ROOT or name in ("unit", "sim") or (with_nodes and has_nodes)
