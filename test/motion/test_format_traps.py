"""What the formats of others leave open, and what looks wrong in a motion: told."""

import io
import json

import numpy as np
import pytest
from conftest import REPOSITORY
from scipy.spatial.transform import Rotation

from g1_description import Robot
from g1_description.checks.batch import FileChecker
from g1_description.cli.motion_paths import motion_files
from g1_description.errors import MotionError
from g1_description.motion.files.conventions import G1_JOINTS, ISAAC_JOINTS
from g1_description.motion.files.formats import (
    has_neighbours,
    motion_names,
    read_motion,
)
from g1_description.motion.files.source import MotionSource, ReadOptions
from g1_description.robot.load import read_model

JOINTS = G1_JOINTS[29]
N = 4


@pytest.fixture(scope="module")
def g1():
    return read_model(str(REPOSITORY / "urdf" / "g1_29dof.urdf")).description


def configurations():
    """Make qpos of a robot that stands and moves its left elbow."""
    qpos = np.zeros((N, 36))
    qpos[:, :3] = 0.1, 0.2, 0.78
    qpos[:, 3:7] = Rotation.from_euler("z", 0.3).as_quat()[[3, 0, 1, 2]]
    qpos[:, 7 + JOINTS.index("left_elbow_joint")] = np.linspace(0.0, 0.5, N)
    return qpos


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def table(columns):
    rows = np.stack([*columns.values()], axis=1).tolist()
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows), ""]
    return "\n".join(lines)


def notes_of(path, g1, *args, **kwargs):
    return " ".join(read_motion(path, g1, ReadOptions(*args, **kwargs)).notes)


def seed_columns(place=100.0, angle=180.0 / np.pi):
    qpos = configurations()
    columns = {"Frame": np.arange(N, dtype=float)}
    for axis, values in zip("XYZ", place * qpos[:, :3].T):
        columns[f"root_translate{axis}"] = values
    for axis, value in zip("XYZ", (0.0, 0.0, 0.3 * angle)):
        columns[f"root_rotate{axis}"] = np.full(N, value)
    for name, values in zip(JOINTS, angle * qpos[:, 7:].T):
        columns[f"{name}_dof"] = values
    return columns


def test_bones_seed_in_other_units_is_refused_or_told(g1, file):
    with pytest.raises(MotionError, match=r"most 0.78 cm high: this looks like met"):
        read_motion(file(table(seed_columns(place=1.0))), g1)
    notes = notes_of(file(table(seed_columns(angle=1.0))), g1)
    assert "No joint turns by more than 0.50 degrees: if the columns are in" in notes


def test_a_damaged_table_of_bones_seed_is_told(g1, file):
    columns = seed_columns()
    del columns["root_rotateY"]
    with pytest.raises(MotionError, match="The header lacks root_rotateY"):
        read_motion(file(table(columns)), g1)
    text = table(seed_columns()).replace("right_knee", "left_knee")
    with pytest.raises(MotionError, match="duplicate columns: left_knee_joint_dof"):
        read_motion(file(text), g1)
    text = table(seed_columns()).replace("0.78", "x").replace("78.0", "x")
    with pytest.raises(MotionError, match=r"Line 2: expected a number .got 'x'"):
        read_motion(file(text), g1)


def write_sonic(folder, **changed):
    """Write a folder of SONIC; tables that are None are left out."""
    qpos = configurations()
    order = [7 + JOINTS.index(name) for name in ISAAC_JOINTS]
    tables = {
        "joint_pos": qpos[:, order],
        "body_pos": qpos[:, :3],
        "body_quat": qpos[:, 3:7],
        **changed,
    }
    folder.mkdir()
    for name, values in tables.items():
        if values is not None:
            header = ",".join(f"{name}_{n}" for n in range(values.shape[1]))
            if name == "joint_pos":
                header = header.replace("joint_pos", "joint")
            path = folder / f"{name}.csv"
            np.savetxt(path, values, delimiter=",", header=header, comments="")
    return folder


