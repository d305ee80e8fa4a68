"""Motions as they are published: read right, refused or told, and never else.

What a file does not say, its numbers have to; where they cannot, it is told.
"""

import io
import json
import pickle

import numpy as np
import pytest
from conftest import REPOSITORY, VENDOR
from scipy.spatial.transform import Rotation

from g1_description.errors import G1DescriptionError, MotionError
from g1_description.motion.files.conventions import ASAP_JOINTS, G1_JOINTS
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.load import read_model
from g1_description.robot.urdf import parse_urdf

FOLDER = VENDOR.parents[1] / "motion_formats"
READ = (
    *("lafan1.csv", "M_ShortMove13.bvh_60hz.csv", "kimodo.csv"),
    *("trap_yaw90_xyzw.csv", "trap_yaw90_wxyz.csv", "trap_lying_wxyz.csv"),
    *("trap_23_unitree.csv", "trap_23_asap.csv", "gmr.pkl", "gmr_dataset.pkl"),
    *("twist2.pkl", "gmt_23.pkl", "g1_moves.pkl", "trap_gmr_wxyz.pkl"),
    *("sonic_deploy.pkl", "asap.pkl", "pbhc.pkl", "trap_library_no_fps.pkl"),
    *("trap_no_fps.npz", "mimickit.pkl", "phuma.npy", "protomotions.motion"),
    *("beyondmimic_mjlab.onnx", "beyondmimic_isaac.onnx", "keyframes.xml"),
    *("sonic_motion_lib.pkl", "pbhc_two.pkl", "protomotions_lib.pt"),
    *("wbt_isaac.npz", "mjlab.npz", "unitree_rl_lab_23.npz"),
    *("trap_27.csv", "bones_seed.csv", "soma_retargeter.csv", "trap_x2_columns.csv"),
    *("sonic/M_ShortMove13_001__A000", "sonic_root_only/minimal"),
    *("0005_Walking001_poses_120_jpos.npy", "holosoma.npz", "omniretarget.npz"),
    *("omniretarget_object.npz", "holosoma_retargeted.npz", "trap_fps_is_dt.npz"),
    *("any4hdmi/motions/M_ShortMove13.npz", "humanoid_amp.npz"),
    *("hdmi/M_ShortMove13", "holomotion_legacy.npz", "holomotion.npz", "pyroki.npz"),
    "loco_mujoco.npz",
)
REFUSED = ("trap_degrees.csv", "trap_31.csv", "trap_bones_radians.csv")
TOLD = {
    "trap_degrees.csv": "looks like degrees",
    "trap_31.csv": "has 31 unnamed joints",
    "trap_bones_radians.csv": "looks like metres",
    "trap_fps_is_dt.npz": "Set fps to 30",
    "trap_gmr_wxyz.pkl": "only then are the feet flat",
    "omniretarget_object.npz": "as of objects, are ignored: 7",
    "hdmi/M_ShortMove13": "are ignored: suitcase",
    "trap_x2_columns.csv": "head_yaw_joint, head_pitch_joint",
}
"""What the user is told."""

W_FIRST = "Base quaternions are read as w x y z"
UNKNOWN = "Cannot tell the quaternion order of the base"
LOCKED = set(G1_JOINTS[29]) - set(G1_JOINTS[23])


@pytest.fixture(scope="module")
def g1():
    return read_model(str(REPOSITORY / "urdf" / "g1_29dof.urdf")).description


@pytest.fixture(scope="module")
def g1_23():
    """Lock the joints that the vendor's robot of 23 joints has not."""
    text = (REPOSITORY / "urdf" / "g1_29dof.urdf").read_text()
    for name in LOCKED:
        text = text.replace(
            f'name="{name}" type="revolute"', f'name="{name}" type="fixed"'
        )
    robot = parse_urdf(text)
    assert {joint.name for joint in robot.movable_joints} == set(G1_JOINTS[23])
    return robot


