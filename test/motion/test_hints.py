"""Motions that are read as what they are not: a note says so, and what reads them."""

import io
import pickle

import numpy as np
import pytest
from conftest import REPOSITORY
from scipy.spatial.transform import Rotation

from g1_description import Robot
from g1_description.checks.batch import FileChecker
from g1_description.errors import MotionError
from g1_description.motion.files.conventions import (
    ASAP_JOINTS,
    G1_JOINTS,
    ISAAC_JOINTS,
    breadth_first,
)
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.load import read_model

JOINTS = G1_JOINTS[29]
N = 4


@pytest.fixture(scope="module")
def g1():
    return read_model(str(REPOSITORY / "urdf" / "g1_29dof.urdf")).description


def standing(yaw=0.3, n_samples=N):
    """Make base and joints of a G1 on flat soles whose knees and elbows move."""
    positions = np.zeros((n_samples, 29))
    for side in ("left", "right"):
        for joint, value in (
            ("hip_pitch", -0.4),
            ("knee", 0.8),
            ("ankle_pitch", -0.4),
            ("elbow", 1.6),
        ):
            positions[:, JOINTS.index(f"{side}_{joint}_joint")] = value
    positions[:, JOINTS.index("left_elbow_joint")] += np.linspace(0, 0.3, n_samples)
    base = np.zeros((n_samples, 7))
    base[:, :3] = 0.1, 0.2, 0.72
    base[:, 3:] = Rotation.from_euler("z", yaw).as_quat()
    return base, positions


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def gmr(base, positions, **more):
    arrays = {"root_pos": base[:, :3], "root_rot": base[:, 3:], "dof_pos": positions}
    return pickle.dumps({"fps": 30, **arrays, **more})


def table(base, positions):
    rows = np.concatenate([base, positions], axis=1).tolist()
    return "\n".join(",".join(map(repr, row)) for row in rows)


def qpos(base, positions):
    return npz(qpos=np.concatenate([base, positions], axis=1), fps=30)


def pyroki(base, positions):
    turns = {"base_frame_pos": base[:, :3], "base_frame_wxyz": base[:, 3:]}
    return npz(**turns, joint_angles=positions, fps=30)


def amp(base, positions):
    return npz(
        fps=60,
        dof_names=np.array(JOINTS),
        body_names=np.array(["pelvis"]),
        dof_positions=positions,
        body_positions=base[:, np.newaxis, :3],
        body_rotations=base[:, np.newaxis, 3:],
    )


def holomotion(base, positions):
    return npz(
        metadata=np.array('{"motion_fps": 50.0}'),
        ref_dof_pos=positions,
        ref_global_translation=base[:, :3],
        ref_global_rotation_quat=base[:, 3:],
    )


def keyframes(base, positions):
    rows = np.concatenate([base, positions], axis=1).tolist()
    keys = [
        f'<key time="{n}" qpos="{" ".join(map(repr, row))}"/>'
        for n, row in enumerate(rows)
    ]
    return f"<mujoco><keyframe>{''.join(keys)}</keyframe></mujoco>"


W_FIRST = [0, 1, 2, 6, 3, 4, 5]


@pytest.mark.parametrize(
    "write, usual",
    [
        (qpos, "wxyz"),
        (pyroki, "wxyz"),
        (amp, "wxyz"),
        (keyframes, "wxyz"),
        (holomotion, "xyzw"),
    ],
)
def test_another_order_of_quaternions_than_the_formats_is_told_and_read(
    g1, file, write, usual
):
    base, positions = standing(-2.4)
    turned = base[:, W_FIRST]
    right, wrong = (turned, base) if usual == "wxyz" else (base, turned)
    other = "xyzw" if usual == "wxyz" else "wxyz"
    motion = read_motion(file(write(right, positions)), g1)
    assert motion.notes == ()
    path = file(write(wrong, positions))
    (note,) = read_motion(path, g1).notes
    assert f"--order {other} reads them so" in note
    motion = read_motion(path, g1, ReadOptions(order=other))
    assert motion.notes == ()
    np.testing.assert_allclose(motion.base_poses, base, atol=1e-12)


def test_a_robot_that_does_not_stand_is_told_of(g1, file):
    """Y up, as in many graphics programs; also a robot that lies."""
    base, positions = standing()
    up = Rotation.from_euler("x", -90.0, degrees=True)
    base[:, :3] = up.apply(base[:, :3])
    base[:, 3:] = (up * Rotation.from_quat(base[:, 3:])).as_quat()
    path = file(gmr(base, positions))
    assert "The robot does not stand" in " ".join(read_motion(path, g1).notes)
    assert "does not stand" not in " ".join(
        read_motion(path, g1, ReadOptions(order="xyzw")).notes
    )


