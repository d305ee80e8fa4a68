"""The command motion: what it prints, writes, keeps and refuses."""

import json
import os
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

from checked import ARM, POST, write_motions
from forked import run_forked

from g1_description import Robot
from g1_description.cli import motion, start
from g1_description.errors import InvalidValueError
from g1_description.motion.files import formats
from g1_description.motion.files.conventions import G1_JOINTS
from g1_description.motion.files.format import Format
from g1_description.motion.motion import Motion


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Give a folder to work in, with a robot."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "post.urdf").write_text(POST)
    return tmp_path


def run(command, *arguments, model="post.urdf"):
    """Run the command in this process; return what it ends with."""
    return motion.run(motion.parsed([command, "--model", model, *map(str, arguments)]))


def refused(capsys, monkeypatch, *arguments):
    """Run the command where it is refused; return the sentence."""
    monkeypatch.setattr(motion, "own_arguments", lambda: [*arguments])
    with pytest.raises(SystemExit) as end:
        motion.main()
    assert end.value.code == 2
    output = capsys.readouterr()
    assert output.out == ""
    (line,) = output.err.splitlines()
    return line


def post():
    return Robot(POST).description


def read(path):
    return formats.read_motion(path, post())


@pytest.mark.parametrize("begin", [0.0, 100.0])
def test_a_motion_is_described(folder, capsys, begin):
    begun_at(begin, *write_motions(folder, 0.5))
    assert run("info", "motion0.csv") == 0
    assert capsys.readouterr().out.splitlines() == [
        "motion0.csv: table, 1 joints, base, no velocities, 51 samples at 50 Hz, "
        "1.00 s",
        "  top speeds: base 0 m/s, arm_joint 1.57 rad/s",
        "  joints: those of post",
    ]


def test_as_json_a_line_has_all_facts_or_the_problem(folder, capsys):
    write_motions(folder, 0.5)
    (folder / "other.csv").write_text("time,arm_joint\n0,x\n")
    assert run("info", "--json", ".") == 1
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert (first["file"], first["format"]) == ("motion0.csv", "table")
    assert (first["joints"], first["samples"], first["rate"]) == ([ARM], 51, 50.0)
    assert first["top_joint_speed"]["joint"] == ARM
    assert first["has_base"] and first["is_even"] and not first["has_velocities"]
    assert second == {
        "file": "other.csv",
        "problem": "Line 2: expected a number (got 'x').",
    }


EDITS = {
    "convert": ([], 51, 1.0),
    "cut": (["--from", "0.2", "--until", "0.6"], 21, 0.4),
    "mirror": ([], 51, 1.0),
    "retime": (["--speed", "2"], 51, 0.5),
    "retime longer": (["--duration", "3"], 51, 3.0),
    "retime fastest": (["--fastest"], 51, None),
    "resample": (["--rate", "10"], 11, 1.0),
    "pad": (["--begin", "zero", "--end", "zero", "--seconds", "0.2"], 71, 1.4),
    "floor": ([], 51, 1.0),
    "join": (["motion1.csv"], 102, 2.02),
    "join blended": (["motion1.csv", "--blend", "0.5", "--stay"], 76, 1.5),
}


def begun_at(begin, file):
    """Let a motion begin at another time than 0 s."""
    found = read(file)
    later = replace(found, times=begin + found.times)
    formats.write_motion(file, later, post())


@pytest.mark.parametrize("what", EDITS)
@pytest.mark.parametrize(("ending", "begin"), [("npz", 0.0), ("csv", 100.0)])
def test_a_motion_is_edited_and_written(folder, capsys, what, ending, begin):
    for file in write_motions(folder, 0.5, 0.3):
        begun_at(begin, file)
    words, n_samples, duration = EDITS[what]
    if what == "cut":
        words = [w if w.startswith("--") else str(begin + float(w)) for w in words]
    out = f"out.{ending}"
    assert run(what.split()[0], "motion0.csv", *words, "--out", out) == 0
    found = read(folder / out)
    assert len(found.times) == n_samples and (begin or found.begin == 0.0)
    if duration:
        assert found.duration == pytest.approx(duration)
        assert f"{n_samples} samples, {duration:.2f} s" in capsys.readouterr().out
    else:  # the limit is 3 rad/s
        top = np.abs(np.diff(found.positions[:, 0]) / np.diff(found.times)).max()
        assert top == pytest.approx(3.0, rel=1e-3)