@pytest.fixture(scope="module")
def index():
    if not FOLDER.exists():
        pytest.skip("the motions in published formats are not beside the repository")
    return json.loads((FOLDER / "index.json").read_text())["files"]


def test_every_published_motion_is_tried(index):
    assert sorted(index) == sorted((*READ, *REFUSED))


def differs(motion, entry, rows):
    """Return whether a motion is not that of the table of truth."""
    truth = np.loadtxt(FOLDER / entry["truth"], delimiter=",")[slice(*rows)]
    if len(motion.times) != len(truth) or motion.base_poses is None:
        return True
    column = [7 + G1_JOINTS[29].index(name) for name in motion.joint_names]
    turns, wanted = motion.base_poses[:, 3:], truth[:, 3:7]
    wanted = wanted * np.sign((turns * wanted).sum(axis=1, keepdims=True))
    errors = [
        2.0 * np.abs(turns - wanted).max(),
        np.abs(motion.positions - truth[:, column]).max(),
    ]
    places = np.abs(motion.base_poses[:, :3] - truth[:, :3]).max()
    times = np.abs(motion.times - np.arange(len(truth)) / entry["rate"]).max()
    is_away = entry["tolerance_m"] is not None and places > entry["tolerance_m"]
    return is_away or max(errors) > entry["tolerance_rad"] or times > 1e-6


@pytest.mark.parametrize("name", [*READ, *REFUSED])
def test_each_published_motion_is_read_or_refused_as_it_must_be(g1, index, name):
    path = FOLDER / name
    if not path.exists():
        pytest.skip(f"{name} is not beside the repository")
    entry = index[name]
    rate = None if entry["rate_in_file"] else float(entry["rate"])
    expected = entry["expect"]
    if name in REFUSED:
        with pytest.raises(G1DescriptionError, match=TOLD.get(name, r"\.$")):
            read_motion(path, g1, ReadOptions(rate))
        return
    order = None
    if expected == "choose a motion":
        with pytest.raises(MotionError, match="has several motions"):
            read_motion(path, g1, ReadOptions(rate))
        for part, rows in entry["motions"].items():
            motion = read_motion(FOLDER / f"{name}#{part}", g1, ReadOptions(rate))
            assert not differs(motion, entry, rows)
        return
    if expected == "order cannot be told":
        with pytest.raises(MotionError, match=f"{UNKNOWN}.*--order wxyz"):
            read_motion(path, g1, ReadOptions(rate))
        order = "wxyz"
    if expected == "rate told":
        assert "assuming" in " ".join(read_motion(path, g1).notes)
    motion = read_motion(path, g1, ReadOptions(rate, order=order))
    notes = " ".join(motion.notes)
    assert TOLD.get(name, "") in notes
    assert (expected == "place unknown") == ("place of the base is unknown" in notes)
    assert (expected == "told or refused") <= (name in TOLD)
    assert not differs(motion, entry, entry["rows"])


def posture(yaw=0.0, pitch=0.15, n_samples=4):
    """Make a G1 that leans and bends its knees, on flat soles, facing along yaw."""
    legs = dict.fromkeys(("left", "right"), (-0.6 - pitch, 0.9, -0.3))
    positions = np.zeros((n_samples, 29))
    for side, (hip, knee, ankle) in legs.items():
        for joint, value in (
            ("hip_pitch", hip),
            ("knee", knee),
            ("ankle_pitch", ankle),
        ):
            column = G1_JOINTS[29].index(f"{side}_{joint}_joint")
            positions[:, column] = value
    positions[:, G1_JOINTS[29].index("left_elbow_joint")] = np.linspace(
        0.0, 0.5, n_samples
    )
    base = np.zeros((n_samples, 7))
    base[:, 2] = 0.75
    base[:, 3:] = Rotation.from_euler("ZY", [yaw, pitch]).as_quat()
    return base, positions


def w_first(base):
    return base[:, [0, 1, 2, 6, 3, 4, 5]]


def text(base, positions):
    rows = np.concatenate([base, positions], axis=1).tolist()
    return "".join(",".join(map(repr, row)) + "\n" for row in rows)