def test_what_is_wrong_in_a_sonic_folder_is_told(g1, tmp_path):
    bodies = write_sonic(tmp_path / "a", body_quat=np.ones((N, 5)))
    with pytest.raises(MotionError, match=r"4 columns each in body_quat.csv and 3 "):
        read_motion(bodies, g1)
    rows = write_sonic(tmp_path / "b", body_quat=np.ones((N + 1, 4)))
    with pytest.raises(MotionError, match=r"body_quat.csv has 5 rows, but .* have 4"):
        read_motion(rows, g1)
    joints = write_sonic(tmp_path / "c", joint_pos=np.ones((N, 23)))
    with pytest.raises(MotionError, match="23 columns; expected those of 29 joints"):
        read_motion(joints, g1)
    with pytest.raises(MotionError, match="one table of a motion of SONIC; give its f"):
        read_motion(joints / "joint_pos.csv", g1)
    (joints / "joint_pos.csv").write_text("joint_0\nx\n")
    with pytest.raises(MotionError, match=r"joint_pos.csv: Line 2: expected a number"):
        read_motion(joints, g1)


def test_a_folder_that_is_a_motion_is_one_task(tmp_path):
    one = write_sonic(tmp_path / "one")
    (tmp_path / "a.csv").write_text("")
    tasks = motion_files([tmp_path]).tasks
    assert [task.path for task in tasks] == [one, tmp_path / "a.csv"]
    assert motion_files([one]).named == {str(one)}


def test_columns_of_length_1_tell_the_order_of_qpos(g1, file):
    qpos = configurations()
    first = qpos[:, [3, 4, 5, 6, 0, 1, 2, *range(7, 36)]]
    for rows in (qpos, first):
        motion = read_motion(file(npz(qpos=rows, fps=30)), g1)
        np.testing.assert_allclose(motion.base_poses[:, :3], qpos[:, :3])
        np.testing.assert_allclose(motion.base_poses[:, 6], qpos[:, 3])
        assert motion.notes == ()
    with pytest.raises(MotionError, match="Neither columns 1 to 4 nor columns 4 to 7"):
        read_motion(file(npz(qpos=0.5 * qpos, fps=30)), g1)
    zero = np.zeros((1, 36))
    zero[0, 3] = 1.0
    notes = notes_of(file(npz(qpos=zero, fps=30)), g1)
    assert "read as place, then quaternion; both orders fit" in notes


def test_objects_behind_the_joints_are_ignored_and_said_to_be(g1, file):
    qpos = configurations()
    thing = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0], (N, 1))
    for rows in ([qpos, thing], [qpos, thing, thing], [qpos[:, :30], thing]):
        content = np.concatenate(rows, axis=1)
        motion = read_motion(file(npz(qpos=content, fps=30)), g1)
        assert len(motion.joint_names) == rows[0].shape[1] - 7
        n_columns = 7 * (len(rows) - 1)
        assert f"of objects, are ignored: {n_columns}." in " ".join(motion.notes)
    odd = np.concatenate([qpos, 2.0 * thing], axis=1)
    with pytest.raises(MotionError, match="has 36 unnamed joints"):
        read_motion(file(npz(qpos=odd, fps=30)), g1)


def test_holosomas_joint_pos_is_qpos(g1, file):
    speeds = np.arange(N * 35.0).reshape(N, 35)
    content = npz(
        fps=[50],
        joint_pos=configurations(),
        joint_vel=speeds,
        joint_names=np.array(JOINTS),
        body_names=np.array(["world", "pelvis"]),
        body_pos_w=np.zeros((N, 2, 3)),
        body_quat_w=np.zeros((N, 2, 4)),
    )
    motion = read_motion(file(content), g1)
    np.testing.assert_array_equal(motion.positions, configurations()[:, 7:])
    np.testing.assert_array_equal(motion.velocities, speeds[:, 6:])
    assert motion.base_poses[0, 2] == 0.78


def loco_mujoco(split_points):
    names = np.array(["root", *JOINTS])
    return npz(
        qpos=configurations(),
        qvel=np.ones((N, 35)),
        joint_names=names,
        frequency=50.0,
        split_points=np.array(split_points),
        site_names=np.array(None, dtype=object),
    )


def test_motions_of_loco_mujoco_begin_at_split_points(g1, file):
    whole = read_motion(file(loco_mujoco([0, N])), g1)
    np.testing.assert_array_equal(whole.positions, configurations()[:, 7:])
    path = file(loco_mujoco([0, 3, N]), "loco.npz")
    assert motion_names(path) == ("0", "1")
    with pytest.raises(MotionError, match=r"several motions: 0, 1. .*'loco.npz#0'"):
        read_motion(path, g1)
    motion = read_motion(path.with_name("loco.npz#1"), g1)
    np.testing.assert_array_equal(motion.positions, configurations()[3:, 7:])
    assert motion.times.tolist() == [0.0]
    with pytest.raises(MotionError, match="There is no motion '2'"):
        read_motion(path.with_name("loco.npz#2"), g1)
    path = file(loco_mujoco([0, 9, N]), "loco.npz")
    with pytest.raises(MotionError, match="split_points has 0 and 9; they must"):
        read_motion(path.with_name("loco.npz#0"), g1)