def test_a_joint_is_renamed_before_others_are_left_out(folder):
    text = "time,upper,lower\n0,0.1,0.5\n1,0.2,0.6\n"
    (folder / "a.csv").write_text(text)
    assert run("rename", "a.csv", "--names", f"lower={ARM}", "--out", "b.csv") == 0
    found = read(folder / "b.csv")
    np.testing.assert_array_equal(found.positions[:, 0], [0.5, 0.6])
    assert found.joint_names == (ARM,)


def test_joints_are_chosen_and_ordered_as_isaac_lab_does(folder, capsys):
    robot = Robot()
    poses = robot.random_configuration(3, 4)
    whole = robot.trajectory(np.arange(4) / 30, poses)
    robot.write_motion(folder / "whole.csv", whole)
    g1 = "package://g1_description/urdf/g1_29dof.urdf"
    words = ["--joints", "asap", "--joint-order", "isaaclab", "--out", "a.csv"]
    assert run("convert", "whole.csv", *words, model=g1) == 0
    told = capsys.readouterr().out
    assert "note: Ignored joints: left_wrist_roll_joint (up to " in told
    names = (folder / "a.csv").read_text().split("\n")[0].split(",")[1:]
    assert len(names) == 23
    assert names[:4] == [
        "left_hip_pitch_joint",
        "right_hip_pitch_joint",
        "waist_yaw_joint",
        "left_hip_roll_joint",
    ]
    words = ["--joints", "29", "--joint-order", "mujoco", "--out", "b.csv"]
    assert run("convert", "a.csv", *words, model=g1) == 0
    assert "note: Joints added at 0: left_wrist_roll_joint" in capsys.readouterr().out
    back = robot.read_motion(folder / "b.csv")
    assert back.joint_names == robot.joint_names
    kept = ["wrist" not in name for name in robot.joint_names]
    np.testing.assert_array_equal(back.positions, poses * kept)


def test_a_folder_is_converted_and_gone_on_with(folder, capsys):
    (folder / "in" / "deeper").mkdir(parents=True)
    write_motions(folder / "in", 0.1, 0.2)
    write_motions(folder / "in" / "deeper", 0.3)
    (folder / "in" / "bad.csv").write_text("time,arm_joint\n0,x\n")
    (folder / "out" / "deeper").mkdir(parents=True)
    (folder / "out" / "deeper" / "motion0.npz").write_text("kept")
    words = ["in", "--out", "out", "--to", "npz", "--jobs", 1]
    assert run("convert", *words) == 1
    output = capsys.readouterr()
    assert output.out.splitlines() == [
        "in/bad.csv: Line 2: expected a number (got 'x').",
        "in/motion0.csv -> out/motion0.npz: 51 samples, 1.00 s",
        "in/motion1.csv -> out/motion1.npz: 51 samples, 1.00 s",
    ]
    assert output.err == (
        "motion: 4 motions: 2 written, 1 failed, 1 exist and were kept, --force "
        "replaces them.\n"
    )
    assert (folder / "out" / "deeper" / "motion0.npz").read_text() == "kept"
    found = sorted(p.name for p in (folder / "out").rglob("*") if p.is_file())
    assert found == ["motion0.npz", "motion0.npz", "motion1.npz"]
    assert run("convert", *words, "--force") == 1
    assert read(folder / "out" / "deeper" / "motion0.npz").positions.max() == 0.3