def gmr(base, positions, **changed):
    arrays = {
        "fps": np.array(30),
        "root_pos": base[:, :3],
        "root_rot": base[:, 3:],
        "dof_pos": positions,
    }
    return npz(**{**arrays, **changed})


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def gmr_pickle(base, positions):
    arrays = np.load(io.BytesIO(gmr(base, positions)))
    return pickle.dumps({name: arrays[name] for name in arrays.files}, 2)


@pytest.mark.parametrize("write", [text, gmr_pickle])
@pytest.mark.parametrize("yaw", [0.7, -1.57])
def test_the_order_of_quaternions_is_that_in_which_the_robot_stands(
    g1, file, write, yaw
):
    base, positions = posture(yaw)
    motion = read_motion(file(write(base, positions)), g1, ReadOptions(30.0))
    assert not [note for note in motion.notes if "quaternion" in note]
    np.testing.assert_allclose(motion.base_poses, base, atol=1e-12)
    motion = read_motion(file(write(w_first(base), positions)), g1, ReadOptions(30.0))
    assert W_FIRST in " ".join(motion.notes)
    np.testing.assert_allclose(motion.base_poses, base, atol=1e-12)


@pytest.mark.parametrize("axis, yaw", [("x", 0), ("y", 45)])
@pytest.mark.parametrize("order", [lambda base: base, w_first])
def test_a_robot_that_lies_leaves_the_order_open(g1, file, axis, yaw, order):
    """In some of these the other order would let it stand, below the floor."""
    base, positions = posture()
    base[:, 2] = 0.1
    base[:, 3:] = Rotation.from_euler(f"{axis}z", [-90, yaw], degrees=True).as_quat()
    content = order(base)
    lying = file(text(content, positions))
    with pytest.raises(MotionError, match=f"{UNKNOWN}.*--order xyzw or --order wxyz"):
        read_motion(lying, g1, ReadOptions(30.0))
    for told in ("xyzw", "wxyz"):
        wanted = content if told == "xyzw" else content[:, [0, 1, 2, 4, 5, 6, 3]]
        motion = read_motion(lying, g1, ReadOptions(30.0, order=told))
        np.testing.assert_allclose(motion.base_poses, wanted, atol=1e-12)


def test_another_robot_than_a_g1_is_read_as_x_y_z_w(file):
    robot = read_model(str(REPOSITORY / "test" / "data" / "revolute.urdf")).description
    n_joints = len(robot.movable_joints)
    row = ["0", "0", "0", "1", "0", "0", "0", *["0"] * n_joints]
    motion = read_motion(file(",".join(row) + "\n"), robot, ReadOptions(30.0))
    (note,) = motion.notes
    assert note.startswith("The base points down in most samples: the order of the")
    assert motion.base_poses[0].tolist() == [0, 0, 0, 1, 0, 0, 0]


def raised(names, name, value):
    """Make 23 joints of which one is not at zero."""
    base, _ = posture()
    positions = np.zeros((len(base), 23))
    positions[:, names.index(name)] = value
    return base, positions


@pytest.mark.parametrize("write", [text, gmr_pickle])
def test_23_joints_are_those_whose_limits_they_keep(g1, file, write):
    asap = raised(ASAP_JOINTS, "left_shoulder_roll_joint", 2.1)
    motion = read_motion(file(write(*asap)), g1, ReadOptions(30.0))
    assert motion.joint_names == ASAP_JOINTS
    assert "assuming ASAP's layout" in motion.notes[0]
    unitree = raised(G1_JOINTS[23], "left_shoulder_pitch_joint", -1.2)
    motion = read_motion(file(write(*unitree)), g1, ReadOptions(30.0))
    assert motion.joint_names == G1_JOINTS[23]
    assert "assuming Unitree's layout" in motion.notes[0]


