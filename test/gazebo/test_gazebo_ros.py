"""The package gazebo_ros that is built where there is none."""

import importlib
import inspect
import os
import shlex
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import REPOSITORY
from forked import run_script

roslaunch = pytest.importorskip("roslaunch", reason="roslaunch is not installed")

from roslaunch.config import ROSLaunchConfig  # noqa: E402
from roslaunch.xmlloader import XmlLoader  # noqa: E402
from roslib.packages import find_node  # noqa: E402

PACKAGE = Path(__file__).resolve().parents[2] / "interfaces" / "gazebo_ros"
LAUNCH = PACKAGE / "launch" / "empty_world.launch"
FOUND = shutil.which("rospack") and subprocess.run(
    ["rospack", "find", "gazebo_ros"], capture_output=True, text=True, check=False
)
OURS = FOUND and Path(FOUND.stdout.strip() or "/").resolve() == PACKAGE
pytestmark = pytest.mark.skipif(not OURS, reason="our own gazebo_ros is not built")

# The arguments of the original's empty_world.launch, and their defaults.
ARGUMENTS = {
    "paused": "false",
    "use_sim_time": "true",
    "extra_gazebo_args": "",
    "gui": "true",
    "recording": "false",
    "headless": "false",
    "debug": "false",
    "physics": "ode",
    "verbose": "false",
    "output": "screen",
    "world_name": "worlds/empty.world",
    "respawn_gazebo": "false",
    "use_clock_frequency": "false",
    "pub_clock_frequency": "100",
    "enable_ros_network": "true",
    "server_required": "false",
    "gui_required": "false",
}


def launched(*arguments):
    """Read the launch file; give its nodes by name, and its parameters."""
    config = ROSLaunchConfig()
    XmlLoader().load(str(LAUNCH), config, argv=[*arguments], verbose=False)
    parameters = {name: param.value for name, param in config.params.items()}
    return {node.name: node for node in config.nodes}, parameters


def command(*arguments):
    """Give the command line that the launch file starts the server with."""
    server = launched(*arguments)[0]["gazebo"]
    return [server.type, *shlex.split(server.args)]


def test_the_launch_file_takes_the_arguments_of_the_original():
    root = ElementTree.parse(LAUNCH).getroot()
    documented = [arg for arg in root.findall("arg") if arg.get("doc")]
    assert {arg.get("name"): arg.get("default") for arg in documented} == ARGUMENTS


def test_the_server_gets_its_arguments():
    assert command() == ["gzserver", "-e", "ode", "worlds/empty.world"]
    given = ("paused", "recording", "headless", "debug", "verbose")
    words = command(
        *(f"{name}:=true" for name in given),
        *("physics:=hold", "world_name:=a.world"),
        "extra_gazebo_args:=--seed 3",
    )
    assert words == [
        *("debug", "-u", "--verbose", "-r", "--headless"),
        *("-e", "hold", "--seed", "3", "a.world"),
    ]


def test_the_window_is_optional_and_parameters_are_set_where_asked_for():
    nodes, parameters = launched()
    assert {*nodes} == {"gazebo", "gazebo_gui"}
    wanted = {"/gazebo/enable_ros_network": True, "/use_sim_time": True}
    assert parameters == wanted
    rarely = ("use_sim_time:=false", "use_clock_frequency:=true")
    nodes, parameters = launched(
        *rarely, "gui:=false", "pub_clock_frequency:=50", "enable_ros_network:=false"
    )
    assert {*nodes} == {"gazebo"}
    assert parameters == {
        "/use_sim_time": False,
        "/gazebo/enable_ros_network": False,
        "/gazebo/pub_clock_frequency": 50,
    }


@pytest.mark.parametrize(
    "name", ["debug", "gazebo", "gzclient", "gzserver", "spawn_model"]
)
def test_exactly_one_executable_has_the_name(name):
    (program,) = find_node("gazebo_ros", name)
    run = run_script(program, "-h", environment={**os.environ, "DISPLAY": ""})
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("usage: ")


def test_the_controllers_of_joints_tell_their_topics_and_parameters():
    program = REPOSITORY / "scripts" / "joint_controllers.py"
    run = run_script(program, "-h", environment={**os.environ})
    assert run.stdout.startswith("usage: joint_controllers.py ")
    for name in ("NAME/joint", "NAME/command", "NAME/state", "~model_name"):
        assert name in run.stdout


def test_python_nodes_find_the_functions_of_the_original():
    interface = importlib.import_module("gazebo_ros.gazebo_interface")
    assert PACKAGE in Path(interface.__file__).resolve().parents
    spawn = ["model_name", "model_xml", "robot_namespace", "initial_pose"]
    spawn += ["reference_frame", "gazebo_namespace"]
    configure = ["model_name", "model_param_name", "joint_names", "joint_positions"]
    arguments = {
        "spawn_sdf_model_client": spawn,
        "spawn_urdf_model_client": spawn,
        "set_model_configuration_client": [*configure, "gazebo_namespace"],
    }
    for name, expected in arguments.items():
        assert list(inspect.signature(getattr(interface, name)).parameters) == expected
