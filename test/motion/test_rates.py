"""Rates of motions: in names of files, as periods, as text, or told."""

import io
import pickle
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY

from g1_description.errors import MotionError
from g1_description.motion.files.conventions import G1_JOINTS
from g1_description.motion.files.formats import (
    WRITERS,
    motion_names,
    read_motion,
    write_motion,
)
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.motion import Motion
from g1_description.motion.paths import rate_in, with_rate
from g1_description.robot.load import read_model

JOINTS = G1_JOINTS[29]
N = 6


@pytest.fixture(scope="module")
def g1():
    return read_model(str(REPOSITORY / "urdf" / "g1_29dof.urdf")).description


@pytest.mark.parametrize(
    "name, rate",
    [
        ("walk.bvh_60hz.csv", 60),
        ("m41_50fps.csv", 50),
        ("w-50Hz.csv", 50),
        ("50hz_w.csv", 50),
        ("w_fps50.csv", 50),
        ("w50hz.csv", 50),
        ("w_hz_120_b.csv", 120),
        ("0005_Walking001_poses_120_jpos.npy", 120),
        ("w_50hz_b_50hz.csv", 50),
        ("w_60hz_to_50hz.csv", None),
        ("v1.50hz.csv", None),
        ("a_000hz.csv", None),
        ("a_50hzx.csv", None),
        ("fps.csv", None),
        ("walk_120.csv", None),
    ],
)
def test_a_rate_in_a_name_is_found_and_replaced(name, rate):
    path = Path("deeper") / name
    assert rate_in(path) == rate
    assert with_rate(path, rate or 50.0) == path or rate is None
    if rate is not None:
        assert rate_in(with_rate(path, 25.0)) == 25.0
        assert rate_in(with_rate(path, 29.97)) is None
        assert with_rate(path, 25.0).suffix == path.suffix


def test_a_rate_that_no_name_can_have_is_left_out():
    assert with_rate(Path("a_60hz.csv"), 29.97) == Path("a.csv")
    assert with_rate(Path("60hz.csv"), 29.97) == Path("60hz.csv")


def motion(rate):
    base = np.tile([0.0, 0.0, 0.78, 0.0, 0.0, 0.6, 0.8], (N, 1))
    positions = np.zeros((N, 29))
    positions[:, JOINTS.index("left_elbow_joint")] = np.linspace(0.0, 0.5, N)
    return Motion(np.arange(N) / rate, JOINTS, positions, base_poses=base)


@pytest.mark.parametrize("name", ["a", "a_60hz"])
@pytest.mark.parametrize("to", ["lafan1", "kimodo", "bones_seed", "gmr", "mjlab"])
def test_what_is_written_is_read_at_its_rate_or_that_is_told(g1, tmp_path, to, name):
    rate = 29.97
    path = tmp_path / (name + WRITERS[to].ending)
    (notes,) = [write_motion(path, motion(rate), g1, name=to)]
    told = [note for note in notes if "read it with --fps" in note]
    back = read_motion(path, g1)
    is_right = abs(back.times[1] - 1.0 / rate) < 1e-6
    assert is_right == (not told)
    if told:
        assert f"--fps {rate:g}," in told[0]
        assert f"as {1.0 / back.times[1]:g} Hz" in told[0]
    renamed = WRITERS[to].place(path, motion(rate))
    assert (
        not write_motion(renamed, motion(rate), g1, name=to)
        or rate != 60.0
        or (name == "a" or to == "mjlab")
    )


def gmr(**changed):
    found = motion(30.0)
    arrays = {
        "fps": 30,
        "root_pos": found.base_poses[:, :3],
        "root_rot": found.base_poses[:, 3:],
        "dof_pos": found.positions,
    }
    return {**arrays, **changed}


@pytest.mark.parametrize(
    "fps, rate", [("30", 30.0), (1 / 30, 30.0), (np.float32(0.02), 50.0), (0.1, 10.0)]
)
def test_a_rate_may_be_text_or_a_period(g1, file, fps, rate):
    found = read_motion(file(pickle.dumps(gmr(fps=fps))), g1)
    assert found.times[1] == pytest.approx(1.0 / rate, rel=1e-6)
    is_period = not isinstance(fps, str)
    assert ("is taken for the period" in " ".join(found.notes)) == is_period


