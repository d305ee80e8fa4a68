"""Robots without ROS: what they are told, they do, and motions play in step."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import assert_poses_close, forward_kinematics
from waiting import wait_for

from g1_description.errors import G1DescriptionError
from g1_description.motion.motion import Motion
from g1_description.robot.urdf import parse_urdf
from g1_description.scenes.objects import attached
from g1_description.scenes.scene import Scene
from g1_description.web.file_world import DISTANCE, FileWorld, StillRobot

BALL = (
    '<robot name="ball"><link name="base"><collision><origin xyz="0 0 0.1"/>'
    '<geometry><sphere radius="0.4"/></geometry></collision></link>'
    '<link name="arm"/><joint name="elbow" type="revolute"><parent link="base"/>'
    '<child link="arm"/><limit lower="0.5" upper="2" effort="1" velocity="1"/></joint>'
    "</robot>"
)


def ramp(seconds, begin=0.0, base=None):
    """Make a motion whose joint is at the time, in [rad]."""
    times = np.linspace(begin, begin + seconds, 11)
    poses = None
    if base is not None:
        poses = np.tile(np.array(base, dtype=float), (11, 1))
        poses[:, 0] += times
    return Motion(times, ("elbow",), times[:, np.newaxis], None, poses)


@pytest.fixture
def ball():
    return StillRobot("ball", parse_urdf(BALL))


def world_of(*names):
    robots = [StillRobot(name, parse_urdf(BALL)) for name in names]
    return FileWorld(robots, lambda path, robot, rate: (path, robot, rate))


def elbow(robot):
    return robot.state().positions_by_name["elbow"]


def test_a_robot_begins_on_the_floor_inside_its_limits(ball):
    state = ball.state()
    assert state.positions_by_name == {"elbow": 0.5}
    assert state.base_pose == pytest.approx([0, 0, 0.3, 0, 0, 0, 1])


def test_the_g1_stands_on_its_feet():
    file = Path(__file__).resolve().parents[2] / "urdf" / "g1_29dof.urdf"
    text = file.read_text()
    robot = StillRobot("g1", parse_urdf(text.replace("package://", "file:///none/")))
    state = robot.state()
    places = forward_kinematics(text, state.base_pose, state.positions_by_name)
    lowest = min(pose[2] for pose in places.values())
    assert 0.0 <= lowest < 0.1, "the soles are below the ankles"
    assert state.positions_by_name.keys() == {
        j.name for j in robot.description.movable_joints
    }


def test_a_command_moves_what_it_names_and_reset_takes_it_back(ball):
    begin = ball.state()
    ball.command({"elbow": 1.25})
    ball.command_base(np.array([1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 0.0]))
    assert elbow(ball) == 1.25
    assert ball.state().base_pose == pytest.approx([1, 2, 3, 0, 0, 1, 0])
    ball.reset()
    assert (elbow(ball), ball.state().base_pose.tolist()) == (
        0.5,
        begin.base_pose.tolist(),
    )


def test_what_is_given_out_is_nobodys_to_change(ball):
    pose = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    ball.command_base(pose)
    pose[0] = 9.0
    ball.state().base_pose[0] = 7.0
    assert ball.state().base_pose[0] == 1.0


def test_a_robot_takes_its_way_and_rests_at_its_end():
    world = world_of("a")
    (robot,) = world.robots
    world.move(robot, {"elbow": 1.5}, 0.3)
    assert robot.is_moving
    first = elbow(robot)
    seen = [wait_for(lambda: first < elbow(robot) and elbow(robot), "a move")]
    wait_for(lambda: seen.append(elbow(robot)) or not robot.is_moving, "the end")
    assert (np.diff(seen) >= 0).all()
    assert elbow(robot) == pytest.approx(1.5, abs=1e-9)
    world.move(robot, {"elbow": 0.6}, 10.0)
    robot.command({"elbow": 0.7})
    assert not robot.is_moving, "a command ends it"
    assert elbow(robot) == 0.7


def test_a_move_without_time_is_at_once():
    world = world_of("a")
    world.changed.clear()
    world.move(world.robots[0], {"elbow": 1.5}, 0.0)
    assert elbow(world.robots[0]) == 1.5
    assert world.changed.is_set()


def test_a_motion_is_shown_at_a_time_and_does_not_run():
    world = world_of("a")
    (robot,) = world.robots
    player = world.open(robot, ramp(4.0, begin=1.0, base=(0, 5, 1, 0, 0, 0, 1)))
    assert (player.begin, player.end, player.is_running) == (1.0, 5.0, False)
    assert elbow(robot) == 1.0, "the first sample"
    player.show(2.34)
    assert elbow(robot) == pytest.approx(2.34)
    assert robot.state().base_pose == pytest.approx([2.34, 5, 1, 0, 0, 0, 1])
    assert (player.time, player.is_running) == (2.34, False)
    player.show(77.0)
    assert elbow(robot) == pytest.approx(5.0), "the last sample stays"


@pytest.mark.parametrize("speed", [0.25, 4.0])
def test_a_motion_plays_by_the_clock_at_its_speed(speed):
    world = world_of("a")
    player = world.open(world.robots[0], ramp(60.0))
    before = time.monotonic()
    player.play(3.0, speed)
    began = time.monotonic()
    assert player.is_running
    wait_for(lambda: player.time > 3.0 + 0.2 * speed, "a moment")
    earliest = time.monotonic() - began
    at = player.time
    latest = time.monotonic() - before
    assert 3.0 + speed * earliest <= at <= 3.0 + speed * latest
    before = player.time
    world.tick()
    assert before - 1e-6 <= elbow(world.robots[0]) <= player.time + 1e-6
    player.pause()
    stopped = player.time
    assert not player.is_running
    assert player.time == stopped


def test_a_motion_ends_at_its_last_sample():
    world = world_of("a")
    player = world.open(world.robots[0], ramp(0.1))
    player.play(0.0, 10.0)
    wait_for(lambda: player.time == player.end, "the end")
    world.tick()
    assert elbow(world.robots[0]) == pytest.approx(0.1)
    assert player.is_running, "until it is told to rest"
    player.rest()
    assert (player.is_running, player.time) == (False, player.end)


def test_two_motions_are_in_step():
    world = world_of("a", "b")
    one, other = world.robots
    world.open(one, ramp(2.0, begin=1.0))
    player = world.open(other, ramp(4.0))
    assert (player.begin, player.end) == (0.0, 4.0)
    player.show(2.5)
    assert elbow(one) == elbow(other) == pytest.approx(2.5)
    player.show(0.5)
    assert (elbow(one), elbow(other)) == pytest.approx((1.0, 0.5)), "not begun yet"
    player.show(3.5)
    assert (elbow(one), elbow(other)) == pytest.approx((3.0, 3.5)), "ended already"
    player.play(1.0, 1.0)
    wait_for(lambda: world.tick() or elbow(other) > 1.2, "a moment")
    assert elbow(one) == elbow(other)


def test_robots_stand_beside_each_other_or_where_they_are():
    world = world_of("a", "b", "c")
    assert [r.state().base_pose[1] for r in world.robots] == [
        0,
        -DISTANCE,
        -2 * DISTANCE,
    ]
    world.arrange(beside=False)
    assert [r.state().base_pose[1] for r in world.robots] == [0, 0, 0]
    assert world.can_arrange and not world_of("a").can_arrange
    world.arrange(beside=True)
    pose = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0])
    world.robots[1].command_base(pose)
    assert_poses_close(world.robots[1].state().base_pose, pose, 1e-12)


def test_posing_pauses_the_motion():
    world = world_of("a")
    player = world.open(world.robots[0], ramp(60.0))
    player.play(0.0, 1.0)
    world.move(world.robots[0], {"elbow": 1.9}, 0.0)
    world.tick()
    assert not player.is_running
    assert elbow(world.robots[0]) == 1.9


def test_a_file_is_read_for_the_robot_that_shall_have_it():
    world = world_of("a")
    path, robot, rate = world.read(Path("walk.csv"), world.robots[0], 50.0)
    assert (path, rate) == (Path("walk.csv"), 50.0)
    assert robot is world.robots[0].description


def test_an_anchor_stays_while_joints_move_on_the_page_too():
    world = world_of("a")
    (robot,) = world.robots
    robot.set_anchor("arm")
    before = arm(robot)
    robot.command({"elbow": 1.25})
    assert robot.state().base_pose[6] < 0.95
    assert_poses_close(arm(robot), before, 1e-9)
    world.move(robot, {"elbow": 1.5}, 0.1)
    wait_for(lambda: robot.state() and not robot.is_moving, "the end")
    assert_poses_close(arm(robot), before, 1e-9)
    robot.command_base(np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]))
    moved = arm(robot)
    robot.command({"elbow": 0.5})
    assert_poses_close(arm(robot), moved, 1e-9)
    robot.take(ramp(1.0, 0.5, base=(5.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)), 0.7)
    assert robot.state().base_pose[0] == pytest.approx(5.7)
    moved = arm(robot)
    robot.take(ramp(1.0, 0.5), 1.2)
    assert_poses_close(arm(robot), moved, 1e-9)
    with pytest.raises(G1DescriptionError, match="profile of a has no feet"):
        robot.set_anchor("lowest_foot")
    assert robot.anchor == "arm"
    robot.set_anchor("")
    base = robot.state().base_pose
    robot.command({"elbow": 0.9})
    assert (robot.state().base_pose == base).all()


def arm(robot):
    """Place the arm by scipy."""
    state = robot.state()
    return forward_kinematics(BALL, state.base_pose, state.positions_by_name)["arm"]


def test_objects_are_carried_along_a_motion_and_by_hand():
    scene = Scene()
    scene.sphere("ball", 0.1, [0.5, 0.0, 0.3])
    scene.box("table", [1.0, 1.0, 0.1], [1.0, 0.0, 0.0])
    scene.attach("ball", "arm", 1.0, 2.0)
    robot = StillRobot("ball", parse_urdf(BALL))
    world = FileWorld([robot], None, scene)
    (shown,) = world.scenes

    def place(name="ball"):
        return shown.shown()[1][name][:3].tolist()

    player = world.open(robot, ramp(3.0, base=[0, 0, 0.3, 0, 0, 0, 1]))
    for at, x in ((0.0, 0.5), (1.0, 0.5), (1.5, 1.0), (2.0, 1.5), (3.0, 1.5)):
        player.show(at)
        assert place()[0] == pytest.approx(x)
    player.show(0.5)
    shown.attach("ball", "base")  # from now on; what was later is no more
    assert [(o.link, o.begin) for o in scene["ball"].attachments] == [("base", 0.5)]
    player.show(2.5)
    assert place() == pytest.approx([2.5, 0.0, 0.3])
    shown.move("ball", np.array([2.5, 1.0, 0.3, 0, 0, 0, 1]))
    assert place() == pytest.approx([2.5, 1.0, 0.3])
    player.show(0.0)
    assert place() == pytest.approx([0.5, 1.0, 0.3])
    assert place("table") == [1.0, 0.0, 0.0]
    # Without a motion, as people put it into the frame of the link.
    world.motions.clear()
    world.player = None
    shown.attach("ball", "")
    shown.attach("ball", "base")
    x, y, z = place()
    base = robot.state().base_pose
    base[0] += 1.0
    robot.command_base(base)
    assert place() == pytest.approx([x + 1.0, y, z])
    look = replace(scene["table"].link, name="brick")
    shown.change("ball", replace(scene["ball"], link=look))
    assert place("brick") == pytest.approx([x + 1.0, y, z])
    assert shown.carrier("brick") == "base"
    assert {*shown.shown()[1]} == {"table", "brick"}
    with pytest.raises(G1DescriptionError, match="wing"):
        FileWorld([robot], None, Scene([attached(scene["table"], "wing", 0.0, 1.0)]))
