"""Each format: what its record lacks, a file that is read, an order, damage, traps."""

import io
import json
import pickle
import pickletools
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY
from ros2_bags import odometry, ros2_bag, state
from scipy.spatial.transform import Rotation

from g1_description.errors import MotionError, NoMotionError
from g1_description.motion.files.conventions import (
    ASAP_JOINTS,
    G1_JOINTS,
    ISAAC_JOINTS,
)
from g1_description.motion.files.format import OPEN
from g1_description.motion.files.formats import (
    FORMATS,
    format_name,
    motion_names,
    read_motion,
    read_source,
    write_motion,
)
from g1_description.motion.files.pickles import read_pickle, read_torch
from g1_description.motion.files.source import MotionSource, ReadOptions
from g1_description.motion.motion import Motion
from g1_description.robot.load import read_model

RANDOM = np.random.default_rng(5)
N_SAMPLES = 4
POSITIONS = RANDOM.uniform(-0.2, 0.2, size=(N_SAMPLES, 29))
PLACES = RANDOM.uniform(0.7, 0.8, size=(N_SAMPLES, 3))
TURNS = Rotation.from_euler("XYZ", RANDOM.uniform(-0.2, 0.2, size=(N_SAMPLES, 3)))
BASE = np.concatenate([PLACES, TURNS.as_quat()], axis=1)
W_FIRST = BASE[:, [6, 3, 4, 5]]


@pytest.fixture(scope="module")
def g1():
    return read_model(str(REPOSITORY / "urdf" / "g1_29dof.urdf")).description


def bodies(array, n_bodies=3):
    """Repeat rows for bodies, of which only the first is right."""
    others = np.zeros((len(array), n_bodies - 1, array.shape[1]))
    others[..., -1] = 1.0
    return np.concatenate([array[:, np.newaxis], others], axis=1)


def gmr():
    return {
        "fps": 50,
        "root_pos": BASE[:, :3],
        "root_rot": BASE[:, 3:],
        "dof_pos": POSITIONS,
    }


def entry(positions=POSITIONS, axes=None):
    """Make a motion of a library, with rotation vectors if axes are given."""
    found = {
        "root_trans_offset": BASE[:, :3],
        "root_rot": BASE[:, 3:],
        "dof": np.asfortranarray(positions),
        "fps": 50,
    }
    if axes is not None:
        root = TURNS.as_rotvec()[:, np.newaxis]
        turns = positions[..., np.newaxis] * axes
        found["pose_aa"] = np.concatenate([root, turns, np.zeros((4, 3, 3))], axis=1)
    return found


def deployed():
    order = [G1_JOINTS[29].index(name) for name in ISAAC_JOINTS]
    return {
        "joint_pos": POSITIONS[:, order],
        "body_pos_w": bodies(BASE[:, :3]),
        "body_quat_w": bodies(W_FIRST),
        "_body_indexes": np.array([0, 4, 10]),
    }


def framed():
    rows = np.concatenate([BASE[:, :3], TURNS.as_rotvec(), POSITIONS], axis=1)
    return {"loop_mode": 1, "fps": 50, "frames": rows.tolist()}


def phuma():
    stream = io.BytesIO()
    arrays = gmr()
    content = {"root_trans": arrays["root_pos"], "root_ori": arrays["root_rot"]}
    np.save(stream, {**content, "dof_pos": arrays["dof_pos"], "fps": 50})
    return stream.getvalue()


def amp_dataset():
    stream = io.BytesIO()
    content = {
        "joints_list": [*G1_JOINTS[29]],
        "joint_positions": [*POSITIONS],
        "root_position": [*BASE[:, :3]],
        "root_quaternion": [*BASE[:, 3:]],
        "fps": 50.0,
    }
    np.save(stream, content)
    return stream.getvalue()


def amp_text():
    angles = TURNS.as_euler("XYZ")
    speeds = np.zeros((N_SAMPLES, 35))
    rows = np.concatenate([BASE[:, :3], angles, POSITIONS, speeds], axis=1).tolist()
    return json.dumps({"LoopMode": "Wrap", "FrameDuration": 0.02, "Frames": rows})


def opcodes(value):
    """Pickle a value without beginning and end."""
    return pickle.dumps(value, 2)[2:-1]


