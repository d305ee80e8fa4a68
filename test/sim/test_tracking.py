"""Motors that follow motions in hold: what the joints do, and what is told of it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import PROFILE
from worlds import OUR_G1, Bench

from g1_description.motion.edit import minimum_jerk_trajectory
from g1_description.motion.motion import Motion, sample
from g1_description.motion.motors import Motors, ServoMotor
from g1_description.motion.tracking import FallLimits
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.poses import parse_poses
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.motions import WATCH_TIME
from g1_description.sim.standing import hanging_height, standing_height

pytestmark = pytest.mark.slow

POSES = parse_poses(
    (PROFILE / "poses.yaml").read_text(),
    "poses.yaml",
)
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
ELBOW, KNEE = "left_elbow_joint", "left_knee_joint"
WATCH = 1e-9 * WATCH_TIME


def spawned(world, text, pose="zero", fixed=False):
    """Spawn a robot in a pose, standing on the floor or hanging clear of it."""
    robot = lump_fixed_joints(parse_urdf(text))
    robot = replace(robot, positions=POSES[pose].positions)
    height = hanging_height if fixed else standing_height
    z = height(robot, UPRIGHT)
    world.spawn("g1", robot, np.array([0.0, 0.0, z, *UPRIGHT]), fixed)
    return world.model("g1")


def positions_of(model, pose):
    return np.array([POSES[pose].positions.get(n, 0.0) for n in model.joint_names])


def go(world, model, pose, seconds):
    """Go to a pose as the command does, from where the joints are."""
    goal = positions_of(model, pose)
    way = minimum_jerk_trajectory(model.joint_names, model.position, goal, seconds)
    return play(world, model, way)


def play(world, model, motion, also=0.0):
    """Let the motors follow a motion to its end; return the errors at each step."""
    start = world.time_ns + 1_000_000
    world.motions.play(model, motion, start)
    errors = []
    for _ in range(round((motion.end + also) * 1e3) + 1):
        world.step()
        wanted = sample(motion, 1e-9 * (world.time_ns - start)).positions
        errors.append(model.position[model.joint_rows(motion.joint_names)] - wanted)
    return np.array(errors)


def rms(errors):
    return np.sqrt((errors**2).mean(axis=0))


def test_arms_of_a_hanging_robot_follow_within_two_hundredths_rms(make_world):
    world = make_world("hold")
    model = spawned(world, OUR_G1, fixed=True)
    errors = go(world, model, "hands_up", 1.0)
    assert rms(errors).max() < 0.005
    assert np.abs(errors).max() < 0.02


def elbow(seconds=0.5, end=1.0, joint=ELBOW):
    way = minimum_jerk_trajectory([joint], np.zeros(1), np.array([end]), seconds)
    return way


LIMBS = f"""<robot name="limbs"><link name="world"/>{
    "".join(
        f'''<link name="{name}"><inertial><mass value="0.5"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    </link><joint name="{name}" type="revolute"><parent link="world"/>
    <child link="{name}"/>
    <axis xyz="0 1 0"/><origin xyz="0 0 2"/>
    <limit lower="-2" upper="2" effort="25" velocity="20"/></joint>'''
        for name in (ELBOW, KNEE)
    )
}</robot>"""


@pytest.fixture
def hanging(make_world):
    world = make_world("hold")
    world.spawn_urdf("limbs", LIMBS, np.array([0.0, 0.0, 0.0, *UPRIGHT]))
    return world, world.model("limbs")


def test_the_report_is_what_the_joints_did(hanging):
    """Without velocities the joint would be behind by its speed times 10 ms."""
    world, model = hanging
    start = world.time_ns + 1_000_000
    fastest = np.abs(elbow().velocities).max()
    assert fastest == pytest.approx(3.75, abs=0.01)
    errors = play(world, model, elbow())
    assert np.abs(errors).max() < 0.002 * fastest
    world.run(0.9 * WATCH)
    assert world.motions.take_tracked() == []  # the base is still watched
    world.run(0.1 * WATCH)
    (tracked,) = world.motions.take_tracked()
    assert (tracked.model.name, tracked.start_ns) == ("limbs", start)
    report = tracked.report
    assert report.joint_names == (ELBOW,)
    np.testing.assert_allclose(report.rms_errors, rms(errors), rtol=1e-9)
    np.testing.assert_allclose(report.largest_errors, np.abs(errors).max(axis=0))
    assert report.duration == pytest.approx(0.5)
    assert not report.limit_shares.any()
    assert report.fall_time is None
    assert world.motions.take_tracked() == []


def test_the_jump_to_a_motion_is_not_its_largest_error(hanging):
    world, model = hanging
    way = elbow()
    errors = play(world, model, replace(way, positions=way.positions + 0.36), WATCH)
    (tracked,) = world.motions.take_tracked()
    assert np.abs(errors).max() > 0.3
    assert tracked.report.largest_errors[0] <= 0.01
    assert tracked.report.largest_error_times[0] > 0.005
    assert tracked.report.limit_shares[0] > 0.0


KNEE_ONLY = """
<robot name="{name}">
  <link name="world"/>
  <link name="shin"><inertial><mass value="2"/><origin xyz="0.3 0 0"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="left_knee_joint" type="revolute"><parent link="world"/>
    <child link="shin"/><axis xyz="0 1 0"/><origin xyz="0 0 2"/>
    <limit lower="-2" upper="2" effort="{effort}" velocity="20"/></joint>