@pytest.mark.parametrize("fps", [30, 120, None])
def test_a_rate_at_which_joints_are_too_fast_is_told(g1, file, fps):
    """An elbow swings at up to 12 rad/s at 30 Hz; its limit is 37."""
    base, positions = standing(n_samples=61)
    swing = 1.2 * np.sin(np.arange(61) / 3.0)
    positions[:, JOINTS.index("left_elbow_joint")] = 0.8 + swing
    text = "\n".join(",".join(map(str, row)) for row in np.hstack([base, positions]))
    notes = read_motion(file(text, "swing.csv"), g1, ReadOptions(fps)).notes
    told = [note for note in notes if "as fast as their limits allow" in note]
    assert bool(told) == (fps == 120)
    assert all("1.3 times" in n and "120 Hz; --fps sets it" in n for n in told)


@pytest.mark.parametrize(
    "factor, offset, words",
    [
        (1.0, 0.25, "at least 0.25"),
        (1000.0, 0.0, "in cm or mm, of another robot"),
        (1.0, -0.25, "below the floor"),
        (1.0, 0.1, ""),
    ],
)
def test_feet_that_are_never_near_the_floor_are_told_of(
    g1, file, factor, offset, words
):
    """Other robots of as many joints have longer legs, and others write mm."""
    base, positions = standing()
    feet = [
        g1.link_names.index(f"{side}_ankle_roll_link") for side in ("left", "right")
    ]
    ankle = Kinematics(g1).link_poses(base, positions)[:, feet, 2].min()
    base[:, 2] += offset - (0.0 if words == "" else ankle if factor == 1.0 else 0.0)
    base[:, :3] *= factor
    notes = read_motion(file(gmr(base, positions)), g1).notes
    assert notes == () if not words else words in " ".join(notes)


def permuted(positions, order):
    return positions[:, [JOINTS.index(name) for name in order]]


@pytest.mark.parametrize("write", [gmr, holomotion])
def test_isaac_labs_order_without_names_is_told_and_read(g1, file, write):
    base, positions = standing()
    path = file(write(base, permuted(positions, ISAAC_JOINTS)))
    note = read_motion(path, g1).notes[-1]
    assert "within them in the order of Isaac Lab" in note
    assert "--input-joint-order isaaclab" in note
    motion = read_motion(path, g1, ReadOptions(joint_order="isaaclab"))
    assert motion.notes == ()
    assert motion.joint_names == ISAAC_JOINTS
    np.testing.assert_array_equal(motion.arranged(JOINTS).positions, positions)


def test_the_order_that_the_user_tells_is_that_of_23_joints_and_of_tables(g1, file):
    base, positions = standing()
    names = breadth_first(g1, ASAP_JOINTS)
    path = file(gmr(base, permuted(positions, names)))
    motion = read_motion(path, g1, ReadOptions(joint_order="isaaclab"))
    assert motion.joint_names == names
    path = file(table(base, permuted(positions, ISAAC_JOINTS)), "a.csv")
    assert "--input-joint-order isaaclab" in read_motion(path, g1).notes[-1]
    robot = Robot()
    wanted = robot.read_motion(path, joint_order="isaaclab")
    assert wanted.joint_names == ISAAC_JOINTS
    with pytest.raises(MotionError, match=r"one of mujoco, isaaclab .got 'ros'"):
        robot.read_motion(path, joint_order="ros")
    checked = FileChecker(robot.checker(), options=ReadOptions(joint_order="isaaclab"))
    found = checked.read("a.csv", path.read_bytes())
    np.testing.assert_array_equal(found.positions, wanted.positions)


def tracked(g1, order="wxyz", links=None, **more):
    base, positions = standing()
    names = ["pelvis", *(joint.child for joint in g1.movable_joints)]
    links = names if links is None else links
    poses = Kinematics(g1).link_poses(base, positions)
    poses = poses[:, [g1.link_names.index(link) for link in links]]
    columns = {"wxyz": [6, 3, 4, 5], "xyzw": [3, 4, 5, 6]}[order]
    arrays = {
        "fps": [50],
        "joint_pos": positions,
        "joint_names": np.array(JOINTS),
        "body_names": np.array(links),
        "body_pos_w": poses[..., :3],
        "body_quat_w": poses[..., columns],
    }
    return {**arrays, **more}


