"""The command snapshot against the display: pictures and films of what the robot does.

It runs in the test's own node, but where its process is tested. What it refuses and
writes without a master is tested in test/cli/test_snapshot.py.
"""

import os
import re
import signal
import sys
import time

import numpy as np
import pytest
import rosgraph
import rospy
from g1_description.msg import RobotState
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import DeleteModel, SetModelState, SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion
from PIL import Image, ImageSequence
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.programs import Program
from support.ros_testing import (
    Connected,
    Repeated,
    is_at,
    service,
    wait_for,
)

from g1_description.cli import running_robots, snapshot
from g1_description.ros.robot_view import RobotView
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import sdf_of

SHOULDER = "left_shoulder_roll_joint"
SMALL = ("--size", "64x48")


@pytest.fixture(scope="module")
def commands():
    made = rospy.Publisher("/joint_commands", JointState, queue_size=1)
    wait_for(made.get_num_connections, "the bridge to listen")
    return made


@pytest.fixture
def move(commands):
    """Give what sends the shoulder somewhere, and returns when it is there."""
    states = Connected("/joint_states", JointState, queue_size=1)

    def go(position):
        states.clear()
        commands.publish(JointState(name=[SHOULDER], position=[position]))
        states.wait(lambda message: is_at(message, SHOULDER, position), "the shoulder")

    yield go
    go(0.0)
    states.close()


@pytest.fixture
def lift():
    """Give what sets the robot to a height, and returns when the bridge shows it."""
    set_state = service("/gazebo/set_model_state", SetModelState)
    # Not decoded, as the command in this node subscribes to it, too.
    states = Connected("/robot_state", rospy.AnyMsg, queue_size=1)

    def is_shown(message, height):
        state = RobotState().deserialize(message._buff)
        return abs(state.base_pose.position.z - height) < 1e-6

    def go(height):
        pose = Pose(Point(0, 0, height), Quaternion(0, 0, 0, 1))
        states.clear()
        assert set_state(ModelState(model_name="g1_robot", pose=pose)).success
        states.wait(lambda message: is_shown(message, height), "the base")

    yield go
    go(0.793)
    states.close()


