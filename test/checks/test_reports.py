"""Reports hold what verdicts do: JSON and CSV are read again."""

import csv
import io
import json
import math

import pytest
from findings import NAMES, OUTCOMES, finding
from hypothesis import given, settings
from hypothesis import strategies as st

from g1_description.checks.report import (
    FIGURES,
    NOT_READ,
    FileResult,
    counted,
    csv_text,
    json_text,
    outcome_text,
    summary_text,
    table,
)
from g1_description.checks.verdict import Verdict


@settings(max_examples=10)
@given(st.lists(OUTCOMES, max_size=4), st.integers(0, 3))
def test_json_holds_what_verdicts_do(outcomes, not_done):
    read = json.loads(json_text(outcomes, not_done))
    assert read["not_done"] == not_done
    assert read["interrupted"] == (not_done > 0)
    assert read["counts"] == counted(outcome.result for outcome in outcomes)
    for outcome, found in zip(outcomes, read["files"]):
        assert found.pop("file") == outcome.file
        assert found.pop("result") == outcome.result
        if outcome.verdict is None:
            assert found == {"problem": outcome.problem}
        else:
            assert found == outcome.verdict.as_dict()
    assert len(read["files"]) == len(outcomes)


@settings(max_examples=10)
@given(st.lists(OUTCOMES, max_size=4))
def test_csv_has_a_row_for_each_file(outcomes):
    rows = list(csv.DictReader(io.StringIO(csv_text(outcomes), newline="")))
    files = [outcome.file.replace("\r", " ") for outcome in outcomes]
    assert [row["file"] for row in rows] == files
    for outcome, row in zip(outcomes, rows):
        verdict = outcome.verdict
        assert row["result"] == outcome.result
        if verdict is None:
            assert row["problem"] == outcome.problem.replace("\r", " ")
            assert {row[name] for name in (*FIGURES, *NAMES, "failed")} == {""}
            continue
        known = {name: float(row[name]) for name in FIGURES if row[name]}
        assert known == verdict.figures
        for name in NAMES:
            worst = [f.worst for f in verdict.findings if f.check == name]
            assert row[f"{name}_worst"] == (repr(max(worst)) if worst else "")
            assert (row[name] == "skipped") == (name in verdict.skipped)
            assert (row[name] == "passed") == (name in verdict.checked and not worst)


HEADS = "file,result,failed,warnings,first_time,problem,excluded_by,picture,"
HEADS += "duration,samples,"
HEADS += "samples_beyond_limits,root_path,root_speed.max,joint_speed.max,"
HEADS += "contact_share,largest_drift,energy,deepest_self_collision,"
HEADS += "lowest_height,least_center_margin,largest_missing_wrench,"
HEADS += "infeasible_share,needed_friction,fall_time,"
HEADS += "rms_tracking_error,largest_tracking_error,"


def test_the_worst_distance_is_the_smallest():
    """A check fails with its worst finding; a time is that of the first one."""
    far, near = (
        finding(worst=worst, bound=0.5, severity=severity)
        for worst, severity in ((0.25, "failed"), (0.125, "warning"))
    )
    outcome = FileResult("a", Verdict("r", (far, near), ("position",)))
    text = csv_text([outcome])
    assert text.startswith(HEADS)
    (row,) = csv.DictReader(io.StringIO(text))
    assert (row["position"], row["position_worst"]) == ("failed", "0.125")
    assert (row["failed"], row["warnings"], row["first_time"]) == ("1", "1", "1.25")
    mild = FileResult("a", Verdict("r", (near,), ("position",)))
    (row,) = csv.DictReader(io.StringIO(csv_text([mild])))
    assert row["position"] == "warning"


def test_what_json_has_no_number_for_is_null():
    outcome = FileResult("a", Verdict("r", (finding(worst=math.inf),), ("position",)))
    assert (
        json.loads(json_text([outcome], 0))["files"][0]["findings"][0]["worst"] is None
    )


def test_the_table_says_what_was_found():
    verdict = Verdict(
        "r",
        (
            finding(text="knee"),
            finding(text="elbow", worst=0.7, share=0.25, first_time=1.5),
            finding(severity="warning", check="fall", subject=(), unit="", cause=1),
        ),
        ("position", "fall"),
        {"jerk": "no bounds are set", "acceleration": "no bounds are set"},
        {"duration": 3.0, "samples": 91},
        notes=("assuming 30 Hz.",),
    )
    lines = outcome_text(FileResult("a.csv", verdict)).splitlines()
    assert lines[0] == "a.csv: failed, 3.00 s, 91 samples"
    words = [" ".join(line.split()) for line in lines]
    assert words[1] == "check finding first at % of time"
    assert words[2] == "failed position elbow, also elbow 1.250 s 50.0"
    assert words[3] == "warning fall far 1.250 s"
    assert lines[4:] == [
        "  note: assuming 30 Hz.",
        "  skipped: jerk, acceleration (no bounds are set)",
    ]


def test_columns_are_aligned():
    lines = table([("a", "bbb"), ("aaa", "b")], 1)
    assert lines == ["  a    bbb", "  aaa    b"]


@pytest.mark.parametrize(
    ("results", "not_done", "text"),
    [
        ([], 0, "0 files: nothing done"),
        (["p"], 0, "1 file: 1 passed"),
        (["p", "p", "f", "n"], 0, "4 files: 2 passed, 1 failed, 1 not read"),
        (["f"], 2, "1 file: 1 failed; interrupted, 2 not done"),
        (["w"], 0, "1 file: 1 with a warning"),
        (["w", "w"], 0, "2 files: 2 with warnings"),
    ],
)
def test_the_last_line_counts(results, not_done, text):
    kinds = {
        "p": FileResult("a", Verdict("r")),
        "f": FileResult("a", Verdict("r", (finding(),), ("position",))),
        "n": FileResult("a", problem="empty", without_verdict=NOT_READ),
        "w": FileResult(
            "a", Verdict("r", (finding(severity="warning"),), ("position",))
        ),
    }
    assert outcome_text(kinds["n"]) == "a: not read: empty"
    assert summary_text([kinds[result] for result in results], not_done) == text
