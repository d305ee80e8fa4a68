"""What users get who install the package into a workspace of their own."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

from waiting import DEADLINE

from ports import free_port
from processes import (
    end_processes,
    marked_environment,
    marked_processes,
    new_mark,
    wait_for_end,
)

REPOSITORY = Path(__file__).resolve().parents[2]
LINK_STATES_MD5 = "48c080191eb15c41858319b4d8a609c2"
SOURCED = 'for file in "$@"; do [ ! -e "$file" ] || . "$file"; done; exec env -0'


def run(command, environment):
    """Run a program, which must end well; give what it prints."""
    done = subprocess.run(
        [str(word) for word in command],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=2 * DEADLINE,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def sourced(*files):
    """Give the environment of a new shell that sources files, those that exist."""
    plain = {"HOME": os.environ["HOME"], "PATH": "/usr/sbin:/usr/bin:/sbin:/bin"}
    text = run(
        ["bash", "-c", SOURCED, "bash", "/opt/ros/noetic/setup.bash", *files], plain
    )
    return dict(line.split("=", 1) for line in text.split("\0") if "=" in line)


@pytest.fixture(scope="module")
def install(tmp_path_factory):
    """Install what tools/setup has built, as ``catkin_make install`` does.

    The files go below a folder, from which they work as well: catkin's setup files look
    where they are.
    """
    devel = Path(os.environ["CMAKE_PREFIX_PATH"].split(os.pathsep)[0])
    workspace = devel.parent
    place = tmp_path_factory.mktemp("place")
    environment = {**os.environ, "DESTDIR": str(place)}
    run(["cmake", "-P", workspace / "build" / "cmake_install.cmake"], environment)
    return place / (workspace / "install").relative_to("/")


@pytest.fixture(scope="module")
def environment(install):
    return sourced(install / "setup.bash")


def test_the_messages_are_those_of_gazebo(environment):
    command = ["rosmsg", "md5", "gazebo_msgs/LinkStates"]
    assert run(command, environment).strip() == LINK_STATES_MD5


def test_programs_of_gazebo_ros_are_there(environment):
    command = ["rosrun", "gazebo_ros", "gzserver", "--version"]
    assert "stand-in" in run(command, environment)


def test_pythons_own_interpreter_finds_the_package(environment):
    script = "from g1_description import Robot; print(Robot().name)"
    command = [Path(sys.base_prefix) / "bin" / "python3", "-c", script]
    assert run(command, environment).strip() == "g1_29dof"


def test_the_display_runs_with_nodes_of_the_install_space(
    install, environment, tmp_path
):
    mark, log = new_mark(), tmp_path / "roslaunch.txt"
    address = {"ROS_MASTER_URI": f"http://localhost:{free_port()}"}
    environment = {**environment, **address, "ROS_HOME": str(tmp_path)}
    with log.open("w") as output:
        roslaunch = subprocess.Popen(
            ["roslaunch", "g1_description", "display.launch", "rviz:=false"],
            env=marked_environment(mark, environment),
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        echo = "until rostopic echo -n 1 /joint_states/name 2>&-; do sleep 0.2; done"
        text = run(["bash", "-c", echo], environment)
        nodes = [line for line in marked_processes(mark).values() if ".py" in line]
        roslaunch.send_signal(signal.SIGINT)
        wait_for_end(mark, DEADLINE)
    finally:
        end_processes(mark)
    assert roslaunch.wait() == 0, log.read_text()
    assert text.count("_joint") == 29
    assert nodes and all(str(install) in line for line in nodes)