def test_a_rate_in_a_name_is_that_of_the_motion(folder, capsys):
    """Tables without a header have no other place for it."""
    write_motions(folder, 0.1)
    (folder / "in").mkdir()
    assert run("convert", "motion0.csv", "--out", "in/a_60hz.npz") == 0
    words = ["in", "--out", "out", "--to", "lafan1"]
    assert run("convert", *words) == 0
    assert "note" not in capsys.readouterr().out.splitlines()[-1]
    (path,) = (folder / "out").iterdir()
    assert path.name == "a_50hz.csv"
    back = read(path)
    assert back.times[-1] == 1.0
    np.testing.assert_allclose(back.positions, read(folder / "motion0.csv").positions)
    assert run("convert", *words) == 0
    assert "a_50hz.csv exists and was kept" in capsys.readouterr().out
    assert run("convert", "in/a_60hz.npz", "--out", "b_60hz.csv", "--to", "lafan1") == 0
    assert "--fps 50, as 60 Hz, as in its name, are" in capsys.readouterr().out
    assert run("retime", *words, "--speed", "1.1") == 0
    assert (folder / "out" / "a_55hz.csv").exists()
    (folder / "in" / "a_30hz.npz").write_bytes((folder / "in/a_60hz.npz").read_bytes())
    assert run("convert", *words, "--force") == 1
    assert "a_50hz.csv has another motion already" in capsys.readouterr().out


def test_files_with_other_extensions_are_counted(folder, capsys):
    write_motions(folder, 0.1, 0.2)
    (folder / "notes.txt").write_text("mine")
    assert run("info", ".") == 0
    told = capsys.readouterr().err
    assert told == "motion: 2 motions: 2 read; ignored 2 with other extensions.\n"


def test_a_library_has_the_motions_own_names(folder, capsys):
    write_motions(folder, 0.1, 0.2)
    (folder / "deeper").mkdir()
    write_motions(folder / "deeper", 0.3)
    words = [".", "--out", "all.pkl", "--to", "motion_library"]
    assert run("convert", *words) == 0
    assert formats.motion_names(folder / "all.pkl") == (
        *("motion0", "motion1", "deeper/motion0"),
    )
    for name, reach in (("motion0", 0.1), ("motion1", 0.2), ("deeper/motion0", 0.3)):
        found = read(folder / f"all.pkl#{name}")
        assert found.positions.max() == pytest.approx(reach)
    with pytest.raises(InvalidValueError, match=r"all.pkl exists; --force"):
        run("convert", *words)
    words = ["all.pkl", "--all", "--out", "out", "--to", "motion_library"]
    assert run("convert", *words) == 0
    path = folder / "out" / "all" / "deeper_motion0.pkl"
    assert formats.motion_names(path) == ("deeper/motion0",)
    words[3] = "again.pkl"
    assert run("convert", *words) == 0
    names = formats.motion_names(folder / "again.pkl")
    assert names == formats.motion_names(folder / "all.pkl")


def test_files_with_fewer_joints_are_told(folder, capsys):
    robot = Robot()
    base = np.tile([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0], (4, 1))
    whole = robot.trajectory(np.arange(4) / 50, np.zeros((4, 29)), None, base)
    part = whole.arranged(G1_JOINTS[23])
    for name, each in (("a", whole), ("b", part)):
        robot.write_motion(folder / "in" / f"{name}.csv", each)
    g1 = "package://g1_description/urdf/g1_29dof.urdf"
    for to in ("csv", "mjlab"):
        assert run("convert", "in", "--out", to, "--to", to, model=g1) == 0
        assert capsys.readouterr().err.splitlines()[-1] == (
            "motion: 1 files have fewer joints than 29: in/b.csv. To write all, "
            "missing ones at 0: convert --joints 29."
        )
    words = ["in", "--out", "d", "--to", "mjlab", "--joints", "29"]
    assert run("convert", *words, model=g1) == 0
    assert "fewer joints" not in capsys.readouterr().err


def test_a_motion_is_joined_as_often_as_it_is_given(folder, capsys):
    write_motions(folder, 0.5, 0.3)
    words = ["motion0.csv", "motion1.csv", "motion0.csv", "--out", "a.csv"]
    assert run("join", *words) == 0
    assert capsys.readouterr().out.startswith("3 motions -> a.csv: 153 samples")
    assert run("join", "motion0.csv", "motion0.csv", "--out", "b.csv") == 0
    found = read(folder / "b.csv").positions[:, 0]
    np.testing.assert_array_equal(found[:51], found[51:])


def several(source):
    return source.text.split()[1:]


def read_one(source, robot):
    reach = float(source.chosen(several(source)).replace("to/", ""))
    return Motion(np.arange(2.0), (ARM,), np.array([[0.0], [reach]]))