def test_a_rate_that_may_be_none_is_told_or_refused(g1, file):
    slow = read_motion(file(pickle.dumps(gmr(fps=0.5))), g1)
    assert slow.times[1] == 2.0
    assert "i.e. one sample every 2 s" in slow.notes[0]
    for wrong in ("fast", "", "nan", "3" * 1000):
        with pytest.raises(MotionError, match=r"^motion: fps must"):
            read_motion(file(pickle.dumps(gmr(fps=wrong))), g1)


@pytest.mark.parametrize("several", [dict, list])
def test_several_motions_of_gmr_may_be_in_a_pickle(g1, file, several):
    motions = {"0": gmr(), "1": gmr(fps=50)}
    content = motions if several is dict else [*motions.values()]
    path = file(pickle.dumps(content), "two.pkl")
    assert motion_names(path) == ("0", "1")
    with pytest.raises(MotionError, match=r"several motions: 0, 1.*'two.pkl#0'"):
        read_motion(path, g1)
    assert read_motion(path.with_name("two.pkl#1"), g1).times[1] == 0.02


def headed(prefix="base_", joints=JOINTS, first=()):
    found = motion(30.0)
    names = [prefix + part for part in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    columns = [np.arange(N)[:, np.newaxis]] * len(first)
    rows = np.concatenate([*columns, found.base_poses, found.positions], axis=1)
    lines = [",".join([*first, *names, *joints])]
    return "\n".join([*lines, *(",".join(map(repr, row)) for row in rows.tolist())])


@pytest.mark.parametrize("prefix", ["base_", ""])
def test_a_table_with_names_and_without_times_takes_a_rate(g1, file, prefix):
    """Also with the index of pandas before its columns."""
    path = file(headed(prefix, first=("",)), "a.csv")
    with pytest.raises(MotionError, match=r"lacks time; or give the rate, --fps\."):
        read_motion(path, g1)
    found = read_motion(path, g1, ReadOptions(25.0))
    assert found.times[1] == 0.04
    assert found.joint_names == JOINTS
    np.testing.assert_array_equal(found.base_poses, motion(30.0).base_poses)
    named = read_motion(file(headed(prefix, first=("",)), "a_50hz.csv"), g1)
    assert named.times[1] == 0.02
    timed = file(headed(prefix, first=("time",)), "b.csv")
    assert (
        "--order is ignored"
        in read_motion(timed, g1, ReadOptions(order="wxyz")).notes[0]
    )


def test_a_table_that_pandas_has_numbered_is_read(g1, file):
    content = headed("", map(str, range(7, 36)), ("",))
    for number, part in enumerate(("x", "y", "z", "qx", "qy", "qz", "qw")):
        content = content.replace(f",{part},", f",{number},", 1)
    found = read_motion(file(content), g1)
    np.testing.assert_array_equal(found.positions, motion(30.0).positions)
    np.testing.assert_array_equal(found.base_poses, motion(30.0).base_poses)


def test_separators_of_other_tables_are_told(g1, file):
    rows = headed().splitlines()[1:]
    for content, words in (
        ("\n".join(f"{row}," for row in rows), "Line 1 ends in a comma; columns must"),
        ("\n".join(rows).replace(",", ";"), "columns must be separated by commas"),
        ("\n".join(rows).replace(",", " "), "columns must be separated by commas"),
    ):
        with pytest.raises(MotionError, match=words):
            read_motion(file(content), g1)


def test_a_file_that_was_cut_ends_too_early(g1, file):
    stream = io.BytesIO()
    found = motion(30.0)
    np.savez(stream, qpos=np.zeros((N, 36)), fps=30)
    rows = io.BytesIO()
    np.save(rows, np.concatenate([found.base_poses, found.positions], axis=1))
    nested = pickle.dumps({"loop_mode": 1, "fps": 30, "frames": [[0.5] * 36] * 99})
    for whole in (
        *(pickle.dumps(gmr(), protocol) for protocol in (2, 3, 4, 5)),
        *(stream.getvalue(), rows.getvalue(), nested),
    ):
        for share in (0.5, 0.8, 0.95):
            with pytest.raises(MotionError, match="ends too early"):
                read_motion(file(whole[: int(share * len(whole))]), g1)
