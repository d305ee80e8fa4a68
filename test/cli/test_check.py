"""The command check: what it refuses, prints and writes, and what it ends with."""

import csv
import json
import os
import re
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

from checked import ARM, POST, post_motion, write_motions
from forked import run_forked
from waiting import wait_for

from g1_description.cli import check, start
from g1_description.cli.check import EXIT_ERROR, CheckOptions
from g1_description.cli.motion_paths import motion_files, picture_names
from g1_description.command_line import parse
from g1_description.errors import InvalidValueError
from g1_description.motion.selection import Choice, Selection

PASSES, FAILS = 0.3, 1.5
BOX = """<visual><geometry><box size="0.4 0.4 0.1"/></geometry>
  <material name="red"><color rgba="1 0 0 1"/></material></visual>"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Give a folder to work in, with a robot."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "post.urdf").write_text(POST)
    return tmp_path


def run(*arguments):
    """Run the command in this process; return what it ends with."""
    words = ["--model", "post.urdf", *map(str, arguments)]
    return check.check(parse(CheckOptions, "check", words))


def refused(capsys, *arguments):
    """Run the command where it is refused; return the sentence."""
    given = ["--model", "post.urdf", *arguments]
    with pytest.raises(SystemExit) as end:
        check.main(parse(CheckOptions, "check", given))
    assert end.value.code == EXIT_ERROR
    output = capsys.readouterr()
    assert output.out == ""
    (line,) = output.err.splitlines()
    return line


def test_a_scene_is_known_in_all_processes(folder, capsys):
    files = write_motions(folder, PASSES, 0.0)
    Path("scene.yaml").write_text(
        "boxes: {wall: {size: [1, 1, 1], at: [0.62, 0, 0.7]}}"
    )
    assert run(*files, "--scene", "scene.yaml", "--jobs", 2, "--html", "out.html") == 1
    text = capsys.readouterr().out
    assert "arm penetrates wall by 0.0" in text and "1 passed, 1 failed" in text
    assert "arm penetrates wall by 0.0" in Path("out.html").read_text()
    for file in files:  # taken where it is next to a single motion
        file.with_name(f"{file.stem}.scene.yaml").write_bytes(
            Path("scene.yaml").read_bytes()
        )
    assert [run(file) for file in files].count(1) == 1
    capsys.readouterr()
    Path("scene.yaml").write_text("attach: {wall: {link: hand}}")
    assert "scene.yaml" in refused(capsys, str(files[0]), "--scene", "scene.yaml")


@pytest.mark.parametrize(("reaches", "code"), [([PASSES], 0), ([PASSES, FAILS], 1)])
def test_the_exit_code_says_whether_a_motion_failed(folder, capsys, reaches, code):
    assert run(*write_motions(folder, *reaches)) == code
    output = capsys.readouterr().out
    assert output.count("passed, 1.00 s, 51 samples") == reaches.count(PASSES)
    assert output.count("failed, 1.00 s, 51 samples") == reaches.count(FAILS)


ACTORS = "file,actor\nwalk.csv,Jo\n"
"""A table that no motion is."""


OTHERS = {
    "actors.csv": (ACTORS, "Line 1 has the columns file, actor, but lacks time."),
    "gains.yaml": (
        "knee:\n  p: 10.0\n",
        "This is YAML, but not a JointTrajectory: 'joint_names' ",
    ),
}


def test_other_files_of_a_folder_are_told_and_change_nothing(folder, capsys):
    motions = folder / "motions"
    (motions / "deeper").mkdir(parents=True)
    write_motions(motions / "deeper", PASSES)
    for name, (text, _) in OTHERS.items():
        (motions / name).write_text(text)
    (motions / "notes.txt").write_text("a motion")
    (motions / ".hidden.csv").write_text("a,b\n1,2\n")
    assert run("motions") == 0
    output = capsys.readouterr().out
    for name, (_, problem) in OTHERS.items():
        assert f"motions/{name}: not a motion: {problem}" in output
    assert output.splitlines()[-1] == (
        "3 files: 1 passed, 2 not a motion; ignored 1 with other extensions."
    )


DAMAGED = {
    "word.csv": "time,arm_joint\n0,0\n0.1,x\n",
    "cut.csv": "time,arm_joint\n0,0\n0.1\n",
    "empty.csv": "",
    "cut.npz": "PK",
    "lfs.csv": "version https://git-lfs.github.com/spec/v1\noid sha256:0\n",
    "semicolons.csv": "time;arm_joint\n0;zero\n",
    "cut.yaml": "joint_names: [arm_joint]\npoints:\n- positions: [0.1\n",
    "table.npz": ACTORS,
    "of_ros_2.db3": "SQLite format 3\0",
}


def test_a_damaged_motion_of_a_folder_is_not_checked(folder, capsys):
    """Nor is one in a format that is not known; the exit code says so."""
    write_motions(folder, PASSES)
    for name, text in DAMAGED.items():
        (folder / name).write_text(text, encoding="latin-1")
    assert run(".") == EXIT_ERROR
    output = capsys.readouterr().out
    assert [name for name in DAMAGED if f"{name}: not read: " not in output] == []
    total = f"{len(DAMAGED) + 1} files: 1 passed, {len(DAMAGED)} not read"
    assert output.splitlines()[-1].startswith(total)


def test_what_was_meant_and_is_no_motion_is_an_error(folder, capsys):
    """A file that was named, or a folder without any motion."""
    name = "."
    (folder / "actors.csv").write_text(ACTORS)
    assert run(name) == EXIT_ERROR
    assert "actors.csv: not a motion: " in capsys.readouterr().out


def test_a_file_that_was_named_has_to_be_a_motion(folder, capsys):
    (folder / "actors.csv").write_text(ACTORS)
    assert run(*write_motions(folder, PASSES), "actors.csv") == EXIT_ERROR
    assert "1 passed, 1 not a motion" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["a.csv"], "check: a.csv does not exist."),
        (
            ["empty"],
            "check: The folder empty has no motions (files that end in .bag, .csv, ",
        ),
        (["motion0.csv", "--json", "no/a.json"], "check: The folder no for "),
        (["motion0.csv", "--json", "a.txt"], "check: --json must end in "),
        (["motion0.csv", "--jobs", "0"], "check: argument --jobs: must be a whole "),
        (["motion0.csv", "--only", "fall"], "check: --only fall needs --physics; "),
        (
            ["motion0.csv", "--only", "colision"],
            "check: argument --only: unknown check ",
        ),
        (
            ["motion0.csv", "--model", "no.urdf"],
            "check: Cannot use the model no.urdf: ",
        ),
        (["motion0.csv", "--thresholds", "post.urdf"], "check: post.urdf "),
        (
            ["motion0.csv", "motion1.csv", "--plot", "a.png"],
            "check: --plot must be a folder for ",
        ),
    ],
)
def test_bad_input_is_refused_in_a_sentence(folder, capsys, arguments, sentence):
    (folder / "empty").mkdir()
    write_motions(folder, PASSES, PASSES)
    before = sorted(folder.iterdir())
    assert refused(capsys, *arguments).startswith(sentence)
    assert sorted(folder.iterdir()) == before


def test_a_motion_that_begins_late_keeps_its_times(folder, capsys):
    (file,) = write_motions(folder, FAILS)
    header, *rows = file.read_text().splitlines()
    later = [
        f"{100.0 + float(time)},{rest}"
        for time, rest in (r.split(",", 1) for r in rows)
    ]
    file.write_text("\n".join([header, *later]))
    assert run(file, "--json", "a.json") == 1
    assert "failed, 1.00 s, 51 samples" in capsys.readouterr().out
    (found,) = json.loads((folder / "a.json").read_text())["files"]
    (far,) = (one for one in found["findings"] if one["check"] == "position")
    assert far["worst_time"] == pytest.approx(100.5)


def test_reports_are_written_and_stdout_is_theirs(folder, capsys):
    write_motions(folder, PASSES, FAILS)
    reports = ["--csv", "a.csv.csv", "--html", "a.html", "--plot", "plots"]
    files = ["motion0.csv", "motion1.csv"]
    assert run(*files, "--json", "-", *reports) == 1
    output = capsys.readouterr()
    found = json.loads(output.out)
    assert [entry["file"] for entry in found["files"]] == files
    assert [entry["result"] for entry in found["files"]] == ["passed", "failed"]
    assert found["files"][1]["findings"][0]["subject"] == ["arm_joint"]
    assert output.err == "2 files: 1 passed, 1 failed.\n"
    assert len((folder / "a.csv.csv").read_text().splitlines()) == 3
    pictures = sorted(path.name for path in (folder / "plots").iterdir())
    assert pictures == ["motion0.csv.png", "motion1.csv.png"]
    assert (folder / "a.html").read_text().count('"application/json">{') == 2


def test_thresholds_and_only_decide_what_is_judged(folder, capsys):
    (file,) = write_motions(folder, FAILS)
    assert run(file, "--only", "self_collision,floating") == 0
    (folder / "mine.yaml").write_text("position: {failure: 10.0}\n")
    assert run(file, "--only", "position", "--thresholds", "mine.yaml") == 0
    assert "warning" in capsys.readouterr().out


def test_each_file_is_checked_once_and_pictures_have_names_of_their_own(folder):
    for name in ("a", "b"):
        (folder / name).mkdir()
        write_motions(folder / name, PASSES)
    files = motion_files([Path("a"), Path("a/motion0.csv"), Path("b")])
    assert [task.name for task in files.tasks] == ["a/motion0.csv", "b/motion0.csv"]
    assert files.named == {"a/motion0.csv"}
    names = [str(name) for name in picture_names(files.tasks)]
    assert names == ["a/motion0.csv.png", "b/motion0.csv.png"]


def test_a_motion_that_nothing_can_be_said_of_has_not_passed(folder, capsys):
    (file,) = write_motions(folder, PASSES)
    assert run(file, "--only", "clearance") == EXIT_ERROR
    output = capsys.readouterr().out
    assert "not checked: All checks were skipped: " in output


def test_unknown_orders_and_formats_are_told(folder, capsys):
    line = refused(capsys, "a.csv", "--format", "qpso")
    assert "unknown format 'qpso'; formats: qpos, " in line
    line = refused(capsys, "a.csv", "--order", "zyxw")
    assert "invalid choice: 'zyxw'" in line


def test_all_motions_of_a_file_are_checked(folder, capsys):
    """A file with two motions, as of LocoMuJoCo, of which the second one fails."""
    swing = [post_motion(reach) for reach in (PASSES, FAILS)]
    rows = [
        np.concatenate([m.base_poses[:, [0, 1, 2, 6, 3, 4, 5]], m.positions], axis=1)
        for m in swing
    ]
    np.savez(
        "two.npz",
        qpos=np.concatenate(rows),
        joint_names=np.array(["root", ARM]),
        frequency=50.0,
        split_points=np.array([0, len(rows[0]), 2 * len(rows[0])]),
    )
    assert run("two.npz", "--quiet") == EXIT_ERROR
    assert run("two.npz#0", "--format", "qpos", "--quiet") == 0
    assert run("two.npz", "--all", "--json", "all.json") == 1
    found = json.loads((folder / "all.json").read_text())["files"]
    assert [file["file"] for file in found] == ["two.npz#0", "two.npz#1"]


def test_no_report_takes_the_place_of_a_motion(folder, capsys):
    (file,) = write_motions(folder, PASSES)
    before, name = Path(file).read_bytes(), Path(file).name
    line = refused(capsys, str(file), "--csv", f"./{name}")
    assert line.endswith("which is one of the motions to check.")
    line = refused(capsys, ".", "--csv", name)
    assert line.endswith("which is one of the motions to check.")
    assert Path(file).read_bytes() == before


def test_reports_in_the_folder_are_replaced(folder, capsys):
    (folder / "motions").mkdir()
    write_motions(folder / "motions", PASSES)
    reports = ("--csv", "report.csv", "--json", "report.json", "--html", "report.html")
    given = [f"motions/{word}" if "." in word else word for word in reports]
    given += ["--write-selection", "motions/choices.yaml"]
    for _ in range(2):
        assert run("motions", *given) == 0
        assert capsys.readouterr().out.splitlines()[-1] == "1 file: 1 passed."
    assert run("motions", "motions/report.csv") == EXIT_ERROR


def test_what_cannot_be_written_leaves_the_rest(folder, capsys):
    files = write_motions(folder, PASSES, PASSES)
    (folder / "plots" / f"{Path(files[0]).name}.png").mkdir(parents=True)
    reports = ("--json", "a.json", "--html", "a.html")
    code = run(*files, "--plot", "plots", *reports)
    assert code == EXIT_ERROR
    output = capsys.readouterr()
    assert "motion0.csv.png cannot be written" in output.err
    assert len(json.loads((folder / "a.json").read_text())["files"]) == 2
    assert (folder / "plots" / "motion1.csv.png").is_file()
    assert (folder / "a.html").is_file()


def test_ctrl_c_writes_what_is_done(folder, monkeypatch):
    """It comes to the whole group with the first outcome, as from a terminal."""
    write_motions(folder, *20 * [PASSES])
    words = [".", "--jobs", "2", "--model", "post.urdf"]

    class Interrupted(check.Printer):
        def add(self, number, text):
            super().add(number, text)
            os.killpg(0, signal.SIGINT)

    def main():
        os.setpgrp()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        (folder / "group").write_text(str(os.getpid()))
        sys.argv[1:] = [*words, "--json", "out.json", "--csv", "out.csv"]
        start.run("check")

    monkeypatch.setattr(check, "Printer", Interrupted)
    run = run_forked(main)
    assert run.returncode == 130, run.stderr
    first, *_, last = run.stdout.splitlines()
    assert first.endswith("passed, 1.00 s, 51 samples")
    found = json.loads((folder / "out.json").read_text())
    n_done = len(found["files"])
    assert found["interrupted"]
    assert 0 < n_done < 20 == n_done + found["not_done"]
    assert f"interrupted, {20 - n_done} not done" in last
    assert len((folder / "out.csv").read_text().splitlines()) == n_done + 1
    group = int((folder / "group").read_text())
    wait_for(lambda: not is_running(group), "the end of all processes")


def test_watched_motions_are_checked_when_they_change(folder, monkeypatch):
    (file,) = write_motions(folder, PASSES)
    notify = check.notify

    def answer(text):
        """Edit the motion while the command waits; then end it."""
        notify(text)
        if "waiting" in text and "now" not in file.read_text():
            write_motions(folder, FAILS)
            file.write_text(f"# now\n{file.read_text()}")
        elif "waiting" in text:
            os.kill(os.getpid(), signal.SIGINT)

    def main():
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.argv[1:] = [".", "--model", "post.urdf", "--watch", "--json", "a.json"]
        start.run("check")

    monkeypatch.setattr(check, "notify", answer)
    run = run_forked(main)
    assert run.returncode == 1, run.stderr
    first, *_, last = run.stdout.splitlines()
    assert first.endswith("passed, 1.00 s, 51 samples")
    assert last == "1 file: 1 failed; ignored 1 with other extensions."
    assert run.stderr.splitlines() == 2 * ["check: waiting for changes; Ctrl-C ends."]


def test_motions_alone_are_watched(folder):
    """And not what the command writes: it would check for ever."""
    (folder / "motions").mkdir()
    clip, motion = write_motions(folder / "motions", PASSES, PASSES)
    clip.rename("clip.DAT")
    words = ["motions", "clip.DAT", "--format", "table", "--csv", "motions/a.csv"]
    words += ["--write-selection", "motions/own.yaml", "--model", "post.urdf"]
    args = parse(CheckOptions, "check", words)
    before = check.stamps(args)
    (folder / "own.yaml").write_text("duration < 9: exclude\n")
    assert run(*words, "--thresholds", "own.yaml") == 0
    assert (folder / "motions" / "own.yaml").is_file()
    (folder / "motions" / "selection.yaml").write_text("motion1.csv: keep\n")
    assert check.stamps(args) == before
    for file in (motion, Path("clip.DAT")):
        before = check.stamps(args)
        file.write_text(f"# now\n{file.read_text()}")
        assert check.stamps(args) != before


def test_the_page_has_the_robot_and_each_motion(folder):
    """With several processes, too; a file that cannot be read has none."""
    files = write_motions(folder, PASSES, FAILS)
    (folder / "broken.csv").write_text("time,arm_joint\n0,x\n")
    shown = POST.replace("</link>", f"{BOX}</link>", 1)
    (folder / "post.urdf").write_text(shown)
    for jobs in (1, 2):
        run(*files, "broken.csv", "--html", "page.html", "--jobs", jobs, "--quiet")
        text = (folder / "page.html").read_text()
        blocks = re.findall('<script type="application/json"( id="robot")?>(.*)<', text)
        *motions, robot = [json.loads(content) for _, content in blocks]
        assert len(robot["patches"]) == 1
        assert [len(motion["causes"]) > 0 for motion in motions] == [False, True]
        assert text.count('<section class="file"') == 3


def is_running(group):
    """Tell whether any process of a group is there."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_reports_say_where_pictures_are(folder):
    files = write_motions(folder, PASSES, PASSES)
    (folder / "out").mkdir()
    given = ["--plot", "plots", "--json", "out/a.json", "--csv", "out/a.csv"]
    assert run(*files, *given) == 0
    content = json.loads((folder / "out" / "a.json").read_text())
    pictures = [file["picture"] for file in content["files"]]
    assert pictures == [f"../plots/motion{n}.csv.png" for n in (0, 1)]
    rows = csv.DictReader((folder / "out" / "a.csv").read_text().splitlines())
    assert [row["picture"] for row in rows] == pictures
    assert all((folder / "out" / name).is_file() for name in pictures)