def tensor(key, shape, stride, offset=0, count=None):
    """Pickle a tensor as torch does."""
    count = int(np.prod(shape)) if count is None else count
    place = b"(" + opcodes("storage") + b"ctorch\nDoubleStorage\n" + opcodes(key)
    place += opcodes("cpu") + opcodes(count) + b"tQ"
    arguments = b"(" + place + opcodes(offset) + opcodes(shape) + opcodes(stride)
    arguments += opcodes(False) + b"ccollections\nOrderedDict\n)Rt"
    return b"ctorch._utils\n_rebuild_tensor_v2\n" + arguments + b"R"


def torch_saved(items, storages):
    """Make a file of torch.save of pickled items and numbers by key."""
    content = b"\x80\x02}("
    content += b"".join(opcodes(name) + value for name, value in items.items())
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("some name/data.pkl", content + b"u.")
        for key, array in storages.items():
            archive.writestr(f"some name/data/{key}", array.astype("<f8").tobytes())
    return stream.getvalue()


STATE = b"cprotomotions.simulator\nStateConversion\n" + opcodes(("common",)) + b"R"


def proto_motion():
    """Make a file whose joints are a view of the columns behind a base."""
    storages = {
        "0": np.concatenate([BASE, POSITIONS], axis=1),
        "1": bodies(BASE[:, :3]),
        "2": bodies(BASE[:, 3:]),
    }
    items = {
        "state_conversion": STATE,
        "fps": opcodes(50),
        "dof_pos": tensor("0", (4, 29), (36, 1), 7, 4 * 36),
        "rigid_body_pos": tensor("1", (4, 3, 3), (9, 3, 1)),
        "rigid_body_rot": tensor("2", (4, 3, 4), (12, 4, 1)),
    }
    return torch_saved(items, storages)


def proto_library():
    """Make a file of two motions, of which the second one is right."""
    storages = {
        "0": np.concatenate([POSITIONS[:1], POSITIONS]),
        "1": bodies(np.concatenate([BASE[:1], BASE])[:, :3]),
        "2": bodies(np.concatenate([BASE[:1], BASE])[:, 3:]),
        "3": np.array([0.0, 1.0]),
        "4": np.array([1.0, 4.0]),
        "5": np.array([0.02, 0.02]).astype(np.float32),
    }
    items = {
        "dps": tensor("0", (5, 29), (29, 1)),
        "gts": tensor("1", (5, 3, 3), (9, 3, 1)),
        "grs": tensor("2", (5, 3, 4), (12, 4, 1)),
        "length_starts": tensor("3", (2,), (1,)),
        "motion_num_frames": tensor("4", (2,), (1,)),
        "motion_dt": tensor("5", (2,), (1,)),
        "motion_files": opcodes(("a/one.motion", "a/two.motion")),
    }
    return torch_saved(items, storages)


def varint(number):
    found = b""
    while number > 127:
        found += bytes([number & 127 | 128])
        number >>= 7
    return found + bytes([number])


