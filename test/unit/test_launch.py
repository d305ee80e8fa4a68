"""What the display launches, and with which arguments."""

import os
import shutil
import subprocess

import pytest

FOUND = shutil.which("roslaunch") and shutil.which("rospack")
HERE = (
    FOUND
    and not subprocess.run(
        ["rospack", "find", "g1_description"], capture_output=True, check=False
    ).returncode
)
pytestmark = pytest.mark.skipif(not HERE, reason="no workspace is sourced")

# Of gazebo_ros' own file only what matters here: the arguments it takes.
EMPTY_WORLD = """<launch>
  <arg name="paused" default="false"/>
  <arg name="use_sim_time" default="true"/>
  <arg name="gui" default="true"/>
  <arg name="respawn_gazebo" default="false"/>
  <param name="gui" value="$(arg gui)"/>
  <node name="gazebo" pkg="gazebo_ros" type="gzserver"/>
</launch>"""


def roslaunch(option, *arguments, **environment):
    return subprocess.run(
        ["roslaunch", option, "g1_description", "display.launch", *arguments],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )


@pytest.fixture
def gazebo_ros(tmp_path):
    """Make a package of that name; give the package path with it in front."""
    package = tmp_path / "gazebo_ros"
    (package / "launch").mkdir(parents=True)
    (package / "launch" / "empty_world.launch").write_text(EMPTY_WORLD)
    (package / "package.xml").write_text(
        '<package format="2"><name>gazebo_ros</name><version>0.0.0</version>'
        "<description>d</description><maintainer email='a@b.c'>m</maintainer>"
        "<license>BSD</license></package>"
    )
    return f"{tmp_path}:{os.environ['ROS_PACKAGE_PATH']}"


def test_the_stand_in_is_the_default_and_rviz_needs_a_screen():
    nodes = roslaunch("--nodes", DISPLAY="").stdout.split()
    assert nodes == ["/gazebo", "/link_states_bridge", "/robot_state_publisher"]
    assert "/rviz" in roslaunch("--nodes", DISPLAY=":99").stdout.split()


def test_the_real_gazebo_is_started_with_its_own_spawn_model(gazebo_ros):
    run = roslaunch(
        "--nodes", "sim:=gazebo", "rviz:=false", ROS_PACKAGE_PATH=gazebo_ros
    )
    assert run.returncode == 0, run.stderr
    assert set(run.stdout.split()) == {
        "/gazebo",
        "/spawn_urdf",
        "/link_states_bridge",
        "/robot_state_publisher",
    }


def test_arguments_reach_the_real_gazebo(gazebo_ros):
    wanted = ("sim:=gazebo", "gui:=false", "robot_name:=7")
    run = roslaunch("--dump-params", *wanted, ROS_PACKAGE_PATH=gazebo_ros)
    assert "/gui: false" in run.stdout
    assert "/link_states_bridge/model_name: '7'" in run.stdout


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        (
            "model:=/nowhere.urdf",
            "The model /nowhere.urdf cannot be read: No such file",
        ),
        ("sim:=magic", "sim_magic.launch"),
    ],
)
def test_a_wrong_argument_ends_the_launch_with_its_reason(argument, words):
    run = roslaunch("--nodes", argument)
    assert run.returncode != 0
    assert words in run.stdout + run.stderr
