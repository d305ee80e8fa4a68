"""What check --against prints and writes."""

import json
import pickle
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

from checked import POST, post_motion

from g1_description.cli import check
from g1_description.cli.check import CheckOptions
from g1_description.command_line import EXIT_ERROR, parse
from g1_description.motion.files import table


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Give a folder with a reference and an execution that is 0.2 s late."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "post.urdf").write_text(POST)
    for name in ("wanted", "runs"):
        (tmp_path / name).mkdir()
    motion = post_motion()
    late = replace(motion, times=motion.times + 0.2, positions=motion.positions + 0.01)
    for file, each in (("wanted/a", motion), ("runs/a", late), ("runs/b", late)):
        (tmp_path / f"{file}.csv").write_bytes(table.write(each, None, None)[0])
    return tmp_path


def run(*words):
    return check.check(parse(CheckOptions, "check", [*words]))


def test_one_execution_is_compared_in_full(folder, capsys):
    words = ["--model", "post.urdf", "--against", "wanted/a.csv"]
    assert run(*words, "runs/a.csv", "--shift", "0.2") == 0
    output = capsys.readouterr().out
    assert "runs/a.csv: 1 joints compared for 1.00 s, shifted by +0.200 s" in output
    assert re.search(r"arm_joint +0\.0100 +0\.0100", output)


def test_folders_are_compared_by_name_in_a_table_and_as_json(folder, capsys):
    words = ["--model", "post.urdf", "--against", "wanted", "runs", "--json"]
    assert run(*words, "-") == EXIT_ERROR
    a, b = json.loads(capsys.readouterr().out)
    assert a["shift"] == pytest.approx(0.2, abs=0.02)
    assert a["joints"]["arm_joint"]["rms"] == pytest.approx(0.01, rel=0.2)
    assert b == {"file": "runs/b.csv", "problem": "no motion is called b in wanted"}
    assert run(*words, "out.json") == EXIT_ERROR
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].split()[:2] == ["runs/a.csv", f"{a['shift']:+.3f}"]
    assert "no motion is called b in wanted" in lines[2]


def test_motions_in_files_of_several_are_paired_by_their_names(folder, capsys):
    for name, delay in (("wanted", 0.0), ("runs", 0.2)):
        (folder / name / "a.csv").unlink()
        motion = post_motion()
        motion = replace(motion, times=motion.times + delay)
        entry = {
            "root_trans_offset": motion.base_poses[:, :3],
            "root_rot": motion.base_poses[:, 3:],
            "dof": motion.positions,
            "pose_aa": np.zeros((len(motion.times), 2, 3)),
            "fps": 50,
        }
        (folder / name / "lib.pkl").write_bytes(pickle.dumps({"x": entry, "y": entry}))
    (folder / "runs" / "b.csv").unlink()
    words = ["--model", "post.urdf", "--against", "wanted", "runs", "--all"]
    assert run(*words, "--json", "-") == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["file"] for row in found] == ["runs/lib.pkl#x", "runs/lib.pkl#y"]


def test_motions_of_the_same_name_are_paired_by_their_folders(folder, capsys):
    for place in ("wanted", "runs"):
        for below in ("x", "y"):
            (folder / place / below).mkdir()
            shutil.copy(folder / place / "a.csv", folder / place / below)
        (folder / place / "a.csv").unlink()
    still = post_motion(0.0)
    (folder / "wanted/y/a.csv").unlink()
    (folder / "wanted/y/a.csv").write_bytes(table.write(still, None, None)[0])
    words = ["--model", "post.urdf", "--shift", "0.2", "--against", "wanted", "--json"]
    assert run(*words, "-", "runs/x", "runs/y") == 0
    x, y = json.loads(capsys.readouterr().out)
    assert x["joints"]["arm_joint"]["rms"] == pytest.approx(0.01)
    assert y["joints"]["arm_joint"]["rms"] > 0.1
    assert run(*words, "-", "runs/b.csv") == EXIT_ERROR


@pytest.mark.parametrize(
    "words",
    [
        ("--against", "wanted", "runs", "--html", "x.html"),
        ("--against", "wanted", "runs", "--jobs", "2"),
        ("--shift", "0.1", "runs"),
    ],
)
def test_options_that_would_do_nothing_are_refused(folder, words):
    with pytest.raises(SystemExit) as end:
        run(*words)
    assert end.value.code == EXIT_ERROR