def field(number, value):
    """Encode a field of protobuf."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    value = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(value)) + value


def onnx_tensor(name, array, raw=True):
    content = array.astype("<f4").tobytes()
    found = b"".join(field(1, size) for size in array.shape) + field(2, 1)
    return found + field(8, name) + field(9 if raw else 4, content)


def node(kind, inputs, output, more=b""):
    found = b"".join(field(1, name) for name in inputs)
    return field(1, found + field(2, output) + field(4, kind) + more)


def policy(outputs=("joint_pos", "body_pos_w", "body_quat_w"), body="pelvis"):
    """Make a policy: an initializer, a constant, and an array behind an identity."""
    constant = field(5, field(1, "value") + field(5, onnx_tensor("", bodies(PLACES))))
    graph = (
        node("Gather", ["onnx::1", "time_step"], "joint_pos")
        + node("Constant", [], "places", constant)
        + node("Gather", ["places", "time_step"], "body_pos_w")
        + node("Identity", ["turns"], "same")
        + node("Gather", ["same", "time_step"], "body_quat_w")
        + field(5, onnx_tensor("onnx::1", POSITIONS[:, ::-1]))
        + field(5, onnx_tensor("turns", bodies(W_FIRST), raw=False))
        + b"".join(field(12, field(1, name)) for name in ("actions", *outputs))
    )
    metadata = {
        "joint_names": ",".join(G1_JOINTS[29][::-1]),
        "body_names": f"{body},torso_link,left_knee_link",
    }
    pairs = [field(14, field(1, k) + field(2, v)) for k, v in metadata.items()]
    return field(1, 8) + field(7, graph) + b"".join(pairs)


def keyframes(times=True, model="", more="", joints=POSITIONS):
    keys = []
    for number, row in enumerate(np.concatenate([PLACES, W_FIRST, joints], axis=1)):
        time = f'time="{number * 0.02}"' if times else ""
        qpos = more + " ".join(map(repr, row.tolist()))
        keys.append(f'<key name="k{number}" {time} qpos="{qpos}"/>')
    return (
        f"<mujoco>{model}<keyframe>{''.join(keys)}<key ctrl='1'/></keyframe></mujoco>"
    )


def worldbody():
    """Make a model with an object before the robot, and joints in another order."""
    names = G1_JOINTS[29][::-1]
    joints = "".join(f'<body><joint name="{name}"/></body>' for name in names)
    return (
        '<worldbody><body name="box"><freejoint/></body><body name="pelvis">'
        f'<joint type="free" name="root"/>{joints}</body></worldbody>'
    )


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def rows_text(rows, names=()):
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    return "\n".join([*([",".join(names)] if names else ()), *lines, ""])


ROWS = np.concatenate([BASE, POSITIONS], axis=1)
QPOS = np.concatenate([PLACES, W_FIRST, POSITIONS], axis=1)
TRACKED = {
    "joint_pos": POSITIONS[:, ::-1],
    "body_pos_w": bodies(BASE[:, :3]),
    "body_quat_w": bodies(W_FIRST),
}
NAMED = {
    "joint_names": [*G1_JOINTS[29][::-1]],
    "body_names": ["pelvis", "torso_link", "crate"],
}


def bones_seed():
    angles = TURNS.as_euler("xyz", degrees=True)
    rows = np.concatenate([100.0 * PLACES, angles, np.degrees(POSITIONS)], axis=1)
    names = [f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ"]
    return rows_text(rows, [*names, *(f"{name}_dof" for name in G1_JOINTS[29])])


def trajectory():
    points = "".join(
        f"- positions: {row}\n  time_from_start: {{secs: 0, nsecs: {n * 20_000_000}}}\n"
        for n, row in enumerate(POSITIONS.tolist())
    )
    return f"joint_names: [{', '.join(G1_JOINTS[29])}]\npoints:\n{points}"


def sonic():
    order = [G1_JOINTS[29].index(name) for name in ISAAC_JOINTS]
    return {
        "joint_pos.csv": rows_text(
            POSITIONS[:, order], [f"joint_{n}" for n in range(29)]
        ),
        "body_pos.csv": rows_text(PLACES, ["body_0_x", "body_0_y", "body_0_z"]),
        "body_quat.csv": rows_text(W_FIRST, [f"body_0_{axis}" for axis in "wxyz"]),
    }


def recorded():
    messages = []
    for number, (row, pose) in enumerate(zip(POSITIONS, BASE)):
        stamp = 10**9 + number * 20_000_000
        messages.append(("/joint_states", stamp, state(stamp, G1_JOINTS[29], row)))
        messages.append(("/odom", stamp, odometry(stamp, pose)))
    return ros2_bag(messages)


WHOLE = {
    "ros2.mcap": ("mcap", recorded),
    "qpos.npz": ("qpos", lambda: npz(qpos=QPOS, fps=50)),
    "hdmi": (
        "hdmi",
        lambda: {
            "motion.npz": npz(**TRACKED),
            "meta.json": json.dumps({**NAMED, "fps": 50}),
        },
    ),
    "tracking.npz": (
        "tracking",
        lambda: npz(**TRACKED, fps=[50], joint_names=NAMED["joint_names"]),
    ),
    "isaac_amp.npz": (
        "isaac_amp",
        lambda: npz(
            fps=50,
            dof_names=NAMED["joint_names"],
            body_names=NAMED["body_names"],
            dof_positions=TRACKED["joint_pos"],
            body_positions=TRACKED["body_pos_w"],
            body_rotations=TRACKED["body_quat_w"],
        ),
    ),
    "holomotion.npz": (
        "holomotion",
        lambda: npz(
            metadata=json.dumps({"motion_fps": 50}),
            ref_dof_pos=POSITIONS,
            ref_global_translation=bodies(PLACES),
            ref_global_rotation_quat=bodies(BASE[:, 3:]),
        ),
    ),
    "pyroki.npz": (
        "pyroki",
        lambda: npz(
            fps=50.0,
            base_frame_pos=PLACES,
            base_frame_wxyz=W_FIRST,
            joint_angles=POSITIONS,
        ),
    ),
    "walk_50hz.npy": ("npy", lambda: npy(ROWS)),
    "gmr.pkl": ("gmr", lambda: pickle.dumps(gmr())),
    "library.pkl": ("motion_library", lambda: pickle.dumps({"walk": entry()})),
    "unnamed.pkl": ("motion_library", lambda: pickle.dumps(entry())),
    "deploy.pkl": ("sonic_deploy", lambda: pickle.dumps({"walk": deployed()})),
    "mimickit.pkl": ("mimickit", lambda: pickle.dumps(framed())),
    "phuma.npy": ("phuma", phuma),
    "amp.npy": ("amp_dataset", amp_dataset),
    "amp.txt": ("amp_text", amp_text),
    "proto.motion": ("protomotions", proto_motion),
    "proto.pt#a/two.motion": ("protomotions", proto_library),
    "policy.onnx": ("policy", policy),
    "keyframes.xml": ("keyframes", keyframes),
    "poses.xml#k0": ("keyframes", lambda: keyframes(times=False)),
    "seed_50hz.csv": ("bones_seed", bones_seed),
    "sonic": ("sonic", sonic),
    "trajectory.yaml": ("trajectory", trajectory),
    "table_50hz.csv": ("table", lambda: rows_text(ROWS)),
}
"""A file of each format, all of the same motion."""

FILES = [name for name in WHOLE if "." in name]
"""Those that are no folders."""


@pytest.mark.parametrize("name", FORMATS)
def test_a_record_lacks_nothing(name):
    """What a new format needs, beside code that reads it."""
    found = FORMATS[name]
    known = {own for own, _ in WHOLE.values()} | {"bag"}  # which test_bags.py makes
    assert name in known, "a file in WHOLE"
    page = (REPOSITORY / "docs" / "motion_formats.md").read_text()
    assert re.search(rf"^\|.*`{name}`.*\|", page, re.MULTILINE), "a row of the page"
    assert found.order in (None, "xyzw", "wxyz", OPEN), "an order of quaternions"
    assert (found.assumed_rate is None) == (not found.rate_of), "whose rate it is"
    for writer in found.writers.values():
        assert writer.ending in ("", *found.endings), "its extension in folders"
        assert writer.assumed in (None, found.assumed_rate), "the rate that readers use"
        assert writer.merged is None or found.names is not None


def given(file, name, content):
    """Write a file or folder; return its path with the name of the motion."""
    if isinstance(content, dict):
        for own, part in content.items():
            path = file(part, f"{name}_{own}")
            path.parent.joinpath(name).mkdir(exist_ok=True)
            path.rename(path.parent / name / own)
        return path.parent / name
    plain, *motion = name.split("#")
    return Path("#".join([str(file(content, plain)), *motion]))


def assert_is_the_motion(motion, count=N_SAMPLES, most=1e-6):
    columns = [G1_JOINTS[29].index(name) for name in motion.joint_names]
    np.testing.assert_allclose(motion.positions, POSITIONS[:count, columns], atol=most)
    np.testing.assert_allclose(motion.times, np.arange(count) / 50.0, atol=most)
    if motion.base_poses is None:
        return
    np.testing.assert_allclose(motion.base_poses[:, :3], PLACES[:count], atol=most)
    cosines = np.abs((motion.base_poses[:, 3:] * BASE[:count, 3:]).sum(axis=1))
    np.testing.assert_allclose(cosines, 1.0, atol=most)


@pytest.mark.parametrize("name", WHOLE)
def test_what_others_write_is_read(g1, file, name):
    own, make = WHOLE[name]
    source = MotionSource(given(file, name, make()))
    motion = read_source(source, g1)
    assert source.format == own
    assert (motion.base_poses is None) == (own == "trajectory")
    assert_is_the_motion(motion, 1 if "poses" in name else N_SAMPLES)


@pytest.mark.parametrize("name", WHOLE)
def test_an_order_turns_quaternions_or_is_told_as_ignored(g1, file, name):
    path = given(file, name, WHOLE[name][1]())
    xyzw, wxyz = (
        read_motion(path, g1, ReadOptions(order=order)) for order in ("xyzw", "wxyz")
    )
    is_turned = not np.array_equal(xyzw.base_poses, wxyz.base_poses)
    assert is_turned != ("--order is ignored" in " ".join(wxyz.notes))
    assert is_turned != ("--order is ignored" in " ".join(xyzw.notes))


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_read_or_refused_in_a_sentence(g1, file, name):
    whole = WHOLE[name][1]()
    whole = whole.encode() if isinstance(whole, str) else whole
    random = np.random.default_rng(11)
    refused = 0
    for _ in range(15):
        data = bytearray(whole[: random.integers(1, len(whole) + 1)])
        if random.integers(2):
            data = bytearray(whole)
            for _ in range(random.integers(1, 5)):
                data[random.integers(min(len(data), 600))] = random.integers(256)
        try:
            read_motion(given(file, name, bytes(data)), g1)
        except MotionError as error:
            refused += 1
            assert "\n" not in str(error)
            assert len(str(error)) < 500
    assert refused > 2


def test_one_of_several_motions_is_chosen_by_its_name(g1, file):
    path = file(pickle.dumps({"a walk": entry(), "a/run": entry(POSITIONS[:, ::-1])}))
    assert [*motion_names(path)] == ["a walk", "a/run"]
    with pytest.raises(
        MotionError, match="has several motions: a walk, a/run"
    ) as error:
        read_motion(path, g1)
    assert "(check and motion: --all)" in str(error.value)
    with pytest.raises(MotionError, match="There is no motion 'jump'; "):
        read_motion(Path(f"{path}#jump"), g1)
    motion = read_motion(Path(f"{path}#a/run"), g1)
    np.testing.assert_array_equal(motion.positions, POSITIONS[:, ::-1])


@pytest.mark.parametrize("names", [ASAP_JOINTS, G1_JOINTS[23]])
def test_axes_in_a_library_tell_the_layout_of_23_joints(g1, file, names):
    """Without them, both layouts would be possible."""
    axis = {joint.name: joint.axis for joint in g1.movable_joints}
    content = {"a": entry(POSITIONS[:, :23], np.array([axis[n] for n in names]))}
    motion = read_motion(file(pickle.dumps(content)), g1)
    assert motion.joint_names == names
    assert not [note for note in motion.notes if "ambiguous" in note]
    del content["a"]["root_rot"], content["a"]["fps"]
    motion = read_motion(file(pickle.dumps(content)), g1)
    np.testing.assert_allclose(motion.base_poses, BASE, atol=1e-9)
    assert "assuming 30 Hz" in motion.notes[0]


def test_names_in_arrays_of_gmr_are_those_of_the_joints(g1, file):
    names = G1_JOINTS[29][::-1]
    for given_names in (np.array(names), np.array(names, dtype=object), [*names]):
        content = {**gmr(), "dof_pos": POSITIONS[:, ::-1], "joint_names": given_names}
        assert_is_the_motion(read_motion(file(pickle.dumps(content)), g1))
    content["joint_names"] = names[:5]
    with pytest.raises(MotionError, match="5 names for 29 joints"):
        read_motion(file(pickle.dumps(content)), g1)


def test_places_that_are_all_zero_are_told(g1, file):
    content = deployed()
    content["body_pos_w"] = np.zeros_like(content["body_pos_w"])
    (*_, note) = read_motion(
        file(pickle.dumps({"walk": content})), g1, ReadOptions(50.0)
    ).notes
    assert "the place of the base is unknown" in note
    content["_body_indexes"] = np.array([4, 10, 18])
    with pytest.raises(MotionError, match="The bodies lack the base"):
        read_motion(file(pickle.dumps({"walk": content})), g1)


def test_a_file_of_torch_runs_nothing(g1, file, tmp_path):
    mark = tmp_path / "was_here"
    call = b"cposix\nmkdir\n" + opcodes((str(mark),)) + b"R"
    with pytest.raises(MotionError, match=r"uses posix\.mkdir"):
        read_motion(file(torch_saved({"fps": call}, {})), g1)
    assert not mark.exists()


def test_a_model_names_the_joints_of_keyframes(g1, file):
    box = "0 0 0 1 0 0 0 "
    joints = POSITIONS[:, ::-1]
    path = file(keyframes(model=worldbody(), more=box, joints=joints))
    assert_is_the_motion(read_motion(path, g1))
    with pytest.raises(MotionError, match=r"36 numbers, but .* need 43"):
        read_motion(file(keyframes(model=worldbody())), g1)
    part = worldbody() + '<include file="more.xml"/>'
    assert_is_the_motion(read_motion(file(keyframes(model=part)), g1))


def test_keyframes_without_times_are_poses_or_have_a_rate(g1, file):
    path = file(keyframes(times=False))
    with pytest.raises(MotionError, match=r"no times.*such as 'motion#k0': k0, k1, k2"):
        read_motion(path, g1)
    assert [*motion_names(path)] == ["k0", "k1", "k2", "k3"]
    late = file(keyframes().replace('time="0.06"', 'time="0.01"'))
    with pytest.raises(MotionError, match="have no times that increase"):
        read_motion(late, g1)
    assert_is_the_motion(read_motion(path, g1, ReadOptions(50.0)))
    with pytest.raises(NoMotionError, match="no keyframes"):
        read_motion(file("<mujoco><worldbody/></mujoco>"), g1)


@pytest.mark.parametrize(
    "content, words",
    [
        (lambda: policy(outputs=()), "outputs actions, but not joint_pos, body_pos_w"),
        (lambda: field(1, 8) + b"\xff" * 30, "Not a valid ONNX model"),
    ],
)
def test_a_policy_without_a_reference_is_told(g1, file, content, words):
    with pytest.raises(MotionError, match=words):
        read_motion(file(content(), "policy.onnx"), g1)


def test_text_of_numpy_and_sizes_of_torch_are_read():
    names = [*np.array(["a", "left_knee_joint"])]
    for protocol in (2, 4):
        assert read_pickle(pickle.dumps({"names": names}, protocol))["names"] == names
    size = b"ctorch\nSize\n" + opcodes(((2, 3),)) + b"R"
    assert [*read_torch(torch_saved({"size": size}, {}))["size"]] == [2, 3]


def test_numpys_new_names_and_protocol_5_are_read():
    arrays = {"a": np.asfortranarray(POSITIONS), "b": POSITIONS.T, "c": np.float32(2)}
    for protocol in (2, 3, 4, 5):
        data = pickle.dumps(arrays, protocol)
        if protocol < 4:
            data = data.replace(b"cnumpy.core.", b"cnumpy._core.")
        for name, value in read_pickle(data).items():
            np.testing.assert_array_equal(value, arrays[name])


@pytest.mark.parametrize(
    "compress",
    [0, ("xz", 3)],
    ids=lambda compress: str(compress),
)
def test_what_joblib_writes_is_read(g1, tmp_path, compress):
    joblib = pytest.importorskip("joblib")
    path = tmp_path / "library.pkl"
    joblib.dump({"walk": entry()}, path, compress=compress)
    assert_is_the_motion(read_motion(path, g1))


JOBLIB = b"\x80\x02cjoblib.numpy_pickle\nNumpyArrayWrapper\n)\x81}("


def wrapped(shape, **more):
    """Make joblib's note of an array, in a dictionary."""
    state = {"shape": shape, "order": "C", **more}
    items = b"".join(opcodes(name) + opcodes(value) for name, value in state.items())
    return JOBLIB + items + opcodes("dtype") + opcodes(np.dtype("<f8")) + b"ub"