def write_any4hdmi(folder, **changed):
    (folder / "motions").mkdir()
    path = folder / "motions" / "walk.npz"
    path.write_bytes(npz(qpos=configurations()))
    free = [f"root_{part}" for part in ("tx", "ty", "tz", "qw", "qx", "qy", "qz")]
    manifest = {"timestep": 0.02, "qpos_names": [*free, *JOINTS[::-1]], **changed}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return path


def test_the_manifest_of_any4hdmi_names_joints_and_rate(g1, tmp_path):
    path = write_any4hdmi(tmp_path)
    motion = read_motion(path, g1)
    assert motion.joint_names == JOINTS[::-1]
    assert motion.times[1] == 0.02
    (tmp_path / "manifest.json").write_text("[")
    with pytest.raises(MotionError, match=r"manifest.json is not valid JSON: "):
        read_motion(path, g1)
    (tmp_path / "manifest.json").write_text('{"timestep": 0}')
    with pytest.raises(MotionError, match=r"timestep of manifest.json must be gr"):
        read_motion(path, g1)
    (tmp_path / "manifest.json").unlink()
    assert "assuming 30 Hz" in notes_of(path, g1)


def write_hdmi(folder, **changed):
    qpos = configurations()
    bodies = ["crate", "pelvis"]
    places = np.stack([np.zeros((N, 3)), qpos[:, :3]], axis=1)
    turns = np.stack([qpos[:, 3:7], qpos[:, 3:7]], axis=1)
    arrays = {
        "joint_pos": qpos[:, 7:],
        "joint_vel": np.zeros((N, 29)),
        "body_pos_w": places,
        "body_quat_w": turns,
    }
    meta = {"fps": 50.0, "joint_names": JOINTS[::-1], "body_names": bodies, **changed}
    folder.mkdir()
    (folder / "motion.npz").write_bytes(npz(**arrays))
    (folder / "meta.json").write_text(json.dumps(meta))
    return folder


def test_hdmi_is_read_by_names(g1, tmp_path):
    folder = write_hdmi(tmp_path / "a")
    for path in (folder, folder / "motion.npz"):
        motion = read_motion(path, g1)
        assert motion.joint_names == JOINTS[::-1]
        assert motion.base_poses[0, :3].tolist() == [0.1, 0.2, 0.78]
        assert motion.velocities is None  # zeros, though the elbow moves
        assert motion.notes == (
            "Bodies that g1_29dof does not have are ignored: crate.",
        )
    lacking = write_hdmi(tmp_path / "b", body_names=["crate", "head"])
    with pytest.raises(MotionError, match="The bodies lack the base, pelvis: crate"):
        read_motion(lacking, g1)
    with pytest.raises(MotionError, match="fps must be one number greater than 0"):
        read_motion(write_hdmi(tmp_path / "c", fps=0), g1)
    (folder / "meta.json").write_text("{}")
    other = folder / "other.npz"  # of BeyondMimic: meta.json is somebody else's
    other.write_bytes(npz(**np.load(folder / "motion.npz"), fps=[50]))
    assert read_motion(other, g1).times[1] == 0.02
    (folder / "meta.json").unlink()
    with pytest.raises(MotionError, match="The array fps is missing"):
        read_motion(folder / "motion.npz", g1)


def test_the_base_of_tracking_is_the_body_of_its_name(g1, file):
    qpos = configurations()
    arrays = {
        "fps": [50],
        "joint_pos": qpos[:, 7:],
        "joint_vel": np.zeros((N, 29)),
        "joint_names": np.array(JOINTS),
        "body_pos_w": np.stack([np.zeros((N, 3)), qpos[:, :3]], axis=1),
        "body_quat_w": np.stack([qpos[:, 3:7], qpos[:, 3:7]], axis=1),
    }
    motion = read_motion(file(npz(**arrays)), g1)
    assert motion.base_poses[0, 2] == 0.0
    assert motion.velocities is None  # zeros, though the elbow moves
    named = npz(**arrays, body_names=np.array(["world", "pelvis"]))
    assert read_motion(file(named), g1).base_poses[0, 2] == 0.78
    lacking = npz(**arrays, body_names=np.array(["world", "torso_link"]))
    assert "lack the base, pelvis: assuming the first one, world." in notes_of(
        file(lacking), g1
    )


