"""Motions played in hold without ROS: what happened, against physics and numpy."""

import hashlib
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY
from scipy.integrate import solve_ivp
from worlds import Bench

from g1_description import Robot
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.files.uris import with_absolute_uris
from g1_description.motion.motion import Motion
from g1_description.motion.tracking import FallLimits
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf
from g1_description.sim import rollout as rollouts
from g1_description.sim.engine import PhysicsProperties
from g1_description.sim.motions import WATCH_TIME
from g1_description.sim.rollout import Conditions, rollout

pytestmark = pytest.mark.slow

ROWS = ("times", "desired", "positions", "velocities", "efforts", "base_poses")
WATCH = 1e-9 * WATCH_TIME
EVERY_STEP = Conditions(rate=1000.0)
G = 9.8
"""[m/s^2]"""


def body(name, mass, moment, *center, box=""):
    """Write a link with the same moment about all axes."""
    size = f'<collision><geometry><box size="{box}"/></geometry></collision>'
    return (
        f'<link name="{name}"><inertial><origin xyz="{center[0]} {center[1]} '
        f'{center[2]}"/><mass value="{mass}"/><inertia ixx="{moment}" iyy="{moment}" '
        f'izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial>{size if box else ""}'
        "</link>"
    )


def joint(name, parent, child, axis, effort):
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child '
        f'link="{child}"/><axis xyz="{axis}"/><limit lower="-3" upper="3" '
        f'effort="{effort}" velocity="50"/></joint>'
    )


def robot(*parts):
    return parse_urdf(f'<robot name="robot">{"".join(parts)}</robot>')


ARM_MASS, ARM_LENGTH, ARM_MOMENT, EFFORT = 2.0, 0.5, 0.1, 20.0
LIFT, TURN = "lift_joint", "turn_joint"
CRANE = robot(
    '<link name="world"/>',
    body("turret", 1.0, 0.05, 0, 0, 0),
    joint(TURN, "world", "turret", "0 0 1", EFFORT),
    body("arm", ARM_MASS, ARM_MOMENT, ARM_LENGTH, 0, 0),
    joint(LIFT, "turret", "arm", "0 1 0", EFFORT),
)
"""Fixed to the world: an arm that turns about the vertical and is lifted."""

FOOT, TOE, FOOT_HEIGHT = 5.0, 0.1, 0.02
FOOT_MOMENT = 0.05
POLE_MASS, POLE_LENGTH, POLE_MOMENT = 10.0, 1.0, 0.1
ANKLE = "ankle_joint"
STILTS = robot(
    body("foot", FOOT, FOOT_MOMENT, 0, 0, 0, box=f"{2 * TOE} {2 * TOE} {FOOT_HEIGHT}"),
    body("pole", POLE_MASS, POLE_MOMENT, 0, 0, POLE_LENGTH),
    joint(ANKLE, "foot", "pole", "0 1 0", 1000),
)
"""A foot, the root, and a pole on it."""


def motion(positions, names, seconds=1.0, bases=None):
    """Go through positions at even times."""
    table = np.array(positions, dtype=float).reshape(-1, len(names))
    times = np.linspace(0.0, seconds, len(table))
    return Motion(times, tuple(names), table, base_poses=bases)


def crane_motion():
    """Stand still for 0.3 s, then turn at once by a radian in 0.1 s."""
    times = np.array([0.0, 0.3, 0.4, 0.6])
    table = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    return Motion(times, (TURN, LIFT), table)


def standing(lean=0.0, seconds=1.0, height=0.0, yaw=0.0):
    """Hold the pole of the stilts in a lean; the base stands as high as given."""
    pose = [1.0, 2.0, height, 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)]
    return motion([lean, lean], [ANKLE], seconds, np.array([pose, pose]))


@pytest.fixture(scope="module")
def turned():
    return rollout(CRANE, crane_motion(), EVERY_STEP)


def digest(result):
    """Sum up all bits of what happened."""
    arrays = [getattr(result, name) for name in ROWS]
    report = result.report
    arrays += [report.rms_errors, report.largest_errors, report.limit_shares]
    arrays += [report.largest_error_times, report.first_limit_times]
    arrays += [np.array([report.fall_time or math.nan, result.lift])]
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()


def g1_steps():
    """Let the G1 lift a knee, fast and out of balance, until it has fallen."""
    file = REPOSITORY / "urdf" / "g1_29dof.urdf"
    g1 = parse_urdf(with_absolute_uris(file.read_text(), file.parent))
    names = ("left_hip_pitch_joint", "left_knee_joint")
    lifted = motion([[0.0, 0.0], [-1.0, 1.5], [-1.0, 1.5]], names, 0.5)
    coarse = PhysicsProperties(time_step=0.004)
    return rollout(g1, lifted, Conditions(properties=coarse))