def test_a_selection_leaves_motions_out(folder, capsys):
    (folder / "motions").mkdir()
    write_motions(folder / "motions", PASSES, FAILS, PASSES)
    chosen = folder / "motions" / "selection.yaml"
    chosen.write_text("motion1.csv: exclude\n")
    assert run("motions", "--selection", chosen) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == "2 files: 2 passed; 1 excluded by the selection."
    chosen.write_text('"*": exclude\n')
    with pytest.raises(
        InvalidValueError, match=r"selection\.yaml excludes all motions"
    ):
        run("motions", "--selection", chosen)


def test_what_a_rule_excludes_is_written_into_a_selection(folder, capsys):
    (folder / "motions").mkdir()
    write_motions(folder / "motions", PASSES, FAILS, FAILS)
    chosen = folder / "motions" / "selection.yaml"
    chosen.write_text("motion2.csv: {choice: keep, note: mine}\n")
    (folder / "own.yaml").write_text("failed > 0: exclude\n")
    given = ["--thresholds", "own.yaml", "--write-selection", chosen]
    assert run("motions", *given) == 1
    assert capsys.readouterr().out.count("  excluded by failed > 0") == 2
    found = Selection(chosen).choices
    assert found == {
        "motion1.csv": Choice("exclude", "failed > 0"),
        "motion2.csv": Choice("keep", "mine"),
    }


def test_entries_of_a_selection_without_a_motion_are_told(folder, capsys):
    (folder / "motions").mkdir()
    write_motions(folder / "motions", PASSES, FAILS)
    chosen = folder / "motions" / "selection.yaml"
    chosen.write_text("motion1.npz: exclude\nmotoin0.csv: keep\ngone.csv: exclude\n")
    assert run("motions", "--selection", chosen) == 0
    assert capsys.readouterr().err.splitlines()[0] == (
        f"check: 2 entries of {chosen} match no motion: motoin0.csv, gone.csv."
    )
