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
from forked import run_script

PACKAGE = Path(__file__).resolve().parents[2] / "interfaces" / "gazebo_ros"
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


def roslaunch(*arguments):
    run = run_script(shutil.which("roslaunch"), *arguments)
    assert run.returncode == 0, run.stderr
    return run.stdout


def command(node, *arguments):
    """Give the command line that the launch file starts a node with."""
    wanted = ("gazebo_ros", "empty_world.launch", *arguments)
    words = shlex.split(roslaunch(f"--args={node}", *wanted).splitlines()[-1])
    program = next(i for i, word in enumerate(words) if "/gazebo_ros/" in word)
    return [Path(words[program]).name, *words[program + 1 : -1]]


def test_the_launch_file_takes_the_arguments_of_the_original():
    root = ElementTree.parse(PACKAGE / "launch" / "empty_world.launch").getroot()
    documented = [arg for arg in root.findall("arg") if arg.get("doc")]
    assert {arg.get("name"): arg.get("default") for arg in documented} == ARGUMENTS


@pytest.mark.slow
def test_the_server_gets_its_arguments():
    assert command("gazebo") == ["gzserver", "-e", "ode", "worlds/empty.world"]
    given = ("paused", "recording", "headless", "debug", "verbose")
    words = command(
        "gazebo",
        *(f"{name}:=true" for name in given),
        *("physics:=hold", "world_name:=a.world"),
        "extra_gazebo_args:=--seed 3",
    )
    assert words == [
        *("debug", "-u", "--verbose", "-r", "--headless"),
        *("-e", "hold", "--seed", "3", "a.world"),
    ]


@pytest.mark.slow
def test_the_window_is_optional():
    launch = ("--nodes", "gazebo_ros", "empty_world.launch")
    assert roslaunch(*launch).split() == ["/gazebo", "/gazebo_gui"]
    assert roslaunch(*launch, "gui:=false").split() == ["/gazebo"]


def test_parameters_are_set_where_asked_for():
    launch = ("--dump-params", "gazebo_ros", "empty_world.launch")
    assert roslaunch(*launch).split() == [
        *("/gazebo/enable_ros_network:", "true"),
        *("/use_sim_time:", "true"),
    ]
    rarely = ("use_sim_time:=false", "use_clock_frequency:=true")
    told = roslaunch(*launch, *rarely, "pub_clock_frequency:=50")
    assert "/use_sim_time: false" in told
    assert "/gazebo/pub_clock_frequency: 50" in told
    told = roslaunch(*launch, "enable_ros_network:=false")
    assert "/gazebo/enable_ros_network: false" in told


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["debug", "gazebo", "gzclient", "gzserver", "spawn_model"]
)
def test_rosrun_finds_exactly_one_executable(name):
    run = subprocess.run(
        ["rosrun", "gazebo_ros", name, "-h"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "DISPLAY": ""},
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("usage: ")


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