</robot>"""


def knee(motors, name="h1", effort=300.0):
    """Spawn a robot with a knee alone; return what was said of it, too."""
    world = Bench("hold", motors=motors)
    robot = lump_fixed_joints(parse_urdf(KNEE_ONLY.format(name=name, effort=effort)))
    notes = world.spawn(name, robot, np.array([0.0, 0.0, 0.0, *UPRIGHT]))
    return world, world.model(name), " ".join(notes)


@pytest.mark.parametrize(("name", "limit"), [("", 300.0), ("g1_29dof_rev_1_0", 139.0)])
def test_motors_are_those_of_the_profile(name, limit):
    """Whatever the joints are called."""
    world, model, notes = knee(None, name)
    np.testing.assert_array_equal(world.engine.effort_limits(model), limit)
    assert notes == ""
    world.close()


@pytest.mark.parametrize(("effort", "share"), [(2.0, 0.5), (0.0, None)])
def test_a_weak_motor_is_at_its_limit_and_told_and_no_motor_is_not(effort, share):
    """Motors that are given drive any robot."""
    world, model, notes = knee(Motors({".*": ServoMotor(effort=effort)}))
    np.testing.assert_array_equal(world.engine.effort_limits(model), effort)
    assert notes == ""
    errors = play(world, model, elbow(joint="left_knee_joint"), WATCH)
    (tracked,) = world.motions.take_tracked()
    assert np.abs(errors).max() > 0.3
    assert tracked.report.largest_errors[0] > 0.3
    assert tracked.report.limit_shares[0] > share if share else True
    assert share or tracked.report.limit_shares[0] == 0.0
    world.close()


@pytest.mark.parametrize("given", [math.inf, 40.0])
def test_an_effort_of_zero_is_unknown_and_the_motor_holds(given):
    """Exporters write 0 where they know none; a file of motors may know more."""
    world, model, notes = knee(Motors({".*": ServoMotor(effort=given)}), "h1", 0.0)
    np.testing.assert_array_equal(world.engine.effort_limits(model), given)
    play(world, model, elbow(joint="left_knee_joint"), WATCH)
    (tracked,) = world.motions.take_tracked()
    assert tracked.report.largest_errors[0] < 0.01
    assert tracked.report.limit_shares[0] == 0.0
    assert ("left_knee_joint" in notes) == (given == math.inf)
    world.close()


def with_base(model, *poses):
    """Make a motion that stands still while its base goes through poses in 1 s."""
    names = model.joint_names
    positions = np.tile(model.position, (len(poses), 1))
    times = np.linspace(0.0, 1.0, len(poses))
    return Motion(times, names, positions, base_poses=np.array(poses))


def test_a_robot_whose_motion_rises_without_it_fell(make_world):
    """It stands where it was; limits are kept when the world is reset."""
    world = make_world("hold")
    model = spawned(world, OUR_G1, "stand")
    world.motions.fall_limits = FallLimits(drop=0.05)
    world.reset()
    above = model.pose + np.array([5.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0])
    motion = with_base(model, model.pose + np.eye(7)[0] * 5.0, above)
    world.motions.play(model, motion, world.time_ns)
    world.run(0.13)
    assert world.motions.tracker(model).has_fallen
    fall_time = world.motions.tracker(model).report.fall_time
    assert fall_time == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize("how", ["replaced", "stopped", "reset", "gone", "limbs"])
def test_a_motion_that_ends_early_is_told_as_far_as_it_went(hanging, how):
    world, model = hanging
    world.motions.play(model, elbow(), world.time_ns)
    world.run(0.2)
    if how == "replaced":
        world.motions.play(model, elbow(0.1, 0.5), world.time_ns)
    elif how == "stopped":
        world.motions.stop(model)
    elif how == "reset":
        world.reset()
    elif how == "gone":
        world.delete("limbs")
    else:
        world.motions.play(model, elbow(0.1, 0.5, KNEE), world.time_ns)
    world.run(0.3 + WATCH)
    told = [round(one.report.duration, 2) for one in world.motions.take_tracked()]
    wanted = {"replaced": [0.2, 0.1], "stopped": [0.2], "limbs": [0.1, 0.5]}
    assert told == pytest.approx(wanted.get(how, []), abs=0.01)