def test_joblibs_arrays_follow_their_opcodes():
    """Behind padding, since joblib 1.2."""
    numbers = np.arange(6.0)
    data = wrapped((2, 3), numpy_array_alignment_bytes=16)
    data = data[:2] + b"}" + opcodes("a") + data[2:] + b"\3\xff\xff\xff"
    found = read_pickle(data + numbers.tobytes() + b"s.")
    np.testing.assert_array_equal(found["a"], numbers.reshape(2, 3))


def motion_of(names, rate):
    """Make a motion of some of the joints of the G1."""
    columns = [G1_JOINTS[29].index(name) for name in names]
    times = np.arange(N_SAMPLES) / rate
    return Motion(times, tuple(names), POSITIONS[:, columns], base_poses=BASE)


@pytest.mark.parametrize("name, most", [("gmr", 0.0), ("motion_library", 1e-7)])
@pytest.mark.parametrize("names", [ASAP_JOINTS, G1_JOINTS[29][::-1]])
def test_what_is_written_is_read_as_the_same(g1, tmp_path, name, most, names):
    path = tmp_path / "motion.pkl"
    wanted = motion_of(names, 29.97)
    write_motion(path, wanted, g1, name=name)
    found = read_motion(path, g1, ReadOptions(format=name))
    assert not [note for note in found.notes if "quaternion" in note]
    columns = [found.joint_names.index(joint) for joint in names]
    np.testing.assert_allclose(
        found.positions[:, columns], wanted.positions, rtol=0, atol=most
    )
    np.testing.assert_allclose(found.base_poses, BASE, rtol=0, atol=most)
    np.testing.assert_allclose(found.times, wanted.times, atol=1e-12)
    if name == "motion_library" and len(names) == 23:
        assert found.joint_names == names