def test_the_same_motion_gives_the_same_bits_in_any_process():
    """Also after other motions."""
    rollout(STILTS, standing(), EVERY_STEP)
    first = g1_steps()
    assert first.fell_at is not None
    program = "import test_rollout as t; print(t.digest(t.g1_steps()))"
    folders = [str(Path(__file__).parent), str(REPOSITORY / "test"), *sys.path]
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:] = {folders!r}; {program}"],
        stdout=subprocess.PIPE,
        check=True,
    )
    assert done.stdout.decode().strip() == digest(first)


def test_the_report_is_what_the_rows_say(turned):
    n_steps = round(turned.report.duration / 1e-3) + 1
    assert turned.report.duration == pytest.approx(0.6, abs=2e-3)
    steps = turned.times[:n_steps]
    np.testing.assert_allclose(steps, 1e-3 * np.arange(1, n_steps + 1), rtol=1e-12)
    errors = (turned.positions - turned.desired)[:n_steps]
    at_limit = np.isclose(np.abs(turned.efforts[:n_steps]), EFFORT, rtol=1e-3)
    report = turned.report
    np.testing.assert_allclose(report.rms_errors, np.sqrt((errors**2).mean(axis=0)))
    np.testing.assert_array_equal(report.largest_errors, np.abs(errors).max(axis=0))
    turn, lift = (turned.joint_names.index(name) for name in (TURN, LIFT))
    worst = steps[np.abs(errors[:, turn]).argmax()]
    assert report.largest_error_times[turn] == worst
    assert not errors[:, lift].any()
    assert np.isnan(report.largest_error_times[lift])
    np.testing.assert_allclose(report.limit_shares, at_limit.mean(axis=0))


def test_a_motion_too_fast_for_its_motor_is_found_with_joint_and_time(turned):
    row = turned.joint_names.index(TURN)
    assert turned.report.first_limit_times[row] == pytest.approx(0.3, abs=2e-3)
    assert turned.report.limit_shares[row] > 0.05
    other = turned.joint_names.index(LIFT)
    assert np.isnan(turned.report.first_limit_times[other])
    assert turned.report.limit_shares[other] == 0.0
    assert np.abs(turned.efforts).max() <= EFFORT * (1.0 + 1e-6)
    np.testing.assert_array_equal(turned.effort_limits, [EFFORT, EFFORT])


def test_a_motor_applies_what_newton_says():
    """Held level against gravity, then turned at a constant acceleration."""
    times, pull = np.linspace(0.0, 0.5, 251), 8.0
    table = np.stack([0.5 * pull * times**2, np.zeros(251)], axis=1)
    speeds = np.stack([pull * times, np.zeros(251)], axis=1)
    way = Motion(times, (TURN, LIFT), table, speeds)
    result = rollout(CRANE, way, EVERY_STEP)
    late = (result.times > 0.2) & (result.times < 0.49)
    turn, lift = (result.joint_names.index(name) for name in (TURN, LIFT))
    held = result.efforts[late, lift]
    np.testing.assert_allclose(np.abs(held), ARM_MASS * G * ARM_LENGTH, rtol=0.02)
    moment = 0.05 + ARM_MOMENT + ARM_MASS * ARM_LENGTH**2
    assert result.efforts[late, turn].mean() == pytest.approx(moment * pull, rel=0.02)
    errors = (result.positions - result.desired)[late]
    assert np.abs(errors).max() < 0.005  # without velocities it lags by 10 ms


def test_it_tells_what_the_stand_in_tells(turned):
    """The calls of the node and its services, on a robot of the same positions."""
    world = Bench("hold")
    pose = np.array([0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 1.0])
    world.spawn("crane", lump_fixed_joints(CRANE), pose)
    world.motions.play(world.model("crane"), crane_motion(), world.time_ns)
    world.run(0.6 + WATCH + 0.01)
    (tracked,) = world.motions.take_tracked()
    world.close()
    for name in ("rms_errors", "largest_errors", "limit_shares", "duration"):
        np.testing.assert_array_equal(
            getattr(tracked.report, name), getattr(turned.report, name), name
        )


