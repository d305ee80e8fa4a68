"""What is written as a motion is read as the same, to the last bit."""

import os

import numpy as np
import pytest
from conftest import REPOSITORY
from hypothesis import given, settings
from hypothesis import strategies as st

from g1_description.errors import InvalidValueError, MotionError
from g1_description.motion.files import beyond_mimic, table
from g1_description.motion.files.formats import most_samples, read_motion, write_motion
from g1_description.motion.motion import Motion, sample
from g1_description.robot.load import read_model
from g1_description.robot.rotation import normalized

G1 = read_model(str(REPOSITORY / "urdf" / "g1_29dof.urdf")).description
NAMES = tuple(joint.name for joint in G1.movable_joints)


def parts(trajectory):
    """List the arrays of a trajectory; what it has not is empty."""
    arrays = (trajectory.positions, trajectory.velocities, trajectory.base_poses)
    empty = np.empty(0)
    return [trajectory.times, *(empty if a is None else a for a in arrays)]


def assert_same(one, other):
    assert one.joint_names == other.joint_names
    for found, wanted in zip(parts(one), parts(other)):
        np.testing.assert_array_equal(found, wanted)


def trajectory(seed, n_samples, n_joints, times=None, velocities=True, base=True):
    """Make a random motion; where it has no times they are uneven."""
    random = np.random.default_rng(seed)
    shape = n_samples, n_joints
    if times is None:
        times = np.cumsum(random.uniform(1e-9, 1.0, n_samples)) - 0.5
    poses = random.normal(size=(n_samples, 7)) * 10.0 ** random.integers(-9, 3)
    poses[:, 3:] = normalized(random.normal(size=(n_samples, 4)))
    return Motion(
        times,
        tuple(random.permutation(NAMES)[:n_joints].tolist()),
        random.normal(size=shape),
        random.normal(size=shape) if velocities else None,
        poses if base else None,
    )


@settings(max_examples=12)
@given(
    st.integers(0, 1000),
    st.integers(1, 5),
    st.integers(1, 29),
    st.booleans(),
    st.booleans(),
)
def test_a_table_is_read_as_it_was_written(tmp_path_factory, seed, n, m, speed, base):
    path = tmp_path_factory.mktemp("table") / "motion.csv"
    wanted = trajectory(seed, n, m, velocities=speed, base=base)
    assert write_motion(path, wanted, G1) == ()
    assert_same(read_motion(path, G1), wanted)


@settings(max_examples=12)
@given(
    st.integers(0, 1000),
    st.integers(2, 5),
    st.integers(1, 29),
    st.booleans(),
    st.sampled_from([0.5, 30.0, 50.0, 60.0, 1000.0, 119.88]),
)
def test_an_npz_is_read_as_it_was_written(tmp_path_factory, seed, n, m, speed, rate):
    path = tmp_path_factory.mktemp("arrays") / "motion.npz"
    wanted = trajectory(seed, n, m, np.arange(n) / rate, velocities=speed)
    assert write_motion(path, wanted, G1, rate) == ()
    assert_same(read_motion(path, G1), wanted)


def test_a_rate_is_found_in_stamps_of_nanoseconds(tmp_path):
    times = np.array([round(n * 1e9 / 60) for n in range(100)]) / 1e9
    path = tmp_path / "motion.npz"
    assert write_motion(path, trajectory(1, 100, 29, times), G1) == ()
    assert np.load(path)["fps"].tolist() == [60.0]


def test_times_that_are_not_even_are_made_even_and_told(tmp_path):
    times = np.array([0.5, 0.6, 0.75, 1.5])
    motion = trajectory(3, 4, 2, times)
    path = tmp_path / "motion.npz"
    (note,) = write_motion(path, motion, G1, 10.0)
    assert "not evenly spaced: resampled to 11 samples at 10 Hz" in note
    found = read_motion(path, G1)
    np.testing.assert_array_equal(found.times, np.arange(11) / 10.0)
    wanted = sample(motion, 0.5 + found.times)
    np.testing.assert_allclose(found.positions, wanted.positions, atol=1e-12)
    np.testing.assert_allclose(found.base_poses, wanted.base_poses, atol=1e-12)
    velocities = [*wanted.velocities[:-1], motion.velocities[-1]]
    np.testing.assert_allclose(found.velocities, velocities, atol=1e-12)


def test_names_tell_the_order_of_the_joints(tmp_path):
    path = tmp_path / "motion.npz"
    wanted = trajectory(5, 3, 29, np.arange(3) / 30.0)
    write_motion(path, wanted, G1)
    motion = read_motion(path, G1)
    assert motion.joint_names == wanted.joint_names
    assert "joint order" not in " ".join(motion.notes).lower()
    for names, words in (
        (np.array(["left_elbow_joint"]), "joint_names has 1 names for 29 joints"),
        (np.zeros(29), "joint_names must be a list of names"),
    ):
        np.savez(path, **{**np.load(path), "joint_names": names})
        with pytest.raises(MotionError, match=words):
            read_motion(path, G1)


def test_what_cannot_be_written_is_told(tmp_path):
    motion = trajectory(2, 3, 2, np.arange(3) / 30.0)
    without_base = trajectory(2, 3, 2, base=False)
    strange = Motion(np.zeros(1), ("a.velocity",), np.zeros((1, 1)))
    (tmp_path / "file").write_text("")
    for name, wanted, error, words in (
        ("a.txt", motion, MotionError, "must end in .csv or .npz"),
        ("a.npz", without_base, MotionError, "needs base poses"),
        ("a.csv", strange, MotionError, "cannot have a joint called 'a.velocity'"),
        ("file/a.csv", motion, InvalidValueError, "cannot be written"),
    ):
        with pytest.raises(error, match=words):
            write_motion(tmp_path / name, wanted, G1)
    assert os.listdir(tmp_path) == ["file"]
    with pytest.raises(MotionError, match="the limit is 1000000"):
        write_motion(tmp_path / "a.npz", motion, G1, 1e9)


@pytest.mark.parametrize("base", [True, False])
def test_as_many_rows_as_are_promised_fit_into_a_table(base):
    size, names = 300_000, NAMES[:29]
    count = table.most_samples(names, base, size)
    longest = np.full((count, 29), -1.2345678901234567e-300)
    poses = np.tile([-1.2345678901234567e-300] * 3 + [0.5] * 4, (count, 1))
    times = 1e5 + np.arange(count) / 7
    motion = Motion(times, names, longest, longest, poses if base else None)
    assert 0.6 * size < len(table.write(motion, G1, None)[0]) <= size


def test_as_many_samples_as_are_promised_fit_into_an_npz():
    size = 300_000
    names = trajectory(1, 1, 29).joint_names
    count = beyond_mimic.most_samples(names, True, size)
    motion = trajectory(1, count, 29, np.arange(count) / 50.0)
    assert 0.9 * size < len(beyond_mimic.write(motion, G1, None)[0]) <= size


def test_a_motion_that_no_file_can_hold_is_told():
    many = [f"joint_{number}" for number in range(2000)]
    for ending, names, base, words in (
        (".npz", NAMES, False, "needs base poses"),
        (".csv", ["a.velocity"], True, "cannot have a joint called 'a.velocity'"),
        (".csv", many, True, ".csv files cannot hold 2000 joints"),
    ):
        with pytest.raises(MotionError, match=words):
            most_samples(ending, names, base)
    assert 69_000 < most_samples(".npz", NAMES, True) < 70_000
    assert 121_000 < most_samples(".csv", NAMES, True) < 122_000