def test_a_library_has_what_its_readers_need(g1, tmp_path):
    path = tmp_path / "motion.pkl"
    write_motion(path, motion_of(ASAP_JOINTS, 30.0), g1, name="motion_library")
    (found,) = pickle.loads(path.read_bytes()).values()
    assert found["pose_aa"].shape == (N_SAMPLES, 1 + 23 + 3, 3)
    vectors = TURNS.as_rotvec()
    np.testing.assert_allclose(found["pose_aa"][:, 0], vectors, rtol=0, atol=1e-6)
    axis = {joint.name: joint.axis for joint in g1.movable_joints}
    wanted = found["dof"][..., np.newaxis] * [axis[name] for name in ASAP_JOINTS]
    np.testing.assert_allclose(found["pose_aa"][:, 1:24], wanted, atol=1e-7)
    assert not found["pose_aa"][:, 24:].any()
    assert (found["fps"], type(found["fps"])) == (30, int)
    assert found["smpl_joints"].shape == (N_SAMPLES, 24, 3)


FLAT = {"joint_pos": POSITIONS, "body_pos_w": BASE[:, :3], "body_quat_w": BASE[:, 3:]}
"""Arrays by the names of tracking, which has the places of several bodies."""

WORDS = r"body_pos_w must have the shape \(4, n, 3\) \(got \(4, 3\)\)"