def test_bodies_are_compared_by_their_names(g1, file):
    arrays = tracked(g1, joint_names=np.array(JOINTS[::-1]))
    arrays["joint_pos"] = arrays["joint_pos"][:, ::-1]
    assert read_motion(file(npz(**arrays)), g1).notes == ()
    del arrays["joint_names"]
    arrays = tracked(g1, links=["left_knee_link", "pelvis", "right_elbow_link"])
    del arrays["joint_names"]
    arrays["joint_pos"] = permuted(arrays["joint_pos"], ISAAC_JOINTS)
    motion = read_motion(file(npz(**arrays)), g1)
    assert motion.joint_names == ISAAC_JOINTS
    assert motion.notes == ("Joint order: Isaac Lab.",)
    arrays["body_pos_w"][:, 0, 0] += 0.1
    assert "up to 0.100 m off" in read_motion(file(npz(**arrays)), g1).notes[-1]


TILTS = {"standing": (0.0, 0.72), "lying": (-0.5 * np.pi, 0.1)}


def placed(g1, order, lies, ahead=0, behind=0):
    """Make joints, and poses of bodies with quaternions in an order.

    The world is ahead of the robot's, and still objects are behind it.
    """
    base, positions = standing(n_samples=6)
    pitch, base[:, 2] = TILTS[lies]
    yaws = np.linspace(0.4, 0.8, 6)
    angles = np.stack([yaws, np.full(6, pitch), np.full(6, 0.1)], axis=1)
    base[:, 3:] = Rotation.from_euler("ZYX", angles).as_quat()
    links = ["pelvis", *(joint.child for joint in g1.movable_joints)]
    poses = Kinematics(g1).link_poses(base, positions)
    poses = poses[:, [g1.link_names.index(link) for link in links]]
    still = np.tile([0, 0, 0, 0, 0, 0, 1.0], (6, 1, 1))
    poses = np.concatenate([*[still] * ahead, poses, *[still + 1.0] * behind], axis=1)
    links = [*["world"] * ahead, *links, *["crate"] * behind]
    turns = poses[..., 3:] if order == "xyzw" else poses[..., [6, 3, 4, 5]]
    return base, positions, links, poses[..., :3], turns


def tracking_of(positions, links, places, turns):
    """Without names, as mjlab writes it."""
    arrays = {"joint_pos": positions, "body_pos_w": places, "body_quat_w": turns}
    return npz(fps=[50], **arrays)


def tracking_in_isaacs_order(positions, links, places, turns):
    rows = [JOINTS.index(name) for name in ISAAC_JOINTS]
    ahead = links.index("pelvis")
    columns = np.arange(len(links))
    columns[ahead + 1 : ahead + 30] = ahead + 1 + np.array(rows)
    places, turns = places[:, columns], turns[:, columns]
    return tracking_of(positions[:, rows], links, places, turns)


def named_tracking(positions, links, places, turns):
    arrays = {"joint_pos": positions, "body_pos_w": places, "body_quat_w": turns}
    names = {"joint_names": np.array(JOINTS), "body_names": np.array(links)}
    return npz(fps=[50], **arrays, **names)


def amp_of(positions, links, places, turns):
    return npz(
        fps=60,
        dof_names=np.array(JOINTS),
        body_names=np.array(links),
        dof_positions=positions,
        body_positions=places,
        body_rotations=turns,
    )


def holomotion_of(positions, links, places, turns):
    return npz(
        metadata=np.array('{"motion_fps": 50.0}'),
        ref_dof_pos=positions,
        ref_global_translation=places,
        ref_global_rotation_quat=turns,
    )


def protomotions_of(positions, links, places, turns):
    arrays = {"rigid_body_pos": places, "rigid_body_rot": turns, "dof_pos": positions}
    return pickle.dumps({"fps": 50, **arrays})


def deployed_of(positions, links, places, turns):
    root = links.index("pelvis")
    columns = [root, *(root + 1 + JOINTS.index(name) for name in ISAAC_JOINTS)]
    motion = {
        "joint_pos": positions[:, [JOINTS.index(name) for name in ISAAC_JOINTS]],
        "body_pos_w": places[:, columns][:, ::3],
        "body_quat_w": turns[:, columns][:, ::3],
        "_body_indexes": np.arange(30)[::3],
    }
    return pickle.dumps({"walk": motion})