def holomotion(*prefixes, **metadata):
    qpos = configurations()
    arrays = {"metadata": np.array(json.dumps({"motion_fps": 50.0, **metadata}))}
    for number, prefix in enumerate(prefixes):
        arrays[f"{prefix}dof_pos"] = qpos[:, 7:] + 0.1 * number
        arrays[f"{prefix}global_translation"] = qpos[:, :3]
        arrays[f"{prefix}global_rotation_quat"] = qpos[:, [4, 5, 6, 3]]
    return npz(**arrays)


def test_holomotion_may_have_what_was_executed_beside_the_reference(g1, file):
    motion = read_motion(file(holomotion("robot_")), g1)
    assert motion.base_poses[0, :3].tolist() == [0.1, 0.2, 0.78]
    path = file(holomotion("ref_", "robot_"), "h.npz")
    with pytest.raises(MotionError, match="several motions: ref, robot"):
        read_motion(path, g1)
    motion = read_motion(path.with_name("h.npz#robot"), g1)
    np.testing.assert_allclose(motion.positions, configurations()[:, 7:] + 0.1)
    with pytest.raises(MotionError, match="motion_fps must contain numbers"):
        read_motion(file(holomotion("ref_", motion_fps="fast")), g1)


def test_pyroki_and_npy_may_have_a_rate(g1, file):
    qpos = configurations()
    arrays = {
        "base_frame_pos": qpos[:, :3],
        "base_frame_wxyz": qpos[:, 3:7],
        "joint_angles": qpos[:, 7:],
    }
    assert read_motion(file(npz(**arrays, fps=25.0)), g1).times[1] == 0.04
    motion = read_motion(file(npz(**arrays)), g1)
    assert "assuming 30 Hz" in motion.notes[0]
    assert read_motion(file(npz(**arrays)), g1, ReadOptions(25.0)).times[1] == 0.04
    stream = io.BytesIO()
    np.save(stream, qpos[:, [0, 1, 2, 4, 5, 6, 3, *range(7, 36)]])
    named = read_motion(file(stream.getvalue(), "walk_60_jpos.npy"), g1)
    assert named.times[1] == 1.0 / 60.0
    np.testing.assert_allclose(named.base_poses, motion.base_poses)
    assert "assuming 120 Hz, the usual rate of AMASS" in notes_of(
        file(stream.getvalue(), "walk.npy"), g1
    )


def test_an_option_that_decides_nothing_is_told(g1, file):
    path = file(table(seed_columns()))
    assert "--order is ignored" in notes_of(path, g1, order="xyzw")
    told = notes_of(path, g1, joint_order="isaaclab")
    assert "--input-joint-order is ignored" in told
    path = file(npz(qpos=configurations(), fps=30))
    assert read_motion(path, g1, ReadOptions(format="qpos")).notes == ()
    with pytest.raises(MotionError, match="not of the format holomotion"):
        read_motion(path, g1, ReadOptions(format="holomotion"))
    with pytest.raises(MotionError, match="There is no format 'mp3'; formats: bag, "):
        read_motion(path, g1, ReadOptions(format="mp3"))


def lying():
    """Write a table of a robot that lies: its order is open."""
    base = configurations()[:, [0, 1, 2, 4, 5, 6, 3, *range(7, 36)]]
    base[:, 2] = 0.1
    base[:, 3:7] = Rotation.from_euler("x", -90.0, degrees=True).as_quat()
    return "\n".join(",".join(map(repr, row)) for row in base.tolist())


def test_a_robot_that_stands_in_both_orders_is_told_of(g1, file):
    """Upright along x: in the other order it faces backward."""
    row = ",".join(["0", "0", "0.8", "0", "0", "0", "1", *["0"] * 29])
    (note,) = read_motion(file(row), g1, ReadOptions(30.0)).notes
    assert note.endswith("feet are flat in w x y z, too; set --order to be certain.")
    for order, yaw in (("xyzw", 0.0), ("wxyz", np.pi)):
        motion = read_motion(file(row), g1, ReadOptions(30.0, order=order))
        turn = Rotation.from_quat(motion.base_poses[0, 3:])
        assert motion.notes == ()
        assert turn.as_euler("xyz")[2] == pytest.approx(yaw)