def tipping_time(lean, angle):
    """Compute when a rigid body turns by an angle about the stilts' toe."""
    offset = np.array([POLE_LENGTH * math.sin(lean), POLE_LENGTH * math.cos(lean)])
    edge = np.array([-TOE, FOOT_HEIGHT / 2.0])
    center = POLE_MASS * (offset + edge)
    center = (center + FOOT * edge) / (POLE_MASS + FOOT)
    distance, start = np.linalg.norm(center), math.atan2(center[0], center[1])
    pole = np.linalg.norm(offset + edge)
    foot = np.linalg.norm(edge)
    moment = POLE_MASS * pole**2 + POLE_MOMENT + FOOT * foot**2 + FOOT_MOMENT

    def move(_, state):
        torque = (POLE_MASS + FOOT) * G * distance * math.sin(state[0])
        return [state[1], torque / moment]

    def arrive(_, state):
        return state[0] - start - angle

    arrive.terminal = True
    way = solve_ivp(move, (0.0, 9.0), [start, 0.0], events=arrive, rtol=1e-8)
    return way.t_events[0][0]


@pytest.mark.parametrize(
    ("lean", "angle", "yaw"), [(0.2, 0.3, 0.0), (0.3, math.pi / 4.0, 2.0)]
)
@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_what_leans_too_far_falls_when_an_inverted_pendulum_does(
    lean, angle, yaw, engine
):
    limits = Conditions(fall_limits=FallLimits(lean=angle), engine=engine)
    result = rollout(STILTS, standing(lean, 2.0, yaw=yaw), limits)
    assert result.fell_at == pytest.approx(tipping_time(lean, angle), rel=0.05)
    assert result.times[-1] == pytest.approx(result.fell_at, abs=1e-9)
    assert result.report.duration == pytest.approx(result.fell_at, abs=2e-3)


def test_a_limit_that_is_just_not_reached_hides_a_fall():
    """The foot lies flat after it has tipped over; no limit means no fall."""
    never = FallLimits(lean=math.pi, drop=math.inf)
    whole = rollout(STILTS, standing(0.3), Conditions(fall_limits=never))
    assert whole.fell_at is None
    assert whole.times[-1] > 1.9
    way = standing(0.0, 1.0, 0.2)
    way.base_poses[1, 2] += 0.1  # it rises, the robot does not
    for drop, time in ((0.05, 0.5), (0.11, None)):
        limits = Conditions(fall_limits=FallLimits(drop=drop))
        fell = rollout(STILTS, way, limits).fell_at
        assert (fell is None) == (time is None)
        assert time is None or fell == pytest.approx(time, abs=0.02)


def test_it_begins_on_the_floor_however_high_the_motion_is():
    """Unless it is to begin where the motion is."""
    height = 0.3
    low, high = (rollout(STILTS, standing(0.05, 0.1, z)) for z in (0.0, height))
    assert high.lift == pytest.approx(low.lift - height)
    np.testing.assert_array_equal(low.positions, high.positions)
    np.testing.assert_array_equal(low.base_poses, high.base_poses)
    np.testing.assert_allclose(high.desired_base_poses, low.desired_base_poses)
    np.testing.assert_allclose(high.desired_base_poses, high.base_poses, atol=2e-3)
    above = rollout(STILTS, standing(0.0, 0.1, 0.5), Conditions(on_floor=False))
    assert above.lift == 0.0
    assert above.base_poses[0, 2] == pytest.approx(0.5, abs=1e-3)


def test_a_base_that_is_fixed_stays_and_never_falls():
    conditions = Conditions(fixed_base=True)
    result = rollout(STILTS, standing(1.5), conditions)
    assert result.fell_at is None
    assert np.ptp(result.base_poses, axis=0).max() == 0.0
    assert result.base_poses[0, 2] > 1.4 * TOE  # a corner cannot come to the floor
    torque = result.efforts[-1, 0]
    wanted = POLE_MASS * G * POLE_LENGTH * math.sin(1.5)
    assert abs(torque) == pytest.approx(wanted, rel=0.01)


def test_joints_that_only_the_motion_has_are_ignored_and_others_are_held():
    other = motion([[0.0, 0.0], [0.2, 0.9]], [TURN, "tail_joint"], 0.2)
    same = rollout(CRANE, motion([0.0, 0.2], [TURN], 0.2))
    assert digest(rollout(CRANE, other)) == digest(same)
    assert same.joint_names == same.report.joint_names == (TURN, LIFT)
    assert np.abs(same.positions[:, 1]).max() < 1e-3
    np.testing.assert_array_equal(same.desired[-1], [0.2, 0.0])
    with pytest.raises(InvalidValueError, match="no joint of robot"):
        rollout(CRANE, motion([0.0, 1.0], ["tail_joint"]))


