"""Contact forces are those of mechanics; what is missing has its cause in words."""

from dataclasses import replace

import numpy as np
import pytest
from bench.poses import CERTAIN, KINDS, SOME, static_poses

from g1_description import Robot
from g1_description.errors import MotionError
from g1_description.motion.motion import Motion

ROBOT = Robot()
STAND, BASE = ROBOT.named_configuration("stand"), [0, 0, 0.7634, 0, 0, 0, 1]
TIMES = np.arange(0.0, 1.001, 0.02)
INERTIALS = [link.inertial for link in ROBOT.description.links if link.inertial]
WEIGHT = 9.8 * sum(inertial.mass for inertial in INERTIALS)
FRICTION, HIGH = 0.6, np.array([0.0, 0.0, 1.5])


def standing(moves=0.0):
    """Stand, while the base, and all of the robot with it, moves by (n, 3) [m]."""
    bases = np.tile(np.array(BASE, dtype=float), (len(TIMES), 1))
    bases[:, :3] += moves
    positions = np.tile(STAND, (len(TIMES), 1))
    return Motion(TIMES, tuple(ROBOT.joint_names), positions, None, bases)


def along(axis, acceleration):
    """Accelerate along an axis in [m/s^2], shape (n, 3)."""
    moves = np.zeros((len(TIMES), 3))
    moves[:, "xyz".index(axis)] = acceleration / 2.0 * (TIMES - 0.5) ** 2
    return moves


def failures(motion):
    """List what the check finds."""
    found = ROBOT.check(motion, only=["contact_forces"]).findings
    return [finding.text for finding in found]


def test_forces_carry_the_weight_and_act_on_joints_as_their_jacobians_say():
    found = ROBOT.contact_forces(standing())
    at = 25
    np.testing.assert_allclose(found.forces[at].sum(axis=0), [0, 0, WEIGHT], atol=0.1)
    sides = np.hypot(found.forces[at, :, 0], found.forces[at, :, 1])
    assert (sides <= FRICTION * found.forces[at, :, 2] + 1e-9).all()
    expected = ROBOT.inverse_dynamics(STAND, base=BASE)
    for link, force, point in zip(found.links, found.forces[at], found.points[at]):
        if not force[2] > 0.0:
            continue
        jacobian = ROBOT.jacobian(link, STAND, BASE)
        lever = point - ROBOT.link_poses(STAND, BASE)[link][:3]
        wrench = np.concatenate([force, np.cross(lever, force)])
        expected = expected - jacobian[:, 6:].T @ wrench
    # Friction that turns a foot about the vertical has no centre of pressure.
    pitches = [ROBOT.joint_row(f"left_{j}_joint") for j in ("knee", "ankle_pitch")]
    np.testing.assert_allclose(found.efforts[at, pitches], expected[pitches], atol=0.2)


@pytest.mark.parametrize(
    ("motion", "text"),
    [
        (standing(), ""),
        (standing(along("z", -9.8) + HIGH), ""),
        (standing([0.0, 0.0, 0.03]), "the robot needs 344 N upwards while"),
        (standing(along("z", -9.8) / 2.0 + [0.0, 0.0, 1.5]), "needs 172 N upwards"),
        (standing(along("x", 3.0)), "m behind the support polygon"),
        (standing(along("x", -3.0)), "m in front of the support polygon"),
        (standing(along("z", -9.8) + along("x", 3.0)), "N along the floor are needed"),
        (standing(along("y", 5.0)), "m to the right of the support polygon"),
    ],
)
def test_what_no_contact_can_give_is_found_with_its_cause(motion, text):
    found = failures(motion)
    assert len(found) == bool(text)
    assert text in "".join(found)


def test_a_slide_that_brakes_needs_more_friction_than_there_is():
    found = ROBOT.contact_forces(standing(along("x", 8.0)).resampled(10.0))
    assert np.nanmax(found.friction) == pytest.approx(8.0 / 9.8)
    assert np.nanmin(found.available_friction) == FRICTION
    assert "friction of 0.82 is needed and 0.6 is available" in "".join(
        failures(standing(along("x", 8.0)))
    )


def test_weak_motors_are_a_matter_of_efforts():
    joints = [replace(j, effort=0.01 * j.effort) for j in ROBOT.description.joints]
    weak = Robot(replace(ROBOT.description, joints=tuple(joints)))
    verdict = weak.check(standing(), only=["contact_forces", "effort"])
    assert verdict.figures["largest_missing_wrench"] < 2e-3
    assert {finding.check for finding in verdict.findings} == {"effort"}


@pytest.mark.parametrize("kind", KINDS)
def test_the_verdict_on_poses_is_that_of_the_support_polygon(kind):
    poses = [p for p in static_poses(ROBOT, kind, 20) if abs(p.margin) > CERTAIN]
    for pose in poses:
        missing = ROBOT.contact_forces(pose.motion).missing_share[0]
        assert (missing > SOME) == (pose.margin < 0.0)
    assert {pose.margin < 0.0 for pose in poses} == {False, True}


@pytest.mark.parametrize(
    ("motion", "reason"),
    [
        (replace(standing(), base_poses=None), "the motion has no base"),
        (standing().resampled(5.0), "its samples are 0.2 s apart"),
        (standing().cut(0.0, 0.1), "it lasts 0.1 s; accelerations need 0.2 s"),
    ],
)
def test_the_reason_is_said_where_forces_are_unknown(motion, reason):
    verdict = ROBOT.check(motion)
    assert reason in verdict.skipped["contact_forces"]
    assert reason in verdict.skipped["effort"]
    with pytest.raises(MotionError, match=reason):
        ROBOT.contact_forces(motion)
