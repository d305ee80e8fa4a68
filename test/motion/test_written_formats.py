"""Written formats: read by numpy alone as by us, and written in another format."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import REPOSITORY
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from g1_description.errors import MotionError
from g1_description.motion.files.conventions import ASAP_JOINTS, G1_JOINTS
from g1_description.motion.files.formats import WRITERS, read_motion, write_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.motion import Motion
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.load import read_model

G1 = read_model(str(REPOSITORY / "urdf" / "g1_29dof.urdf")).description
JOINTS = G1_JOINTS[29]
RATE = 50.0

_ISAAC = (  # as a policy of whole_body_tracking lists them
    *("left_hip_pitch", "right_hip_pitch", "waist_yaw", "left_hip_roll"),
    *("right_hip_roll", "waist_roll", "left_hip_yaw", "right_hip_yaw", "waist_pitch"),
    *("left_knee", "right_knee", "left_shoulder_pitch", "right_shoulder_pitch"),
    *("left_ankle_pitch", "right_ankle_pitch", "left_shoulder_roll"),
    *("right_shoulder_roll", "left_ankle_roll", "right_ankle_roll"),
    *("left_shoulder_yaw", "right_shoulder_yaw", "left_elbow", "right_elbow"),
    *("left_wrist_roll", "right_wrist_roll", "left_wrist_pitch", "right_wrist_pitch"),
    *("left_wrist_yaw", "right_wrist_yaw"),
)
ISAAC = [f"{name}_joint" for name in _ISAAC]

ORDERS = {"kimodo": "wxyz", **dict.fromkeys(("lafan1", "gmr"), "xyzw")}
ORDERS["motion_library"] = "xyzw"
"""What the user must tell, as the robot may lie."""

WITH_VELOCITIES = (
    "csv",
    "npz",
    "mcap",
    "mjlab",
    "whole_body_tracking",
    "sonic",
    "holomotion",
)
UNTOLD = ("lafan1", "kimodo", "holomotion", "gmr")
"""Formats in which 23 joints are ASAP's."""

SINGLE = ("mjlab", "whole_body_tracking", "holomotion")
"""Formats of float32."""


def a_motion(seed, n_samples=4):
    """Make a motion that is no stranger than those that are published."""
    random = np.random.default_rng(seed)
    base = np.concatenate(
        [
            random.uniform(-2.0, 2.0, (n_samples, 2)),
            random.uniform(0.3, 1.2, (n_samples, 1)),
            Rotation.from_euler(
                "ZYX", random.uniform(-1.2, 1.2, (n_samples, 3))
            ).as_quat(),
        ],
        axis=1,
    )
    positions = random.uniform(-0.6, 0.6, (n_samples, 29))
    velocities = random.uniform(-3.0, 3.0, (n_samples, 29))
    times = np.arange(n_samples) / RATE
    return Motion(times, JOINTS, positions, velocities, base)


def assert_same(motion, other, atol, velocities=False):
    """Check that two motions are equal, in any order of joints."""
    np.testing.assert_allclose(motion.times, other.times, atol=1e-9)
    column = [other.joint_names.index(name) for name in motion.joint_names]
    assert len(column) == len(other.joint_names)
    np.testing.assert_allclose(motion.positions, other.positions[:, column], atol=atol)
    turns, wanted = motion.base_poses[:, 3:], other.base_poses[:, 3:]
    wanted = wanted * np.sign((turns * wanted).sum(axis=1, keepdims=True))
    np.testing.assert_allclose(turns, wanted, atol=atol)
    np.testing.assert_allclose(
        motion.base_poses[:, :3], other.base_poses[:, :3], atol=atol
    )
    if velocities:
        np.testing.assert_allclose(
            motion.velocities, other.velocities[:, column], atol=1e-6
        )


def again(folder, name, motion):
    """Write a motion in a format, and read it."""
    path = folder / f"{name}{WRITERS[name].ending}"
    write_motion(path, motion, G1, name=name)
    return read_motion(path, G1, ReadOptions(RATE, order=ORDERS.get(name)))


@settings(
    max_examples=2,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.integers(0, 10_000))
def test_each_format_keeps_what_it_and_the_one_before_it_hold(tmp_path, seed):
    motion, names = a_motion(seed), [*WRITERS]
    for name, other in zip(names, names[1:] + names[:1]):
        one = again(tmp_path, name, motion)
        atol = 1e-6 if {name, other} & {*SINGLE} else 1e-12
        has_velocities = {name, other} <= {*WITH_VELOCITIES}
        assert_same(again(tmp_path, other, one), motion, atol, has_velocities)


def numbers(path, skip=0):
    return np.loadtxt(path, delimiter=",", skiprows=skip)


def w_last(quaternions):
    return quaternions[..., [1, 2, 3, 0]]


def of_lafan1(path):
    rows = numbers(path)
    return rows[:, :3], rows[:, 3:7], rows[:, 7:], JOINTS


def of_kimodo(path):
    rows = numbers(path)
    return rows[:, :3], w_last(rows[:, 3:7]), rows[:, 7:], JOINTS


