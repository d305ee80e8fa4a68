"""What a comparison of an executed motion with its reference says."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import REPOSITORY
from scipy.spatial.transform import Rotation

from g1_description.api import Robot
from g1_description.checks.comparison import compare, find_shift
from g1_description.errors import MotionError

G1 = Robot(REPOSITORY / "urdf" / "g1_29dof.urdf")
ELBOW = "left_elbow_joint"
TIMES = np.linspace(0.0, 4.0, 201)


@pytest.fixture(scope="module")
def checker():
    return G1.checker(None, False)


def waving(times, n_samples=201):
    """Make a standing robot whose arms do not repeat themselves."""
    sweep = np.sin(2.0 * times**1.5)
    positions = {ELBOW: 0.3 * sweep, "right_elbow_joint": 0.2 * np.cos(times**2)}
    base = np.tile([0.0, 0.0, 0.79, 0.0, 0.0, 0.0, 1.0], (n_samples, 1))
    return G1.trajectory(times, positions, base=base)


def test_a_motion_equals_itself(checker):
    found = compare(checker, waving(TIMES), waving(TIMES))
    assert found.shift == pytest.approx(0.0, abs=1e-4)
    assert found.duration == pytest.approx(4.0, abs=0.03)
    assert max(error.largest for error in found.joints.values()) < 1e-4
    assert found.bodies.largest < 1e-4


@pytest.mark.parametrize("shift", [0.137, -0.263, 30.0])
def test_the_time_shift_of_a_longer_noisy_recording_is_found(shift):
    reference, chance = waving(TIMES), np.random.default_rng(1)
    times = np.linspace(-2.0, 6.0, 401)
    rows = np.clip(np.searchsorted(TIMES, times), 0, 200)
    positions = np.array(
        [np.interp(times, TIMES, column) for column in reference.positions.T]
    ).T
    executed = replace(
        reference,
        times=times + 2.0,
        positions=positions + chance.normal(0.0, 0.005, positions.shape),
        base_poses=reference.base_poses[rows],
    )
    executed = replace(executed, times=executed.times + shift)
    assert find_shift(reference, executed) == pytest.approx(2.0 + shift, abs=2e-3)


def test_errors_of_joints_base_and_bodies_are_told_apart(checker):
    reference = waving(TIMES)
    positions = reference.positions.copy()
    positions[100, reference.joint_names.index(ELBOW)] += 0.1
    base = reference.base_poses.copy()
    base[:, 0] += 0.03
    base[:, 3:] = Rotation.from_euler("z", 0.2).as_quat()
    executed = replace(reference, positions=positions, base_poses=base)
    found = compare(checker, reference, executed, 0.0)
    assert found.joints[ELBOW].largest == pytest.approx(0.1)
    assert found.joints[ELBOW].when == pytest.approx(2.0)
    assert found.joints["left_knee_joint"].largest == 0.0
    assert found.base_position.rms == pytest.approx(0.03)
    assert found.base_angle.rms == pytest.approx(0.2)
    # From the root only the forearm moved; in the map all did.
    assert found.bodies_from_root.when == pytest.approx(2.0)
    assert 0.0 < found.bodies_from_root.largest < 0.01
    assert found.bodies.rms > 0.03


def test_bodies_are_compared_as_their_places_differ(checker):
    """An oracle by Robot.link_poses, one sample at a time."""
    reference = waving(TIMES)
    executed = replace(reference, positions=0.8 * reference.positions)
    found = compare(checker, reference, executed, 0.0)
    distances = []
    for a, b in zip(reference.positions, executed.positions):
        places = [_places(row) for row in (a, b)]
        distances.append(np.linalg.norm(places[1] - places[0], axis=1).mean())
    assert found.bodies_from_root.largest == pytest.approx(max(distances), rel=1e-6)


def _places(row):
    return np.array([pose[:3] for pose in G1.link_poses(row).values()])


def _at(motion, times):
    return np.array(
        [np.interp(times, motion.times, column) for column in motion.positions.T]
    ).T


def test_feet_that_slip_and_findings_are_told_with_the_errors(checker):
    reference = waving(TIMES)
    base = reference.base_poses.copy()
    base[:, 0] += 0.05 * TIMES
    positions = reference.positions.copy()
    positions[50:60, reference.joint_names.index(ELBOW)] = 2.5
    executed = replace(reference, positions=positions, base_poses=base)
    found = compare(checker, reference, executed, 0.0)
    before, after = found.slip["left_ankle_roll_link"]
    assert before < 1e-6
    assert after == pytest.approx(0.2, rel=0.1)
    beyond = [f for f in found.findings if f[0].subject == (ELBOW,)]
    assert beyond
    assert max(joint for _, joint, _ in beyond) > 1.9
    assert f"left_ankle_roll_link slides {after:.3f} m" in str(found)
    errors = executed.positions - reference.positions
    total = np.sqrt(np.mean(errors**2))
    assert re.search(r"rms error ([\d.]+)", str(found)).group(1) == f"{total:.4f}"


def test_a_finding_between_the_samples_of_the_reference_is_told(checker):
    reference = waving(TIMES)
    times = np.linspace(0.0, 4.0, 401)
    positions = _at(reference, times)
    positions[151, reference.joint_names.index(ELBOW)] = 2.5
    base = np.tile(reference.base_poses[0], (401, 1))
    executed = replace(reference, times=times, positions=positions, base_poses=base)
    found = compare(checker, reference, executed, 0.0)
    told = {(finding.check, finding.subject) for finding, _, _ in found.findings}
    verdict = checker.check(executed)
    assert told == {(finding.check, finding.subject) for finding in verdict.findings}
    assert found.joints[ELBOW].largest > 1.9


def test_slip_is_that_of_the_common_time_at_any_rate(checker):
    reference = waving(TIMES)
    base = reference.base_poses.copy()
    base[:, 0] += 0.05 * TIMES
    reference = replace(reference, base_poses=base)
    for other in (reference.cut(0.0, 2.0), reference.resampled(30.0)):
        found = compare(checker, reference, other, 0.0)
        before, after = found.slip["left_ankle_roll_link"]
        assert before == pytest.approx(after, rel=1e-6)
        assert before == pytest.approx(0.05 * found.duration, rel=0.15)


def test_motions_without_anything_in_common_are_refused(checker):
    elbow = replace(waving(TIMES), joint_names=(ELBOW,), positions=np.zeros((201, 1)))
    knee = replace(elbow, joint_names=("left_knee_joint",))
    with pytest.raises(MotionError, match="no common joints"):
        compare(checker, elbow, knee)
    with pytest.raises(MotionError, match="no common times"):
        compare(checker, elbow, elbow, 10.0)