def test_a_file_is_read_in_the_next_format_that_recognises_it(g1, tmp_path):
    path = tmp_path / "motion.pkl"
    path.write_bytes(pickle.dumps({**gmr(), **FLAT}))
    source = MotionSource(path)
    motion = read_source(source, g1)
    assert format_name(source) == "gmr"
    np.testing.assert_array_equal(motion.base_poses, BASE)
    (note,) = motion.notes
    assert re.fullmatch(f"Not read as tracking: {WORDS}.", note)
    path.write_bytes(pickle.dumps({**gmr(), **FLAT, "fps": 0}))
    with pytest.raises(MotionError, match=f"{WORDS}. Nor is it read as gmr: fps must"):
        read_motion(path, g1)
    with pytest.raises(MotionError, match=f"{WORDS}.$"):
        read_motion(path, g1, ReadOptions(format="tracking"))


@pytest.mark.parametrize("name", ["gmr", "motion_library"])
def test_a_written_pickle_names_what_old_and_new_numpy_have(g1, tmp_path, name):
    path = tmp_path / "motion.pkl"
    write_motion(path, motion_of(G1_JOINTS[29], 30.0), g1, name=name)
    steps = pickletools.genops(path.read_bytes())
    names = {argument for step, argument, _ in steps if step.name == "GLOBAL"}
    old = {"numpy.core.multiarray _reconstruct", "numpy ndarray", "numpy dtype"}
    assert names - {"_codecs encode"} == old


def test_velocities_that_a_format_does_not_have_are_told(g1, tmp_path):
    motion = motion_of(G1_JOINTS[29], 30.0)
    speeds = Motion(motion.times, motion.joint_names, motion.positions, POSITIONS, BASE)
    for name in ("gmr", "motion_library"):
        (note,) = write_motion(tmp_path / "motion.pkl", speeds, g1, name=name)
        assert "has no velocities" in note
    bare = Motion(motion.times, motion.joint_names, motion.positions)
    with pytest.raises(MotionError, match="needs base poses"):
        write_motion(tmp_path / "motion.pkl", bare, g1, name="gmr")