def test_a_motion_of_a_base_is_refused_where_the_base_is_the_world():
    with pytest.raises(InvalidValueError, match="fixed to the world"):
        bases = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
        rollout(CRANE, motion([0.0, 1.0], [TURN], bases=bases))


def test_a_single_configuration_is_held():
    pose = np.array([[0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]])
    single = Motion(np.zeros(1), (ANKLE,), np.array([[0.3]]), base_poses=pose)
    assert rollout(STILTS, single).fell_at == pytest.approx(
        tipping_time(0.3, math.pi / 4.0), rel=0.03
    )


def test_times_are_those_of_the_motion(turned):
    late = replace(crane_motion(), times=crane_motion().times + 5.0)
    result, early = rollout(CRANE, late, EVERY_STEP), turned
    np.testing.assert_allclose(result.times, early.times + 5.0)
    np.testing.assert_allclose(result.positions, early.positions, atol=1e-9)
    first = result.report.first_limit_times[0]
    assert first == pytest.approx(early.report.first_limit_times[0] + 5.0)


def test_what_begins_before_zero_is_refused():
    early = replace(crane_motion(), times=crane_motion().times - 0.001)
    with pytest.raises(InvalidValueError, match=r"before 0 s .got -0\.001 s"):
        rollout(CRANE, early)


def test_a_joint_without_a_limit_has_none():
    free = '<joint name="free_joint" type="continuous"><parent link="turret"/>'
    free += '<child link="wheel"/><axis xyz="0 0 1"/></joint>'
    turret = joint(TURN, "world", "turret", "0 0 1", EFFORT)
    bodies = [body(name, 1.0, 0.05, 0, 0, 0) for name in ("turret", "wheel")]
    wheel = robot('<link name="world"/>', *bodies, turret, free)
    result = rollout(wheel, motion([0.0, 0.1], [TURN]))
    np.testing.assert_array_equal(result.effort_limits, [EFFORT, math.inf])
    assert not result.report.limit_shares[1]


def test_rows_are_as_many_as_wanted_and_never_more(monkeypatch):
    still = motion([0.0, 0.0], [LIFT], 0.1)
    result = rollout(CRANE, still, Conditions(rate=50.0))
    np.testing.assert_allclose(result.times, 0.02 * np.arange(1, 56))
    monkeypatch.setattr(rollouts, "MAX_ROWS", 10)
    few = rollout(CRANE, still, EVERY_STEP)
    assert 5 <= len(few.times) == len(few.efforts) <= 10
    np.testing.assert_array_equal(few.report.rms_errors, result.report.rms_errors)


def refusal_of_mujoco(monkeypatch):
    """Return what is said where its library cannot be imported."""
    monkeypatch.delitem(sys.modules, "g1_description.sim.mujoco.engine", False)
    with pytest.raises(UnknownNameError) as caught:
        Conditions(engine="mujoco")
    return str(caught.value)


def test_an_engine_that_is_not_installed_is_told_with_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    refusal = refusal_of_mujoco(monkeypatch)
    assert refusal.startswith("The engine mujoco needs mujoco; install it ")
    with pytest.raises(UnknownNameError, match="'ode'; must be one of bullet, mujoco"):
        Conditions(engine="ode")


def test_an_engine_whose_library_is_broken_is_told(monkeypatch, tmp_path):
    (tmp_path / "mujoco.py").write_text("raise ImportError('libmujoco.so: bad ELF')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mujoco", False)
    assert refusal_of_mujoco(monkeypatch) == (
        "The library of the engine mujoco is broken: libmujoco.so: bad ELF."
    )


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_a_robot_squats_and_stands_on_either_engine(engine):
    """In a second each, within two millimetres of where it began."""
    robot = Robot()
    squat = robot.read_motion("squat.csv").at_speed(3.0)
    result = rollout(robot.description, squat, Conditions(engine=engine))
    assert result.fell_at is None
    assert result.base_poses[:, 2].min() < 0.55
    moved = result.base_poses[-1, :3] - result.desired_base_poses[-1, :3]
    assert np.abs(moved).max() < 0.002


@pytest.mark.parametrize("rate", [0.0, math.nan, math.inf])
def test_conditions_that_make_no_sense_are_refused(rate):
    with pytest.raises(InvalidValueError, match="rate"):
        Conditions(rate=rate)
    with pytest.raises(InvalidValueError, match="time_step"):
        Conditions(properties=PhysicsProperties(time_step=0.0))