def of_bones_seed(path):
    lines = path.read_bytes().decode().split("\r\n")
    assert lines[-1] == ""
    header = lines[0].split(",")
    assert header[0] == "Frame"
    rows = np.array([line.split(",") for line in lines[1:-1]], dtype=float)
    assert rows[:, 0].tolist() == [*range(len(rows))]
    turns = Rotation.from_euler("xyz", rows[:, 4:7], degrees=True).as_quat()
    names = [name[: -len("_dof")] for name in header[7:]]
    return 0.01 * rows[:, 1:4], turns, np.radians(rows[:, 7:]), names


def of_sonic(path):
    turns, places = (numbers(path / f"body_{n}.csv", 1) for n in ("quat", "pos"))
    assert (places.shape[1], turns.shape[1]) == (14 * 3, 14 * 4)
    text = (path / "metadata.txt").read_text()
    assert "[ 0  4 10 18  5 11 19  9 16 22 28 17 23 29]" in text
    joints = numbers(path / "joint_pos.csv", 1)
    return places[:, :3], w_last(turns[:, :4]), joints, ISAAC


def tracked(path, names):
    arrays = np.load(path)
    assert arrays["fps"].tolist() == [50]
    assert arrays["fps"].dtype.kind == "i"
    for name in sorted({*arrays.files} - {"fps"}):
        assert arrays[name].dtype == np.float32
    assert len(arrays.files) == 7
    place, turn = arrays["body_pos_w"], arrays["body_quat_w"]
    return place[:, 0], w_last(turn[:, 0]), arrays["joint_pos"], names


def of_qpos(path):
    arrays = np.load(path)
    assert float(arrays["fps"]) == 50.0
    rows, names = arrays["qpos"], arrays["joint_names"].tolist()
    return rows[:, :3], w_last(rows[:, 3:7]), rows[:, 7:], names


def of_holomotion(path):
    arrays = np.load(path)
    metadata = json.loads(str(arrays["metadata"]))
    assert (metadata["motion_fps"], metadata["num_bodies"]) == (50.0, 30)
    places = arrays["ref_global_translation"]
    turns = arrays["ref_global_rotation_quat"]
    return places[:, 0], turns[:, 0], arrays["ref_dof_pos"], JOINTS


NUMPY = {
    "lafan1": of_lafan1,
    "kimodo": of_kimodo,
    "bones_seed": of_bones_seed,
    "sonic": of_sonic,
    "mjlab": lambda path: tracked(path, JOINTS),
    "whole_body_tracking": lambda path: tracked(path, ISAAC),
    "qpos": of_qpos,
    "holomotion": of_holomotion,
}


@pytest.mark.parametrize("name", NUMPY)
def test_numpy_reads_what_is_written(tmp_path, name):
    motion = a_motion(1)
    path = tmp_path / f"motion{WRITERS[name].ending}"
    write_motion(path, motion, G1, name=name)
    place, turns, positions, names = NUMPY[name](path)
    base = np.concatenate([place, turns], axis=1)
    other = Motion(motion.times, tuple(names), positions, base_poses=base)
    assert_same(motion, other, 1e-6 if name in SINGLE else 1e-12)


@pytest.mark.parametrize(
    "name, order", [("mjlab", JOINTS), ("whole_body_tracking", ISAAC)]
)
def test_files_for_training_have_the_bodies_in_the_order_of_the_joints(
    tmp_path, name, order
):
    motion = a_motion(2)
    write_motion(tmp_path / "a.npz", motion, G1, name=name)
    arrays = np.load(tmp_path / "a.npz")
    poses = Kinematics(G1).link_poses(motion.base_poses, motion.positions)
    child = {joint.name: joint.child for joint in G1.movable_joints}
    links = ["pelvis", *(child[joint] for joint in order)]
    rows = [G1.link_names.index(link) for link in links]
    np.testing.assert_allclose(arrays["body_pos_w"], poses[:, rows, :3], atol=1e-6)
    turns, wanted = w_last(arrays["body_quat_w"]), poses[:, rows, 3:]
    cosines = np.abs((turns * wanted).sum(axis=-1))
    np.testing.assert_allclose(cosines, 1.0, atol=1e-6)
    assert arrays["body_lin_vel_w"].shape == arrays["body_ang_vel_w"].shape


@pytest.mark.parametrize(
    ("made_for", "name"),
    [
        ("g1_29dof_rev_1_0", "npz"),
        ("g1_29dof_rev_1_0", "mjlab"),
        ("g1_29dof_rev_1_0", "whole_body_tracking"),
        ("g1_29dof_rev_1_0", "holomotion"),
        ("g1_23dof", "mjlab"),
    ],
)
def test_bodies_name_the_robot_that_they_fit(tmp_path, made_for, name):
    robot = read_model(made_for).description
    motion = a_motion(2).arranged([joint.name for joint in robot.movable_joints])
    write_motion(tmp_path / "a.npz", motion, robot, name=name)
    own, (other,) = (
        [n for n in read_motion(tmp_path / "a.npz", r).notes if "bodies in the" in n]
        for r in (robot, G1)
    )
    assert own == []
    assert other.startswith("The bodies in the file are up to 0.0")
    assert other.endswith(
        f" m off those of g1_29dof, and fit {made_for}: the motion is made for it; use "
        f"--model {made_for} or robot:={made_for}."
    )