def gmr_of(positions, links, places, turns):
    root = links.index("pelvis")
    base = np.concatenate([places[:, root], turns[:, root]], axis=1)
    return gmr(base, positions, body_positions=places, body_names=links)


def holosoma_of(positions, links, places, turns):
    root = links.index("pelvis")
    rows = np.concatenate([places[:, root], turns[:, root], positions], axis=1)
    return named_tracking(rows, links, places, turns)


WRITERS = (
    *(tracking_of, tracking_in_isaacs_order, named_tracking, amp_of, holomotion_of),
    *(protomotions_of, deployed_of, gmr_of, holosoma_of),
)


@pytest.mark.parametrize("lies", TILTS)
@pytest.mark.parametrize("write", WRITERS)
def test_bodies_tell_the_base_and_the_order_of_quaternions(g1, file, write, lies):
    for order in ("wxyz", "xyzw"):
        base, *parts = placed(g1, order, lies, 1, 1)
        path = file(write(*parts))
        for given in (None, order):
            motion = read_motion(path, g1, ReadOptions(order=given))
            wanted = base * np.sign(np.sum(base * motion.base_poses, 1))[:, None]
            turn = Rotation.from_quat(motion.base_poses[:, 3:])
            off = Rotation.from_quat(wanted[:, 3:]).inv() * turn
            np.testing.assert_allclose(motion.base_poses[:, :3], base[:, :3], atol=1e-9)
            np.testing.assert_allclose(off.as_rotvec(), 0.0, atol=1e-6)
            assert "quaternion or of the joints" not in " ".join(motion.notes)


def test_what_bodies_refute_is_told_with_what_was_read(g1, file):
    _, *parts = placed(g1, "xyzw", "lying", 1)
    assert read_motion(file(tracking_of(*parts)), g1).notes == (
        "Base quaternions are read as x y z w: only then do the bodies in the file "
        "fit.",
        "The base is body 1 in the file, counted from 0: only then do the bodies fit.",
    )
    positions, links, places, turns = parts
    few = tracking_of(positions, links, places[:, :9], turns[:, :9])
    notes = read_motion(file(few), g1).notes
    assert "it is read as the base, but is perhaps the world" in notes[-1]
    assert "Name the bodies in body_names" in notes[-1]


def test_the_order_of_a_library_is_that_of_its_rotation_vectors(g1, file):
    """Its base lies, so that the feet tell nothing."""
    base, positions, *_ = placed(g1, "xyzw", "lying")
    vectors = np.zeros((6, 30, 3))
    vectors[:, 0] = Rotation.from_quat(base[:, 3:]).as_rotvec()
    for columns in ([3, 4, 5, 6], [6, 3, 4, 5]):
        motion = {"root_trans_offset": base[:, :3], "root_rot": base[:, columns]}
        motion.update({"dof": positions, "pose_aa": vectors, "fps": 30})
        found = read_motion(file(pickle.dumps({"walk": motion})), g1)
        np.testing.assert_allclose(found.base_poses, base, atol=1e-12)
        told = [note for note in found.notes if "agree with pose_aa" in note]
        assert len(told) == (columns[0] == 6)


def test_a_tracking_npz_without_a_rate_takes_that_of_the_user(g1, file):
    arrays = tracked(g1)
    del arrays["fps"]
    path = file(npz(**arrays), "a.npz")
    with pytest.raises(MotionError, match="The array fps is missing: give the rate"):
        read_motion(path, g1)
    assert read_motion(path, g1, ReadOptions(25.0)).times[1] == 0.04
    named = read_motion(file(npz(**arrays), "a_50fps.npz"), g1)
    assert named.times[1] == 0.02
    assert "assuming 50 Hz, as its name says" in named.notes[0]


@pytest.mark.parametrize(
    "names",
    [
        np.array(JOINTS, dtype=object),
        np.array([name.encode() for name in JOINTS]),
        np.array([name.replace("_joint", "") for name in JOINTS]),
    ],
)
def test_names_of_joints_are_read_however_they_are_kept(g1, file, names):
    motion = read_motion(file(npz(**tracked(g1, joint_names=names))), g1)
    assert motion.joint_names == JOINTS
    told = ("Joint names lack the ending _joint, which is added.",)
    assert motion.notes == (told if "joint" not in str(names[0]) else ())


def test_objects_as_names_are_refused_with_a_sentence(g1, file):
    names = np.array([*JOINTS[1:], 3], dtype=object)
    with pytest.raises(MotionError, match="joint_names must be a list of names"):
        read_motion(file(npz(**tracked(g1, joint_names=names))), g1)
