"""Each fault of a motion is found, at its time and with its size, and nothing else."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from g1_description import Robot
from g1_description.checks.checker import Checker
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.checks.thresholds_file import with_thresholds
from g1_description.collisions.find_pairs import collisions_of
from g1_description.errors import (
    AllowedPairsError,
    MotionError,
    ThresholdError,
)
from g1_description.motion.motion import Motion
from g1_description.robot.load import read_absolute
from g1_description.robot.rotation import from_axis_angle, multiply
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.standing import lowest_height

MODEL = Path(__file__).parents[2] / "urdf" / "g1_29dof.urdf"
ROBOT = parse_urdf(read_absolute(str(MODEL)).text)
JOINTS = tuple(joint.name for joint in ROBOT.movable_joints)
COLLISIONS = collisions_of(ROBOT)
RATE = 60.0
TIMES = np.arange(181) / RATE


def column(name):
    return JOINTS.index(f"{name}_joint")


def bump(begin, end):
    """Rise smoothly from 0 to 1 and back, between two times."""
    phase = np.clip((TIMES - begin) / (end - begin), 0.0, 1.0)
    return np.sin(np.pi * phase) ** 4


def standing():
    """Stand with arms away from the body, and swing an arm slowly."""
    positions = np.zeros((len(TIMES), len(JOINTS)))
    positions[:, column("left_shoulder_roll")] = 0.4
    positions[:, column("right_shoulder_roll")] = -0.4
    positions[:, column("left_elbow")] = 0.3 * bump(0.2, 2.8)
    return positions


def motion(positions, base=None, lift=True):
    """Put a motion onto the floor."""
    if base is None:
        base = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(TIMES), 1))
    trajectory = Motion(TIMES, JOINTS, positions, base_poses=base)
    if lift:
        base = base.copy()
        base[:, 2] -= lowest_height(ROBOT, trajectory)
        trajectory = replace(trajectory, base_poses=base)
    return trajectory


def beyond_a_limit():
    positions, elbow = standing(), column("left_elbow")
    upper = ROBOT.movable_joints[elbow].upper
    positions[:, elbow] = (upper + 0.01) * bump(0.2, 2.2)
    return motion(positions)


def too_fast():
    positions, wrist = standing(), column("left_wrist_yaw")
    limit = ROBOT.movable_joints[wrist].velocity
    phase = 10 * np.pi * (TIMES - 1.0)
    swing = np.where((TIMES > 1.0) & (TIMES < 1.2), 1.0 - np.cos(phase), 0.0)
    positions[:, wrist] = (swing - 1.0) * 1.2 * limit / (10 * np.pi)
    return motion(positions)


def jumping():
    positions = standing()
    positions[TIMES >= 1.2, column("right_wrist_roll")] = 0.5
    return motion(positions)


def arm_in_torso():
    positions = standing()
    positions[:, column("right_shoulder_roll")] += 0.9 * bump(0.5, 2.5)
    positions[:, column("right_shoulder_yaw")] += 0.9 * bump(0.5, 2.5)
    return motion(positions)


def sunken(depth=0.02):
    found = motion(standing())
    base = found.base_poses.copy()
    base[:, 2] -= depth
    return motion(standing(), base, lift=False)


def skating():
    base = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(TIMES), 1))
    base[:, 0] = 0.5 * TIMES
    return motion(standing(), base)


def drifting():
    base = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(TIMES), 1))
    base[:, 0] = 0.06 * TIMES / TIMES[-1]
    return motion(standing(), base)


def floating():
    found = motion(standing())
    base = found.base_poses.copy()
    base[:, 2] += 0.05
    return motion(standing(), base, lift=False)


def base_jumping():
    base = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(TIMES), 1))
    base[TIMES >= 1.2, 1] = 0.05
    return motion(standing(), base)


def leaning(beyond):
    """Lean back on flat feet until the centre of mass is so far behind the heels."""
    positions = standing()
    low, high = -0.4, 0.0
    for _ in range(12):
        angle = (low + high) / 2
        positions[:, column("left_ankle_pitch")] = -angle
        positions[:, column("right_ankle_pitch")] = -angle
        base = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(TIMES), 1))
        base[:, 3:] = from_axis_angle(np.array([0.0, 1, 0]), np.full(len(TIMES), angle))
        found = motion(positions, base)
        if outside(found) > beyond:
            low = angle
        else:
            high = angle
    return found


def imported_pinocchio():
    reason = "pinocchio is not there, as its wheels need numpy 1.23"
    return pytest.importorskip("pinocchio", reason=reason)


@lru_cache(maxsize=None)
def floating_model(pinocchio):
    return pinocchio.buildModelFromUrdf(str(MODEL), pinocchio.JointModelFreeFlyer())


def outside(found):
    """Measure with Pinocchio and scipy how far a robot leans behind its soles."""
    pinocchio = imported_pinocchio()
    model = floating_model(pinocchio)
    data = model.createData()
    trajectory = found
    q = np.concatenate([trajectory.base_poses[0], trajectory.positions[0]])
    center = pinocchio.centerOfMass(model, data, q)
    pinocchio.updateFramePlacements(model, data)
    soles = []
    for side in ("left", "right"):
        name = f"{side}_ankle_roll_link"
        place = data.oMf[model.getFrameId(name)]
        link = ROBOT.links[ROBOT.link_names.index(name)]
        soles += [place.act(shape.pose[:3])[:2] for shape in link.collisions]
    equations = ConvexHull(np.array(soles)).equations
    return float((equations[:, :2] @ center[:2] + equations[:, 2]).max())


FAULTS = {
    "position": (beyond_a_limit, ("left_elbow_joint",), 0.01, 1.2),
    "velocity": (too_fast, ("left_wrist_yaw_joint",), 1.16, None),
    "jump": (jumping, ("right_wrist_roll_joint",), 0.5, 1.2),
    "penetration": (sunken, ("left_ankle_roll_link",), 0.02, 0.0),
    "skating": (skating, ("left_ankle_roll_link",), 0.5, 0.0),
    "drift": (drifting, ("left_ankle_roll_link",), 0.06, TIMES[-1]),
    "contact_forces": (floating, (), 1.0, None),
    "base_jump": (base_jumping, ("base",), 0.05, 1.2),
    "center_of_mass": (lambda: leaning(0.01), (), 0.01, None),
}
"""By check: the motion, whose fault it is, its size, and when it is largest."""


def check(found, thresholds=None, only=()):
    return Checker(ROBOT, thresholds, collisions=COLLISIONS).check(found, only)


def test_a_clean_motion_has_no_findings():
    verdict = check(motion(standing()))
    assert verdict.findings == ()
    assert verdict.passed
    assert "deepest_self_collision" in verdict.figures
    assert {*verdict.skipped} == {"collision", "clearance", "grasp"}
    assert {*verdict.floor_contacts} == {
        "left_ankle_roll_link",
        "right_ankle_roll_link",
    }
    assert verdict.floor_contacts["left_ankle_roll_link"] == ((0.0, TIMES[-1]),)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_found_and_nothing_else_and_a_threshold_beyond_hides_it(name):
    make, subject, size, time = FAULTS[name]
    found = make()
    verdict = check(found)
    assert {finding.check for finding in verdict.findings} == {name}
    finding = next(f for f in verdict.findings if f.subject == subject)
    assert finding.severity == "failed"
    assert finding.worst == pytest.approx(size, rel=0.03)
    if time is not None:
        assert finding.worst_time == pytest.approx(time, abs=0.5 / RATE + 1e-9)
    assert not verdict.passed
    largest = max(f.worst for f in verdict.findings)
    hidden = Thresholds({name: Level(None, largest * 1.001)})
    assert check(found, hidden, [name]).findings == ()
    shown = Thresholds({name: Level(None, largest * 0.999)})
    assert check(found, shown, [name]).findings != ()


def test_an_arm_in_the_torso_is_found_and_nothing_else():
    verdict = check(arm_in_torso())
    assert {finding.check for finding in verdict.findings} == {"self_collision"}
    for finding in verdict.findings:
        assert any("right" in name for name in finding.subject)
        assert finding.worst_time == pytest.approx(1.5, abs=0.3)
        assert finding.severity in ("failed", "warning")
        assert len(finding.points) == 2
    assert not verdict.passed


def test_a_robot_may_leave_the_floor_if_it_falls():
    base = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(TIMES), 1))
    flight = np.clip(TIMES - 1.0, 0.0, 0.6)
    found = motion(standing(), base)
    base = found.base_poses.copy()
    base[:, 2] += 9.8 / 2 * flight * (0.6 - flight)
    only = ["contact_forces"]
    verdict = check(motion(standing(), base, lift=False), only=only)
    assert verdict.findings == ()
    base[:, 2] = found.base_poses[:, 2] + 2.0 * flight * (0.6 - flight)
    verdict = check(motion(standing(), base, lift=False), only=only)
    assert "the robot needs" in verdict.findings[0].text


def test_the_time_between_samples_far_apart_is_checked():
    """An arm goes through the torso between two way points."""
    ends = np.zeros((2, len(JOINTS)))
    roll, yaw = column("left_shoulder_roll"), column("left_shoulder_yaw")
    ends[0, roll], ends[1, roll] = 0.4, -0.4
    ends[0, yaw], ends[1, yaw] = 0.3, -2.0
    found = Motion(np.array([0.0, 2.0]), JOINTS, ends)
    verdict = check(found, only=["self_collision"])
    assert verdict.of("self_collision")
    assert any(0.0 < finding.first_time < 2.0 for finding in verdict.findings)


def test_a_foot_that_steps_does_not_skate():
    """A cycloid moves along the floor a little on its first and last millimetres."""
    share = np.clip((TIMES - 1.0) / 0.5, 0.0, 1.0)
    forward = share - np.sin(2 * np.pi * share) / (2 * np.pi)
    base = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(TIMES), 1))
    found = motion(standing(), base)
    base = found.base_poses.copy()
    base[:, 0] = 0.3 * forward
    base[:, 2] += 0.025 * (1.0 - np.cos(2 * np.pi * share))
    stepping = motion(standing(), base, lift=False)
    assert check(stepping, only=["skating", "drift"]).findings == ()
    base[:, 2] = found.base_poses[:, 2]
    sliding = check(motion(standing(), base, lift=False), only=["skating"])
    assert {finding.severity for finding in sliding.findings} == {"failed"}
    (first, *_) = sliding.findings
    assert 1.0 < first.first_time < 1.2
    assert first.worst == pytest.approx(1.2, rel=0.1)


def test_a_drift_is_when_the_foot_moves_not_after_it():
    base = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(TIMES), 1))
    base[:, 0] = 0.06 * np.clip((TIMES - 0.5) / 1.0, 0.0, 1.0)
    left, _ = check(motion(standing(), base), only=["drift"]).findings
    ((begin, end),) = left.intervals
    assert (begin, end) == pytest.approx((0.5, 1.5), abs=0.06)
    assert left.worst == pytest.approx(0.06, rel=0.05)


def test_a_foot_that_is_lifted_and_put_down_does_not_hover():
    """Its leg bends; the other one stands."""
    positions = standing()
    phase = np.clip((TIMES - 0.5) / 0.8, 0.0, 1.0)
    bend = 0.5 * (1.0 - np.cos(2.0 * np.pi * phase))
    for joint, angle in (("hip_pitch", -0.5), ("knee", 1.0), ("ankle_pitch", -0.5)):
        positions[:, column(f"right_{joint}")] += angle * bend
    found = check(motion(positions), only=["floating"])
    assert found.findings == ()
    assert found.floor_contacts["left_ankle_roll_link"] == ((0.0, TIMES[-1]),)
    assert len(found.floor_contacts["right_ankle_roll_link"]) == 2


def test_a_skating_foot_does_not_drift_unless_skating_is_not_checked():
    assert check(skating(), only=["drift"]).findings == ()
    thresholds = with_thresholds(
        Thresholds(), {"skating": {"warning": None, "failure": None}}
    )
    (left, _) = check(skating(), thresholds, ["drift"]).findings
    assert left.worst == pytest.approx(0.5 * TIMES[-1], rel=0.01)


@pytest.mark.parametrize(
    ("make", "rate"),
    [(jumping, 20.0), (jumping, 120.0), (base_jumping, 25.0), (base_jumping, 50.0)],
)
def test_a_jump_is_found_at_any_rate(make, rate):
    """Between samples far apart the motion is judged, too, but nothing jumps there."""
    times = np.arange(round(3.0 * rate) + 1) / rate
    positions = np.zeros((len(times), len(JOINTS)))
    positions[:, column("left_shoulder_roll")] = 0.4
    positions[:, column("right_shoulder_roll")] = -0.4
    base = np.tile(motion(standing()).base_poses[0], (len(times), 1))
    if make is jumping:
        positions[times > 1.19, column("right_wrist_roll")] = 0.5
    else:
        base[times > 1.19, 1] = 0.3
    found = Motion(times, JOINTS, positions, base_poses=base)
    verdict = check(found)
    name = "jump" if make is jumping else "base_jump"
    assert {finding.check for finding in verdict.findings} == {name}
    assert verdict.findings[0].worst == pytest.approx(0.5 if make is jumping else 0.3)


def test_missing_samples_are_no_jump():
    kept = ~np.isin(np.arange(len(TIMES)), [70, 71])
    positions = standing()
    positions[:, column("left_elbow")] = np.clip(5.0 * (TIMES - 1.0), 0.0, 1.5)
    trajectory = Motion(TIMES[kept], JOINTS, positions[kept])
    assert check(trajectory, only=["jump"]).findings == ()


@pytest.mark.parametrize(
    ("rate", "has_velocities"), [(10.0, False), (10.0, True), (60.0, False)]
)
def test_accelerations_are_those_of_a_sine_at_any_rate(rate, has_velocities):
    times = np.arange(round(3.0 * rate) + 1) / rate
    positions, velocities = np.zeros((2, len(times), 1))
    positions[:, 0], velocities[:, 0] = 0.5 * np.sin(2 * times), np.cos(2 * times)
    rates = velocities if has_velocities else None
    found = Motion(times, ("left_elbow_joint",), positions, rates)
    for name, size in (("acceleration", 2.0), ("jerk", 4.0)):
        for bound, failures in ((1.15 * size, 0), (0.85 * size, 1)):
            content = {f"{name}_bounds": {"default": bound}}
            thresholds = with_thresholds(Thresholds(), content)
            verdict = check(found, thresholds, [name])
            assert len(verdict.findings) == failures, (name, bound)


@pytest.mark.parametrize("height", [0.004, 0.024])
def test_a_robot_that_slides_low_above_the_floor_is_found(height):
    found = skating()
    base = found.base_poses.copy()
    base[:, 2] += height
    verdict = check(motion(standing(), base, lift=False), only=["skating"])
    assert "skating" in {finding.check for finding in verdict.findings}


def test_feet_in_the_floor_are_found_however_short_the_motion():
    model = Robot()
    squat = model.read_motion("squat.csv")
    sunk = replace(squat, base_poses=squat.base_poses - 0.02 * np.eye(7)[2])
    for count in (1, 2, 3):
        found = model.check(sunk.sampled(squat.times[:count])).findings
        assert {finding.check for finding in found} == {"penetration"}


def test_velocities_of_joints_let_no_standing_foot_skate():
    """Those of a file are of a sample, those of the base are means to the next one."""
    model = Robot()
    squat = model.read_motion("squat.csv").at_speed(3.0)
    rates = np.gradient(squat.positions, squat.times, axis=0)
    slides = [
        model.check(replace(squat, velocities=one)).measured.ground.slide
        for one in (None, rates)
    ]
    np.testing.assert_allclose(slides[1], slides[0])


def test_which_corner_of_a_sole_is_the_lowest_does_not_matter():
    speeds = []
    for tilt in (-1e-6, 0.0, 1e-6):
        base = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(TIMES), 1))
        yaw = from_axis_angle(np.array([0.0, 0, 1]), 1.0 * TIMES)
        pitch = from_axis_angle(np.array([0.0, 1, 0]), np.array(tilt))
        base[:, 3:] = multiply(yaw, pitch)
        verdict = check(motion(standing(), base), only=["skating"])
        speeds.append(max(finding.worst for finding in verdict.findings))
    assert max(speeds) - min(speeds) < 1e-3


def test_a_moment_without_support_is_no_fall():
    """A foot that bears moves a little faster for a moment: it still bears."""
    base = motion(standing()).base_poses.copy()
    base[:, 2] += 0.012
    base[:, 0] += 0.02 * 0.12 * np.sin(2 * np.pi * TIMES / 0.12) / (2 * np.pi) * 6
    verdict = check(motion(standing(), base, lift=False))
    assert verdict.of("center_of_mass") == ()
    assert verdict.floor_contacts["left_ankle_roll_link"] == ((0.0, TIMES[-1]),)


def test_a_robot_without_masses_floats_and_has_no_efforts():
    light = replace(ROBOT, links=tuple(replace(x, inertial=None) for x in ROBOT.links))
    verdict = Checker(light, collisions=COLLISIONS).check(floating())
    assert "floating" in {finding.check for finding in verdict.findings}
    assert verdict.skipped["center_of_mass"] == "the robot has no mass"
    assert verdict.skipped["effort"] == "the robot has no mass"


def test_efforts_at_the_ends_of_a_motion_are_not_invented():
    """It may go on before and after."""
    positions = np.zeros((len(TIMES), len(JOINTS)))
    positions[:, column("left_hip_pitch")] = 0.8 * TIMES - 1.0
    found = Motion(TIMES, JOINTS, positions)
    checker = Checker(ROBOT, None, True, COLLISIONS)
    verdict = checker.check(found, ["effort"])
    assert verdict.findings == ()
    assert "deepest_self_collision" not in verdict.figures


@pytest.mark.parametrize(("depth", "found"), [(0.00501, 0), (0.0065, 2)])
def test_feet_as_deep_as_a_retargeter_puts_them_are_no_finding(depth, found):
    """It puts the lowest sole of a clip 5 mm into the floor, up to rounding."""
    verdict = check(sunken(depth), only=["penetration"])
    assert len(verdict.findings) == found


def test_a_damaged_file_of_pairs_is_told(tmp_path):
    """Its robot is not taken for another one, whose pairs are found at random."""
    file = tmp_path / "collisions.yaml"
    file.write_text(ROBOT.profile.collisions.read_text()[:2000])
    damaged = replace(ROBOT.profile, collisions=file)
    with pytest.raises(AllowedPairsError, match=r"/collisions\.yaml: "):
        Checker(replace(ROBOT, given_profile=damaged))


def test_a_limit_of_zero_is_unknown():
    elbow = ROBOT.movable_joints[column("left_elbow")]
    joints = tuple(
        replace(joint, velocity=0.0) if joint.name == elbow.name else joint
        for joint in ROBOT.joints
    )
    checker = Checker(replace(ROBOT, joints=joints), collisions=COLLISIONS)
    verdict = checker.check(motion(standing()))
    assert verdict.findings == ()
    assert "velocity limit of left_elbow_joint in" in verdict.notes[0]


def test_bounds_of_joints_that_are_not_there_are_refused():
    content = {"jerk_bounds": {"joints": {"left_elbow": 1.0}}}
    thresholds = with_thresholds(Thresholds(), content)
    with pytest.raises(ThresholdError, match="g1_29dof has no joint 'left_elbow'"):
        Checker(ROBOT, thresholds, collisions=COLLISIONS)


def test_a_motion_that_is_too_long_is_refused():
    for step, told in ((0.9, "is the limit. Check"), (20.0, "Are its times in ms\\?$")):
        times = step * np.arange(1e4)
        found = Motion(times, JOINTS, np.zeros((len(times), len(JOINTS))))
        with pytest.raises(MotionError, match=told):
            check(found)


def test_without_a_base_the_floor_is_not_judged():
    found = Motion(TIMES, JOINTS, standing())
    verdict = check(found)
    assert verdict.passed
    assert verdict.skipped["penetration"] == "the motion has no base"
    assert verdict.skipped["center_of_mass"] == "the motion has no base"


def test_efforts_of_a_held_robot_are_pinocchios():
    pinocchio = imported_pinocchio()
    positions = standing()
    positions[:, column("left_hip_roll")] = 1.2 * bump(0.2, 1.2)
    found = Motion(TIMES, JOINTS, positions)
    checker = Checker(ROBOT, None, True, COLLISIONS)
    verdict = checker.check(found, ["effort"])
    model = pinocchio.buildModelFromUrdf(str(MODEL))
    model.gravity.linear = np.array([0.0, 0.0, -9.8])
    data, window = model.createData(), Thresholds().window
    share = 0.0
    for now in TIMES:
        before, here, after = (
            np.array([np.interp(now + shift, TIMES, column) for column in positions.T])
            for shift in (-window, 0.0, window)
        )
        v = (after - before) / (2 * window)
        a = (after - 2 * here + before) / window**2
        efforts = np.abs(pinocchio.rnea(model, data, here, v, a))
        share = max(share, (efforts / model.effortLimit).max())
    limit = Thresholds({"effort": Level(None, share - 1e-9)})
    checker = Checker(ROBOT, limit, True, COLLISIONS)
    (finding,) = checker.check(found, ["effort"]).findings
    assert finding.worst == pytest.approx(share, abs=1e-9)
    assert "effort" not in verdict.skipped


def test_accelerations_are_judged_where_bounds_are_given():
    found = motion(standing())
    content = {"acceleration_bounds": {"joints": {"left_elbow_joint": 0.5}}}
    verdict = check(found, with_thresholds(Thresholds(), content))
    (finding,) = verdict.findings
    assert (finding.check, finding.subject) == ("acceleration", ("left_elbow_joint",))
    assert "; the bound is 0.5 rad/s^2" in finding.text