def test_the_order_that_the_user_tells_counts_everywhere(file):
    path = file(lying(), "lying.csv")
    robot = Robot()
    with pytest.raises(MotionError, match="--order xyzw or --order wxyz"):
        robot.read_motion(path)
    with pytest.raises(MotionError, match=r"must be xyzw or wxyz .got 'zyxw'"):
        robot.read_motion(path, order="zyxw")
    wanted = robot.read_motion(path, order="xyzw", format="table")
    half = 0.5**0.5
    assert wanted.base_poses[0, 3:].tolist() == pytest.approx([-half, 0.0, 0.0, half])
    turned = robot.read_motion(path, order="wxyz")
    assert turned.base_poses[0, 6] == wanted.base_poses[0, 3]
    checked = FileChecker(robot.checker(), options=ReadOptions(order="xyzw"))
    found = checked.read("lying.csv", path.read_bytes())
    np.testing.assert_array_equal(found.base_poses, wanted.base_poses)
    assert "--order" in FileChecker(robot.checker()).read("lying.csv", path).problem


def test_neighbours_of_a_file_are_read_where_it_is(tmp_path, file):
    """A cluster's worker gets bytes, in which names and rate are missing."""
    (tmp_path / "a").mkdir()
    for path in (
        write_any4hdmi(tmp_path / "a"),
        write_hdmi(tmp_path / "b") / "motion.npz",
        write_sonic(tmp_path / "c"),
    ):
        assert has_neighbours(MotionSource(path))
    for content in (npz(qpos=configurations(), fps=30), lying()):
        assert not has_neighbours(MotionSource(file(content)))


@pytest.mark.parametrize(
    "arrays",
    [
        {"qpos": np.zeros(36)},
        {"qpos": configurations(), "fps": 30, "joint_names": np.array(["a"] * 40)},
        {"qpos": configurations(), "split_points": np.zeros((2, 2)), "fps": 30},
        {
            "metadata": "{}",
            "ref_dof_pos": np.zeros((N, 29)),
            "ref_global_translation": np.zeros((N, 0, 3)),
            "ref_global_rotation_quat": np.zeros((N, 4)),
        },
    ],
)
def test_arrays_of_wrong_shapes_are_told(g1, file, arrays):
    with pytest.raises(MotionError, match=r"^motion: .*\.$"):
        read_motion(file(npz(**arrays)), g1)


def changed(*joints, value):
    qpos = configurations()
    for joint in joints:
        qpos[:, 7 + JOINTS.index(f"{joint}_joint")] = value
    return qpos


def swapped():
    """Swap the sides of a robot whose arms hang beside its body."""
    qpos = changed("right_shoulder_roll", value=0.4)
    qpos[:, 7 + JOINTS.index("left_shoulder_roll_joint")] = -0.4
    return qpos


def turned(axis, angle, height):
    qpos = configurations()
    qpos[:, 2] = height
    turn = Rotation.from_euler(axis, angle, degrees=True).as_quat()
    qpos[:, 3:7] = turn[[3, 0, 1, 2]]
    return qpos


@pytest.mark.parametrize(
    "qpos, hint",
    [
        (
            changed("left_elbow", value=9.0),
            "left_elbow_joint turns to 9 rad, beyond limits of -1.05 and 2.09: the fi",
        ),
        (
            changed("left_knee", "right_knee", value=-0.4),
            "left_knee_joint bends backwards, to -0.4 rad: signs or the order of",
        ),
        (
            swapped(),
            "The arms are rolled into the body, by 0.4 rad in the median: ",
        ),
        (
            changed("left_hip_roll", value=-1.0),
            "within their limits only with the sides swapped: left and",
        ),
        (turned("x", 170, 0.8), "The base points down in most samples: the order of"),
        (turned("y", 90, 0.8), "The base lies at a height of 0.8 m in most samples: "),
    ],
)
def test_what_looks_wrong_is_told_with_the_reason(g1, file, qpos, hint):
    assert hint in notes_of(file(npz(qpos=qpos, fps=30)), g1)


def test_what_is_only_unusual_is_no_reason_for_a_hint(g1, file):
    for qpos in (configurations(), turned("y", 20, 0.8)):
        assert read_motion(file(npz(qpos=qpos, fps=30)), g1).notes == ()
