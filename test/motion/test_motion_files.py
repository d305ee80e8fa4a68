"""Motions of every format, made by others where there are any, and hostile ones."""

import io
import os
import pickle
import resource
import time
import zipfile

import numpy as np
import pytest
from conftest import REPOSITORY

from g1_description.errors import MotionError
from g1_description.motion.files.conventions import G1_JOINTS
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.robot.load import read_model


@pytest.fixture(scope="module")
def g1():
    return read_model(str(REPOSITORY / "urdf" / "g1_29dof.urdf")).description


def test_the_joints_of_the_g1_are_those_of_its_files(g1):
    assert G1_JOINTS[29] == tuple(joint.name for joint in g1.movable_joints)
    assert len(G1_JOINTS[23]) == 23


def npz(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def gmr(n_joints=29):
    """Make what GMR writes; its quaternions are x y z w."""
    return {
        "fps": 50,
        "root_pos": np.tile([0.0, 0.0, 0.8], (3, 1)),
        "root_rot": np.tile([0.0, 0.0, 0.6, 0.8], (3, 1)),
        "dof_pos": np.arange(3.0 * n_joints).reshape(3, n_joints) / 1000.0,
        "local_body_pos": None,
        "link_body_list": None,
    }


def test_fortran_order_and_the_other_order_of_bytes_are_read(g1, file):
    content = gmr()
    content["dof_pos"] = np.asfortranarray(content["dof_pos"]).astype(">f8")
    for data in (
        pickle.dumps(content),
        npz(**{name: a for name, a in content.items() if a is not None}),
    ):
        motion = read_motion(file(data), g1)
        np.testing.assert_array_equal(motion.positions, gmr()["dof_pos"])


def test_joints_that_do_not_fit_are_named(g1, file):
    text = "time,left_elbow_joint,left_wing_joint\n0.0,0.5,0.7\n"
    motion = read_motion(file(text), g1)
    assert "are ignored: left_wing_joint" in motion.notes[0]
    assert motion.positions.tolist() == [[0.5]]


def test_a_table_with_a_header_is_read_to_the_last_bit(g1, file):
    random = np.random.default_rng(7)
    rows = random.normal(size=(5, 10))
    rows[:, 0] = np.arange(5) / 7
    rows[:, 4:8] /= np.linalg.norm(rows[:, 4:8], axis=1, keepdims=True)
    base = [f"base_{part}" for part in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    lines = [",".join(["time", *base, "right_elbow_joint", "left_elbow_joint"])]
    lines += [",".join(map(repr, row)) for row in rows.tolist()]
    motion = read_motion(file("# two elbows\r\n" + "\r\n".join(lines)), g1)
    assert motion.joint_names == ("right_elbow_joint", "left_elbow_joint")
    np.testing.assert_array_equal(motion.times, rows[:, 0])
    np.testing.assert_array_equal(motion.base_poses, rows[:, 1:8])
    np.testing.assert_array_equal(motion.positions, rows[:, 8:])


def test_without_times_thirty_hertz_are_assumed_and_told(g1, file):
    row = ",".join(["0", "0", "0.8", "0", "0", "0", "1", *["0.1"] * 29])
    motion = read_motion(file(f"{row}\n{row}\n"), g1)
    assert motion.times.tolist() == [0.0, 1 / 30]
    assert "assuming 30 Hz" in motion.notes[0]
    told = read_motion(file(f"{row}\n{row}\n"), g1, ReadOptions(50.0, order="xyzw"))
    assert told.notes == ()


def test_the_header_that_numpy_writes_names_the_columns(g1, file):
    names = ["time", "right_elbow_joint", "left_elbow_joint"]
    rows = np.array([[0.0, 0.1, 0.2], [0.5, 0.3, 0.4]])
    stream = io.BytesIO()
    np.savetxt(stream, rows, delimiter=",", header="two elbows\n" + ",".join(names))
    motion = read_motion(file(stream.getvalue()), g1)
    assert motion.has_times
    assert motion.joint_names == tuple(names[1:])
    np.testing.assert_array_equal(motion.times, rows[:, 0])
    np.testing.assert_array_equal(motion.positions, rows[:, 1:])


def point(positions, secs, nsecs):
    """Print a point as ``rostopic echo`` does, with blanks behind keys."""
    return f"""  -\x20
    positions: {positions}
    velocities: []
    accelerations: []
    effort: []
    time_from_start:\x20
      secs: {secs}
      nsecs: {nsecs:9}
"""


ECHO = f"""header:\x20
  seq: 1
  stamp:\x20
    secs: 0
    nsecs:         0
  frame_id: ''
joint_names:\x20
  - left_elbow_joint
  - right_elbow_joint
points:\x20
{point([0.0, 0.5], 0, 500_000_000)}{point([1.0, 0.25], 2, 0)}---
"""


def test_output_of_rostopic_echo_is_read(g1, file):
    motion = read_motion(file(ECHO), g1)
    assert motion.times.tolist() == [0.5, 2.0]
    assert motion.joint_names == ("left_elbow_joint", "right_elbow_joint")
    assert motion.positions.tolist() == [[0.0, 0.5], [1.0, 0.25]]
    assert (motion.velocities, motion.base_poses) == (None, None)
    text = ECHO.replace("velocities: []", "velocities: [0.5, 1.5]")
    motion = read_motion(file(text), g1)
    assert motion.velocities.tolist() == [[0.5, 1.5]] * 2


def test_a_rate_for_a_file_with_times_is_told_to_be_ignored(g1, file):
    times = read_motion(file("time,left_elbow_joint\n0,0\n"), g1).times
    motion = read_motion(file("time,left_elbow_joint\n0,0\n"), g1, ReadOptions(25.0))
    assert "its own times: the rate of 25 Hz is ignored" in motion.notes[0]
    np.testing.assert_array_equal(motion.times, times)


class Hostile:
    """Its pickle names a program to run."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        """Tell what to call."""
        return os.mkdir, (str(self.path),)


def test_a_hostile_pickle_runs_nothing(g1, file, tmp_path):
    mark = tmp_path / "was_here"
    with pytest.raises(MotionError, match=r"uses posix\.mkdir"):
        read_motion(file(pickle.dumps({"fps": Hostile(mark)})), g1)
    assert not mark.exists()


class Pointers:
    """Its pickle says of an array of objects that its bytes are numbers."""

    def __reduce__(self):
        """Give a type of objects whose flags were cleared, and bytes as pointers."""
        kind = np.dtype, ("O8", False, True), (3, "|", None, None, None, -1, -1, 0)
        state = (1, (1,), Raw(*kind), False, b"\1" * 8)
        return np.zeros(1).__reduce__()[0], (np.ndarray, (0,), b"b"), state


class Raw:
    """What a pickle makes of a function, arguments and a state."""

    def __init__(self, *parts):
        self.parts = parts

    def __reduce__(self):
        """Give them."""
        return self.parts


def test_bytes_in_a_pickle_do_not_become_pointers(g1, file):
    with pytest.raises(MotionError, match="has an array of object"):
        read_motion(file(pickle.dumps({"fps": Pointers()}, 2)), g1)


def test_a_pickle_changes_no_class_or_function(g1, file):
    changed = {"__setstate__": None, "__defaults__": (7,)}
    state = pickle.dumps((None, changed), 2)[2:-1]
    asked = "\n".join(["numpy.core.numeric", "_frombuffer"]).encode()
    content = b"\x80\x02}(U\x03fpsc" + asked + b"\n" + state + b"bu."
    with pytest.raises(MotionError, match=r"cannot be read|No known format"):
        read_motion(file(content), g1)
    whole = read_motion(file(pickle.dumps(gmr(), 2)), g1)
    again = read_motion(file(pickle.dumps(gmr(), 5)), g1)
    np.testing.assert_array_equal(whole.positions, again.positions)


def others(archive):
    """Add the arrays of GMR but one."""
    for name, value in gmr().items():
        if name != "dof_pos":
            array = io.BytesIO()
            np.save(array, np.asarray(value))
            archive.writestr(f"{name}.npy", array.getvalue())


def claims(shape):
    """Make an npz whose header claims more than there is."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        others(archive)
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(
            header, {"descr": "<f8", "fortran_order": False, "shape": shape}
        )
        archive.writestr("dof_pos.npy", header.getvalue() + bytes(80))
    return file.getvalue()


ROW = ",".join(["0", "0", "0.8", "0", "0", "0", "1", *["0.1"] * 29])


def npy():
    """Make an array in a file of its own."""
    file = io.BytesIO()
    np.save(file, np.zeros(3))
    return file.getvalue()


def zipped(name):
    """Make a zip file of something else than arrays."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(name, b"")
    return file.getvalue()


def nested(depth):
    """Make lists whose flat form has ten to the depth numbers, from few objects."""
    found = [1.0] * 10
    for _ in range(depth):
        found = [found] * 10
    return found


TWO_BODIES = {
    "fps": 50,
    "joint_pos": np.zeros((3, 29)),
    "body_pos_w": np.full((3, 30, 3), np.nan),
    "body_quat_w": np.tile([1.0, 0, 0, 0], (3, 30, 1)),
}
BAD = {
    "body nan": (lambda: npz(**TWO_BODIES), "body_pos_w must be fin"),
    "alias": (
        lambda: pickle.dumps({**gmr(), "dof_pos": nested(9)}),
        "must contain numbers",
    ),
    "names": ("joint_names: [&a x, *a]\npoints: []\n", "Line 1 has an anchor"),
    "no list": ("joint_names: x\npoints: []\n", "joint_names must be a list"),
    "nothing": ("time\n0\n1\n", "neither joints nor a base"),
    "empty": ("", "is empty"),
    "urdf": (
        '<?xml version="1.0"?>\n<!-- <sdf>\n -->\n<robot name="a"><mujoco/></robot>\n',
        r"^motion: This is a robot description \(URDF\)\.$",
    ),
    "xml": ("<package/>", "This is XML with the root <package>"),
    "json": ('{"a": [1, 2]}\n', "This is JSON"),
    "HDF5": (b"\x89HDF\r\n\x1a\n" + b"\x00\xff" * 100, "HDF5 is not read; save"),
    "sqlite": (b"SQLite format 3\0\x01", "SQLite is not read; convert it to MCAP"),
    "line": (b"time,a\n0,\x80", r"UTF-8 text .see line 2\)"),
    "zip": (lambda: zipped("motion.csv"), "a zip file without arrays"),
    "pointer": (
        "version https://git-lfs.github.com/spec/v1\n",
        "Git LFS pointer: run git lfs",
    ),
    "array missing": (
        lambda: npz(fps=1.0, root_pos=1.0, root_rot=1.0),
        "^motion: The array dof_pos is missing; the file has fps, root_pos, root_rot",
    ),
    "points missing": (
        "joint_names: [a]\n",
        "^motion: This is YAML, but not a JointTrajectory: 'points' is missing",
    ),
    "nan": (f"{ROW}\n{ROW.replace('0.8', 'nan')}\n", "Line 2 has a number that is not"),
    "word": (f"{ROW}\n{ROW.replace('0.8', 'up')}\n", "expected a number .got 'up'"),
    "short": (
        f"{ROW}\n{ROW}\n0,0,0\n",
        "Line 3 has 3 columns; the lines before",
    ),
    "norm": (
        ROW.replace("0,0,0,1", "0,0,0,2"),
        "quaternion of sample 1 must have length 1 .got 2",
    ),
    "headless": (",".join(["0.5"] * 12), "has 5 unnamed joints"),
    "twice": ("time,a,a\n0,1,2\n", "duplicate columns: a"),
    "backward": ("time,left_elbow_joint\n1,0\n0,0\n", "must increase"),
    "strangers": ("time,a,b\n0,1,2\n", "none of the motion's joints, a, b"),
    "claims": (lambda: claims((10**9, 10)), "The file cannot be read"),
    "objects": (
        lambda: npz(**{**gmr(), "dof_pos": np.array([{}])}),
        "dof_pos must contain numbers",
    ),
    "shape": (
        lambda: pickle.dumps({**gmr(), "root_pos": np.zeros((2, 3))}),
        "root_pos",
    ),
    "cut": (lambda: pickle.dumps(gmr())[:-30], "ends too early"),
    "yaml": ("joint_names: [a\npoints: {", "Line 2 is not valid YAML: "),
    "point": (ECHO.replace("[1.0, 0.25]", "[1.0]"), "Point 2 must have 2 positions"),
    "bag": (b"#ROSBAG V2.0\n", "The bag cannot be read"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_file_without_a_motion_is_refused_in_a_sentence_and_at_once(g1, file, case):
    content, words = BAD[case]
    path = file(content() if callable(content) else content)
    begin = time.process_time()
    with pytest.raises(MotionError, match=words) as error:
        read_motion(path, g1)
    assert time.process_time() - begin < 5.0
    sentence = str(error.value)
    assert sentence.startswith("motion: ")
    assert "\n" not in sentence
    assert len(sentence) < 500
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 1_000_000


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("n.npz", "Not a valid npz file, but text\\."),
        ("n.pkl", "Not a valid pkl file, but"),
        ("n.yaml", "Not YAML of a JointTrajectory: expected keys"),
    ],
)
def test_a_table_by_the_name_of_another_format_is_refused(g1, file, name, words):
    with pytest.raises(MotionError, match=words):
        read_motion(file("time,left_elbow_joint\n0,0\n", name), g1)
    with pytest.raises(MotionError, match=f"{name}: The file is empty"):
        read_motion(file("", name), g1)


@pytest.mark.parametrize("prefix", ["", "pelvis_"])
def test_the_base_may_have_any_prefix(g1, file, prefix):
    parts = ("x", "y", "z", "qx", "qy", "qz", "qw")
    names = ",".join(prefix + part for part in parts)
    text = f"time,{names},left_elbow_joint\n0,1,2,3,0,0,0,1,0.5\n"
    motion = read_motion(file(text, "based.csv"), g1)
    assert motion.base_poses.tolist() == [[1, 2, 3, 0, 0, 0, 1]]
    assert motion.joint_names == ("left_elbow_joint",)
    told = "pelvis_x ... pelvis_qw are read as those of the base."
    assert (told in motion.notes) == (prefix == "pelvis_")


@pytest.mark.parametrize("speed", [0, 1])
def test_velocities_that_are_all_zero_though_joints_move_are_unknown(g1, file, speed):
    rows = f"0,0,{speed}\n1,1,0\n2,1,0\n"
    text = f"time,left_elbow_joint,left_elbow_joint.velocity\n{rows}"
    motion = read_motion(file(text, "streamed.csv"), g1)
    assert (motion.velocities is not None) == bool(speed)


def test_folders_pipes_and_large_files_are_told(g1, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    large = tmp_path / "large"
    with open(large, "wb") as stream:
        stream.truncate(10_000_000_000)
    for path, words in (
        (tmp_path, "folder is not of a known format"),
        (pipe, "is not a file"),
        (large, "has 10000 MB"),
        (tmp_path / "nothing", "does not exist"),
    ):
        with pytest.raises(MotionError, match=words):
            read_motion(path, g1)