def test_23_joints_within_all_limits_are_asaps_unless_the_robot_has_23(g1, g1_23, file):
    calm = file(text(*raised(ASAP_JOINTS, "left_shoulder_roll_joint", 0.2)))
    motion = read_motion(calm, g1, ReadOptions(30.0))
    assert motion.joint_names == ASAP_JOINTS
    assert "both layouts are within limits" in motion.notes[0]
    motion = read_motion(calm, g1_23, ReadOptions(30.0))
    assert motion.joint_names == G1_JOINTS[23]
    assert "both layouts are within limits" in motion.notes[0]


def test_asaps_joints_beyond_unitrees_limits_are_not_those_of_a_robot_of_23(
    g1_23, file
):
    """The right elbow is where the right wrist rolls, by less."""
    asap = file(text(*raised(ASAP_JOINTS, "right_elbow_joint", 2.09)))
    motion = read_motion(asap, g1_23, ReadOptions(30.0))
    assert "assuming ASAP's layout" in motion.notes[0]
    kept = [name for name in ASAP_JOINTS if name in G1_JOINTS[23]]
    assert motion.joint_names == tuple(kept)


_ISAAC_23 = (  # as Isaac Lab lists the joints of the G1 of 23
    *("left_hip_pitch", "right_hip_pitch", "waist_yaw", "left_hip_roll"),
    *("right_hip_roll", "left_shoulder_pitch", "right_shoulder_pitch"),
    *("left_hip_yaw", "right_hip_yaw", "left_shoulder_roll", "right_shoulder_roll"),
    *("left_knee", "right_knee", "left_shoulder_yaw", "right_shoulder_yaw"),
    *("left_ankle_pitch", "right_ankle_pitch", "left_elbow", "right_elbow"),
    *("left_ankle_roll", "right_ankle_roll", "left_wrist_roll", "right_wrist_roll"),
)
ISAAC_23 = tuple(f"{name}_joint" for name in _ISAAC_23)


def tracked(robot, names, positions):
    """Make what unitree_rl_lab writes, without names."""
    joints = {joint.name: joint for joint in robot.movable_joints}
    all_positions = np.zeros((len(positions), len(joints)))
    for number, name in enumerate(names):
        all_positions[:, [*joints].index(name)] = positions[:, number]
    base = posture()[0][: len(positions)]
    poses = Kinematics(robot).link_poses(base, all_positions)
    links = [robot.root, *(joints[name].child for name in names)]
    poses = poses[:, [robot.link_names.index(link) for link in links]]
    return npz(
        fps=np.array([50]),
        joint_pos=positions,
        body_pos_w=poses[..., :3],
        body_quat_w=poses[..., [6, 3, 4, 5]],
    )


@pytest.mark.parametrize(
    "robot, names, isaac",
    [("g1", G1_JOINTS[23], False), ("g1", ISAAC_23, True), ("g1_23", ISAAC_23, True)],
)
def test_bodies_tell_the_order_of_23_joints(request, file, robot, names, isaac):
    robot = request.getfixturevalue(robot)
    positions = np.random.default_rng(3).uniform(-0.2, 0.2, size=(4, 23))
    motion = read_motion(file(tracked(robot, names, positions)), robot)
    assert motion.joint_names == names
    np.testing.assert_array_equal(motion.positions, positions)
    assert ("Joint order: Isaac Lab" in " ".join(motion.notes)) == isaac
    assert "another version" not in " ".join(motion.notes)


def headed(base, positions):
    names = [f"base_{part}" for part in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    rows = np.concatenate([base, positions], axis=1)
    lines = [f"{n}," + ",".join(map(repr, row)) for n, row in enumerate(rows.tolist())]
    return "\n".join([",".join(["time", *names, *G1_JOINTS[29]]), *lines, ""])


@pytest.mark.parametrize("write", [headed, gmr_pickle])
def test_degrees_are_refused(g1, file, write):
    base, positions = posture()
    read_motion(file(write(base, positions)), g1)
    with pytest.raises(MotionError, match=r"left_hip_pitch_joint is at .*like degrees"):
        read_motion(file(write(base, np.degrees(positions))), g1)