def test_what_a_file_cannot_hold_is_told(tmp_path):
    motion = a_motion(3)
    part = Motion(
        motion.times, JOINTS[:28], motion.positions[:, :28], None, motion.base_poses
    )
    for name in ("lafan1", "kimodo", "bones_seed"):
        notes = write_motion(tmp_path / "a.csv", part, G1, name=name)
        assert f"Missing joints are written as 0: {JOINTS[28]}." in notes
        assert "read it with --fps 50" in notes[-1]
        read = read_motion(
            tmp_path / "a.csv", G1, ReadOptions(RATE, order=ORDERS.get(name))
        )
        assert not read.positions[:, read.joint_names.index(JOINTS[28])].any()
    notes = write_motion(tmp_path / "a.csv", motion, G1, 120.0, "bones_seed")
    assert notes == ("Resampled to 8 samples at 120 Hz.",)
    notes = write_motion(tmp_path / "s", motion, G1, name="sonic")
    assert notes == ()


@pytest.mark.parametrize("name", NUMPY)
def test_a_motion_without_a_base_is_not_written_where_one_is_needed(tmp_path, name):
    motion = a_motion(4)
    still = Motion(motion.times, JOINTS, motion.positions)
    path = tmp_path / f"motion{WRITERS[name].ending}"
    with pytest.raises(MotionError, match="needs base poses, and the motion has none"):
        write_motion(path, still, G1, name=name)
    assert not path.exists()


def test_sonic_has_one_rate_and_the_joints_of_the_g1(tmp_path):
    motion = a_motion(5)
    with pytest.raises(MotionError, match=r"have 50 Hz \(got 30 Hz\)"):
        write_motion(tmp_path / "s", motion, G1, 30.0, "sonic")
    robot = read_model(str(REPOSITORY / "test" / "data" / "revolute.urdf")).description
    with pytest.raises(MotionError, match=r"needs joints that .* does not have"):
        write_motion(tmp_path / "s", motion, robot, None, "sonic")


@pytest.mark.parametrize("names", [ASAP_JOINTS, G1_JOINTS[23]])
@pytest.mark.parametrize("name", [n for n in WRITERS if n != "sonic"])
def test_a_motion_of_a_smaller_g1_keeps_its_joints(tmp_path, name, names):
    part = a_motion(8).arranged(names[::-1])
    path = tmp_path / f"motion{WRITERS[name].ending}"
    notes = write_motion(path, part, G1, name=name)
    found = read_motion(path, G1, ReadOptions(RATE, order=ORDERS.get(name)))
    if names != ASAP_JOINTS and name in UNTOLD:
        assert "could be read as ASAP's" in " ".join(notes)
        assert_same(found, part.arranged(JOINTS), 1e-6)
        return
    assert not any("Missing joints" in note for note in notes)
    assert_same(found, part, 1e-6)
    if name not in ("csv", "npz", "mcap"):
        told = "Only the motion's 23 joints are written, not all 29"
        assert any(note.startswith(told) for note in notes)


def test_a_robot_of_another_order_keeps_it(tmp_path):
    robot = replace(G1, joints=G1.joints[::-1])
    write_motion(tmp_path / "a.npz", a_motion(9), robot, name="qpos")
    order = [joint.name for joint in robot.movable_joints]
    assert order != [*JOINTS]
    assert np.load(tmp_path / "a.npz")["joint_names"].tolist() == order


def test_at_another_rate_the_last_velocity_is_kept(tmp_path):
    motion = replace(a_motion(7), times=np.arange(4) / 30.0)
    write_motion(tmp_path / "a.npz", motion, G1, 50.0, "mjlab")
    found = np.load(tmp_path / "a.npz")["joint_vel"]
    assert len(found) == 6
    np.testing.assert_allclose(found[[0, -1]], motion.velocities[[0, -1]], rtol=1e-5)


def test_gimbal_lock_keeps_the_turn(tmp_path):
    motion = a_motion(6)
    turns = Rotation.from_euler("ZYX", [[0.7, np.pi / 2, 0.0], [0.3, -np.pi / 2, 0.4]])
    base = motion.base_poses.copy()
    base[:2, 3:] = turns.as_quat()
    locked = Motion(motion.times, JOINTS, motion.positions, base_poses=base)
    assert_same(again(tmp_path, "bones_seed", locked), locked, 1e-7)


@pytest.mark.parametrize("name", ["mjlab", "whole_body_tracking"])
def test_a_rate_that_training_would_play_too_fast_is_told(tmp_path, name):
    def notes(motion):
        path = tmp_path / f"{len(motion.times)}.npz"
        return " ".join(write_motion(path, motion, G1, name=name))

    times = np.arange(31) / 30.0
    base = np.tile([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0], (31, 1))
    motion = Motion(times, (), np.zeros((31, 0)), base_poses=base)
    assert "The file has 30 Hz. Training plays a sample per control step" in notes(
        motion
    )
    assert "control step" not in notes(motion.resampled(50.0))
