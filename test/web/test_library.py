"""The motions of a folder: what a report says of them, listed, sorted and chosen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from checked import POST, write_motions

from g1_description import Robot
from g1_description.checks.batch import FileChecker
from g1_description.checks.report import FileResult, csv_text, json_text
from g1_description.errors import InvalidValueError
from g1_description.motion.paths import split
from g1_description.motion.selection import FILE, Choice, Selection
from g1_description.web.library import BY_RULE, REPORTS, UNKNOWN, Library, View

REPORT = REPORTS[0]
REACHES = 0.5, 1.5, 0.25, 0.1
RULES = {"joint_speed.max > 1.5": "exclude"}


@pytest.fixture
def folder(tmp_path):
    """Give a folder with motions, one of them deeper."""
    (tmp_path / "motions" / "deep").mkdir(parents=True)
    files = write_motions(tmp_path / "motions", *REACHES)
    files[3].rename(tmp_path / "motions" / "deep" / "motion0.csv")
    return tmp_path / "motions"


def report(folder, named, left_out="motion2.csv", ending=".csv"):
    """Check all but a file; write the report, with names from elsewhere."""
    check = FileChecker(Robot(POST).checker(RULES))
    found = []
    for file in sorted(folder.rglob("*.csv")):
        name = file.relative_to(folder).as_posix()
        if name != left_out:
            outcome = check.outcome(f"{named}/{name}", file)
            found.append(outcome)
    found.append(FileResult("elsewhere/motion2.csv", problem="of another folder"))
    path = (folder / REPORT).with_suffix(ending)
    path.write_text(csv_text(found) if ending == ".csv" else json_text(found, 0))
    return path


def library(folder, path=None):
    files = sorted(folder.rglob("*.csv"))
    return Library(folder, files, path)


def test_motions_in_a_file_of_several_are_those_of_the_report(folder):
    library_file = folder / "deep" / "lib # 1.pkl"
    library_file.touch()
    path = report(folder, "motions")
    with path.open("a") as file:
        row = ",".join([""] * (path.read_text().splitlines()[0].count(",") - 1))
        for name in ("/home/x y", "b"):
            file.write(f"motions/deep/lib # 1.pkl#{name},passed{row}\n")
    found = Library(folder, [*sorted(folder.rglob("*.csv")), library_file], path)
    known = {entry.name: entry for entry in found.entries}
    assert "deep/lib # 1.pkl" not in known
    assert known["deep/lib # 1.pkl#b"].result == "passed"
    motion = known["deep/lib # 1.pkl#/home/x y"].path
    assert split(motion) == (library_file, "/home/x y")
    found.choose(known["deep/lib # 1.pkl#b"], choice="exclude")
    assert not found.selection.keeps(f"{library_file}#b")
    assert found.selection.keeps(motion)


def names(found):
    return [entry.name for entry in found]


@pytest.mark.parametrize("named", ["motions", "/some/where/motions", "."])
def test_a_report_is_found_again_whatever_its_folder_was_called(folder, named):
    known = {e.name: e for e in library(folder, report(folder, named)).entries}
    assert [*known] == ["deep/motion0.csv", *(f"motion{n}.csv" for n in (0, 1, 2))]
    speeds = [e.figures.get("joint_speed.max") for e in known.values()]
    assert speeds[3] is None
    assert speeds[0] < speeds[1] < speeds[2]
    assert known["motion2.csv"].result == UNKNOWN
    assert known["motion1.csv"].found["position"] == "failed"
    assert known["motion0.csv"].excluded_by == "joint_speed.max > 1.5"


def test_json_says_what_csv_does(folder):
    as_csv, as_json = (
        library(folder, report(folder, "motions", ending=ending)).entries
        for ending in (".csv", ".json")
    )
    assert [vars(entry) for entry in as_json] == [vars(entry) for entry in as_csv]


def test_a_report_of_two_folders_is_not_mixed_up(folder):
    check = FileChecker(Robot(POST).checker())
    file = folder / "motion1.csv"
    outcome = check.outcome("motions/motion1.csv", file)
    other = FileResult("other/motion1.csv", problem="of another folder")
    (folder / REPORT).write_text(csv_text([other, outcome]))
    found = library(folder, folder / REPORT)
    assert found.entries[2].result == "failed"


def test_motions_are_sorted_and_filtered(folder):
    found = library(folder, report(folder, "motions"))
    by_speed = names(found.listed(View(sort="joint_speed.max")))
    fastest = names(found.listed(View(sort="joint_speed.max", is_reversed=True)))
    order = ["deep/motion0.csv", "motion0.csv", "motion1.csv"]
    assert by_speed == [*order, "motion2.csv"]
    assert fastest == [*order[::-1], "motion2.csv"]
    assert names(found.listed(View(check="position"))) == ["motion1.csv"]
    assert names(found.listed(View(result=UNKNOWN))) == ["motion2.csv"]
    assert names(found.listed(View(text="DEEP"))) == ["deep/motion0.csv"]
    assert names(found.listed(View(choice=BY_RULE))) == ["motion0.csv", "motion1.csv"]


def test_a_choice_is_written_beside_those_of_others(folder):
    found = library(folder, report(folder, "motions"))
    first, second = found.entries[1:3]
    found.choose(first, "keep")
    (folder / FILE).write_text("motion2.csv: exclude\nmotion0.csv: keep\n")
    found.choose(first, note="good")
    found.choose(second, "exclude")
    assert Selection(folder / FILE).choices == {
        "motion0.csv": Choice("keep", "good"),
        "motion1.csv": Choice("exclude"),
        "motion2.csv": Choice("exclude"),
    }
    assert found.counts() == (1, 2)
    assert found.choice(first) == "keep"  # a person's choice before that of a rule


@pytest.mark.parametrize(
    ("others", "choices", "counts"),
    [
        ("exclude", ["exclude", "keep", "exclude", "exclude"], (1, 3)),
        ("keep", ["undecided", "keep", BY_RULE, "undecided"], (1, 0)),
    ],
)
def test_the_choice_for_all_others_is_no_motion(folder, others, choices, counts):
    text = f'"*": {others}\nmotion0.csv: keep\nmotion2.csv: {{note: look again}}\n'
    (folder / FILE).write_text(text)
    found = library(folder, report(folder, "motions"))
    assert [found.choice(entry) for entry in found.entries] == choices
    assert found.counts() == counts
    excluded = found.listed(View(choice="exclude"))
    assert len(excluded) == counts[1]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("report.csv", "a,b\n1,2\n"),
        ("report.csv", "\x80"),
        ("report.json", "{}"),
        ("report.json", "[1]"),
        ("report.json", '{"files": [1]}'),
        ("report.json", '{"files": [{"findings": [1]}]}'),
        ("report.json", "{"),
        pytest.param("report.json", "[" * 100_000, id="nested"),
        ("report.json", '{"files": [{"result": "failed"}]}'),
        ("report.json", '{"files": [{"file": ["motion1.csv"]}]}'),
        ("report.json", '{"files": [{"file": "motion1.csv", "picture": 1}]}'),
        (
            "report.json",
            '{"files": [{"file": "motion1.csv", "figures": {"duration": [1]}}]}',
        ),
        ("report.csv", "result,file\nfailed\n"),
    ],
)
def test_what_is_no_report_is_told(folder, name, text):
    path = folder / name
    path.write_text(text, encoding="latin-1")
    with pytest.raises(InvalidValueError, match=f"{name} is not a report of check"):
        library(folder, path)


def test_a_figure_that_is_too_large_is_infinite(folder):
    path = folder / "report.json"
    figures = f'{{"duration": 1{"0" * 400}}}'
    one = f'{{"file": "motion1.csv", "result": "passed", "figures": {figures}}}'
    path.write_text(f'{{"files": [{one}]}}')
    assert library(folder, path).entries[2].figures["duration"] == np.inf


def test_a_missing_report_is_told(folder):
    with pytest.raises(InvalidValueError, match="No such file"):
        library(folder, Path("none.csv"))