class HeardRobot(RobotView):
    """A view that has heard of its robot as soon as it is made."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        wait_for(lambda: self.positions, "joint states")


@pytest.fixture
def draw(monkeypatch, tmp_path, capfd):
    """Give what runs the command in this node; it returns the file and the errors."""

    def run(name, *arguments):
        monkeypatch.setattr(sys, "argv", ["snapshot", str(tmp_path / name), *arguments])
        snapshot.main()
        return tmp_path / name, capfd.readouterr().err

    monkeypatch.setattr(running_robots, "start_node", lambda *_, **__: None)
    return run


def picture_in(path):
    return np.array(Image.open(path).convert("RGB")).astype(int)


def test_a_picture_shows_what_a_command_did_and_the_floor_of_the_map(
    draw, move, lift, tmp_path
):
    out, wanted = tmp_path / "a.png", ("--view", "front", "--size", "320x240")
    process = Program("snapshot", out, *wanted)
    told = process.communicate()
    assert (process.returncode, *told) == (0, f"{out}: 320x240, front\n", "")
    before = picture_in(out)
    assert before.shape == (240, 320, 3)
    move(1.4)
    after = picture_in(draw("a.png", *wanted)[0])
    assert (np.abs(after - before).max(axis=2) > 30).sum() > 300
    move(0.0)
    lift(20.0)  # it is seen without the shadow at its feet
    flying = picture_in(draw("a.png", *wanted)[0])
    assert (before[225:] != flying[225:]).any()


def test_objects_of_the_simulator_are_seen(draw):
    scene = Scene()
    scene.sphere("ball", 0.3, [0.5, 0.0, 1.0], color=[1.0, 0.0, 0.0])
    given = {"model_name": "ball", "model_xml": sdf_of([*scene.values()])}
    service("/gazebo/spawn_sdf_model", SpawnModel)(**given)
    try:
        picture = picture_in(draw("a.png", "--view", "front", *SMALL)[0])
    finally:
        service("/gazebo/delete_model", DeleteModel)("ball")
    red, green, blue = np.moveaxis(picture, 2, 0)
    assert ((red > 2 * green) & (red > 2 * blue)).sum() > 20


def test_a_film_shows_the_robot_moving_and_goes_on_after_a_reset(
    draw, commands, monkeypatch
):
    reset = service("/gazebo/reset_simulation", Empty)
    sampled = []

    def now(*given):
        sampled.append(rospy.get_time())
        if len(sampled) == 4:
            reset()
        return sample(*given)

    def swing():
        angle = 0.7 + 0.6 * np.sin(4.0 * time.monotonic())
        commands.publish(JointState(name=[SHOULDER], position=[angle]))

    sample = running_robots.now
    monkeypatch.setattr(running_robots, "now", now)
    swings = Repeated(swing, 0.02)
    path, errors = draw("a.gif", "--gif", "--seconds", "1", "--fps", "10", *SMALL)
    swings.close()
    assert "frame 10 of 10" in errors
    assert min(sampled[4:]) < sampled[3]
    images = ImageSequence.Iterator(Image.open(path))
    frames = [(np.array(i.convert("RGB")), i.info["duration"]) for i in images]
    assert frames[0][0].shape == (48, 64, 3)
    assert sum(length for _, length in frames) == 1000
    assert len(frames) > 3  # equal ones are one


def test_what_is_not_known_of_a_robot_is_told(draw, monkeypatch):
    """Of one joint is told, and the robot is nowhere on TF."""
    publisher = rospy.Publisher("/half/joint_states", JointState, queue_size=1)
    message = JointState(name=["left_knee_joint"], position=[1.0])
    speaker = Repeated(lambda: publisher.publish(message), 0.05)
    monkeypatch.setattr(running_robots, "RobotView", HeardRobot)
    monkeypatch.setattr(running_robots, "JOINTS_TIMEOUT", 0.0)
    monkeypatch.setattr(running_robots, "BASE_TIMEOUT", 0.0)
    _, errors = draw("a.png", "--namespace", "half", *SMALL)
    speaker.close()
    publisher.unregister()
    (told,) = [line for line in errors.splitlines() if "drawn at 0" in line]
    assert "right_knee_joint" in told and "left_knee_joint" not in told
    assert "nor TF has the pose of half/pelvis in map" in errors


def test_joints_that_never_come_are_told(draw, monkeypatch, tmp_path, capfd):
    monkeypatch.setattr(running_robots, "JOINTS_TIMEOUT", 0.0)
    with pytest.raises(SystemExit):
        draw("a.png", "--namespace", "nobody")
    told = "There were no joint states of 'g1_29dof' on /nobody/joint_states within 0 s"
    assert told in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_clock_that_stands_still_is_told(draw, monkeypatch, tmp_path, capfd):
    class Paused(HeardRobot):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            wait_for(
                lambda: not self.missing and self.state.base_pose is not None, "it"
            )
            service("/gazebo/pause_physics", Empty)()

    monkeypatch.setattr(running_robots, "RobotView", Paused)
    monkeypatch.setattr(running_robots, "CLOCK_TIMEOUT", 0.3)
    try:
        with pytest.raises(SystemExit):
            draw("a.gif", "--seconds", "60", "--fps", "1", *SMALL)
    finally:
        service("/gazebo/unpause_physics", Empty)()
    assert "The clock did not advance for 0.3 s" in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


def listens():
    """Tell whether a snapshot hears the robot."""
    _, subscribers, _ = rosgraph.Master("/test").getSystemState()
    nodes = dict(subscribers).get("/robot_state", [])
    return any(re.fullmatch(r"/snapshot_\d+_\d+", node) for node in nodes)


def test_an_interrupt_ends_it_and_leaves_nothing(tmp_path):
    process = Program("snapshot", tmp_path / "a.gif", "--gif", "--seconds", "60")
    wait_for(listens, "snapshot to listen")
    os.killpg(process.pid, signal.SIGINT)
    told = process.communicate()
    errors = "snapshot: interrupted, nothing is written.\n"
    assert (process.returncode, *told) == (130, "", errors)
    assert not list(tmp_path.iterdir())