SEVERAL = Format(
    "several",
    lambda source: (source.text or "").startswith("several:"),
    read_one,
    names=several,
)


@pytest.fixture
def motions(folder, monkeypatch):
    """Give a file of three motions, in a format of its own."""
    known = {"several": SEVERAL, **formats.FORMATS}
    monkeypatch.setattr(formats, "FORMATS", known)
    (folder / "set.txt").write_text("several: to/0.1 0.2 0.3")
    return folder


def test_one_or_all_motions_of_a_file_are_taken(motions, capsys):
    assert run("convert", "set.txt#0.2", "--out", "a.csv") == 0
    assert read(motions / "a.csv").positions[1] == 0.2
    assert run("convert", "set.txt", "--all", "--out", "out", "--to", "csv") == 0
    found = sorted(path.name for path in (motions / "out" / "set").iterdir())
    assert found == ["0.2.csv", "0.3.csv", "to_0.1.csv"]
    capsys.readouterr()
    assert run("info", "set.txt") == 2
    assert "set.txt: The file has several motions" in capsys.readouterr().out
    assert run("info", "set.txt#to/9") == 2
    told = capsys.readouterr().out
    assert told.startswith("set.txt#to/9: There is no motion 'to/9'; to/0.1, 0.2, 0.3.")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("", "a command is missing; see motion -h."),
        ("cut motion0.csv --out a.csv", "give --from, --until or both"),
        ("pad motion0.csv --out a.csv", "give --begin, --end or both"),
        ("retime motion0.csv --out a.csv", "give one of --speed, --duration and"),
        ("rename motion0.csv --out a.csv --names a", "must be OLD=NEW,..."),
        ("join motion0.csv --out a.csv", "join needs at least two motions."),
        ("convert none.csv --out a.csv", "none.csv does not exist."),
        ("convert motion.csv --out a.csv", "motion.csv does not exist (did you mean"),
        ("convrt motion0.csv", "(did you mean convert?)"),
        ("convert motion0.csv --out a.npz --to mjlb", "(did you mean mjlab?)"),
        ("convert motion0.csv --out post.csv", "post.csv exists; --force replaces it."),
        ("convert motion0.csv --out a.txt", "it must end in .csv or"),
        ("convert motion0.csv --out out", "--to must name the format: csv, "),
        ("convert . --out a.csv", "--out must be a folder for 2 motions"),
        (
            "convert motion0.csv --out a.pkl --joint-order isaaclab",
            "--joint-order is for csv, npz, bag, mcap: the format gmr has one order",
        ),
    ],
)
def test_what_cannot_be_done_is_told_in_a_line(
    folder, capsys, monkeypatch, words, told
):
    write_motions(folder, 0.5)
    (folder / "post.csv").write_text("mine")
    before = sorted(folder.iterdir())
    given = words.split()
    given[1:1] = ["--model", "post.urdf"] if given[1:] else []
    line = refused(capsys, monkeypatch, *given)
    assert line.startswith("motion")
    assert told in line
    assert sorted(folder.iterdir()) == before
    assert (folder / "post.csv").read_text() == "mine"


def test_ctrl_c_leaves_whole_files(folder, monkeypatch):
    """It comes to the whole group with the first outcome, as from a terminal."""
    (folder / "in").mkdir()
    write_motions(folder / "in", *20 * [0.3])
    words = ["--out", "out", "--to", "npz", "--jobs", "2"]
    words += ["--model", "post.urdf"]

    class Interrupted(motion.Printer):
        def add(self, number, text):
            super().add(number, text)
            os.killpg(0, signal.SIGINT)

    def main():
        os.setpgrp()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.argv[1:] = ["convert", "in", *words]
        start.run("motion")

    monkeypatch.setattr(motion, "Printer", Interrupted)
    done = run_forked(main)
    assert done.returncode == 130, done.stderr
    files = [path for path in (folder / "out").iterdir()]
    assert 0 < len(files) < 20
    assert all(len(read(path).times) == 51 for path in files)
    assert f"{len(files)} written, {20 - len(files)} not done" in done.stderr
