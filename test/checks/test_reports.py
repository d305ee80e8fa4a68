"""Reports hold what verdicts do: JSON and CSV are read again, the page is parsed."""

import csv
import io
import json
import math
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from g1_description.checks.report import (
    FIGURES,
    NOT_READ,
    RESULTS,
    FileResult,
    counted,
    csv_text,
    json_text,
    outcome_text,
    summary_text,
    table,
)
from g1_description.checks.report_page import write_page
from g1_description.checks.rules import RULES
from g1_description.checks.verdict import Finding, Verdict, sorted_findings

NAMES = [rule.name for rule in RULES]
NUMBERS = st.floats(-1e307, 1e307)
TIMES = st.floats(0.0, 1e4)
# Without NUL, which csv of Python 3.8 does not read; messages quote it.
WORDS = st.text(
    st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"),
    min_size=1,
    max_size=12,
)
INTERVALS = st.lists(st.tuples(TIMES, TIMES), max_size=3).map(tuple)


def findings(checks):
    return st.builds(
        Finding,
        check=st.sampled_from(checks),
        severity=st.sampled_from(["failed", "warning"]),
        subject=st.lists(WORDS, max_size=2).map(tuple),
        worst=NUMBERS,
        bound=st.just(-1e308),  # all sizes are above it: more is worse
        unit=WORDS,
        first_time=TIMES,
        worst_time=TIMES,
        share=st.floats(0.0, 1.0),
        intervals=INTERVALS,
        text=WORDS,
        points=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=2).map(tuple),
    )


@st.composite
def verdicts(draw):
    """Draw a verdict of any checks."""
    checked = draw(st.sets(st.sampled_from(NAMES), min_size=1))
    skipped = {name: draw(WORDS) for name in NAMES if name not in checked}
    found = draw(st.lists(findings(sorted(checked)), max_size=5))
    return Verdict(
        draw(WORDS),
        sorted_findings(found),
        tuple(sorted(checked)),
        skipped,
        draw(st.dictionaries(st.sampled_from(list(FIGURES)), NUMBERS)),
        draw(st.dictionaries(WORDS, INTERVALS, max_size=2)),
        draw(st.lists(WORDS, max_size=2).map(tuple)),
    )


OUTCOMES = st.builds(FileResult, WORDS, verdicts()) | st.builds(
    FileResult, WORDS, st.none(), WORDS, st.sampled_from(RESULTS[3:])
)


def finding(**changes):
    values = {
        **{"check": "position", "severity": "failed", "subject": ("elbow",)},
        **{"worst": 0.5, "bound": 0.1, "unit": "rad", "first_time": 1.25},
        **{"worst_time": 2.0, "share": 0.5, "intervals": ((1.25, 2.0),), "text": "far"},
    }
    return Finding(**{**values, **changes})


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
HEADS += "lowest_height,least_center_margin,least_zmp_margin,fall_time,"
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


class Page(HTMLParser):
    """Collects what a page refers to, and checks that its elements are closed."""

    def __init__(self, text):
        super().__init__()
        self.links, self.ids, self.open, self.tags = [], [], [], []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in {"meta", "img"}:
            self.open.append(tag)
        for name, value in attrs:
            if name in {"src", "href", "srcset", "action", "data"}:
                self.links.append(value)
            if name == "id":
                self.ids.append(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


@settings(max_examples=5)
@given(st.lists(OUTCOMES, max_size=3))
def test_the_page_needs_nothing_from_elsewhere(tmp_path_factory, outcomes):
    folder = tmp_path_factory.mktemp("page")
    picture = folder / "picture.png"
    picture.write_bytes(b"\x89PNG")
    pictures = [[picture] * (2 if o.verdict else 0) for o in outcomes]
    write_page(folder / "page.html", outcomes, pictures, 0)
    text = (folder / "page.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.open == []
    assert not {"link", "iframe"} & set(page.tags)
    assert "url(" not in text and "@import" not in text
    inside = [link for link in page.links if link.startswith("#")]
    data = [link for link in page.links if link not in inside]
    assert [link[1:] for link in inside] == page.ids
    assert len(inside) == len(outcomes)
    figures = sum(bool(o.verdict and o.verdict.findings) for o in outcomes)
    n_pictures = figures + sum(map(bool, pictures))
    assert data == ["data:image/png;base64,iVBORw=="] * n_pictures


BODY = """
<h1>Checks of motions</h1>
<p>2 files: 1 failed, 1 not read; interrupted, 3 not done.</p>
<table class="files">
<tr><th>file</th><th>result</th><th>failures</th><th>warnings</th><th>first at</th>\
<th>length [s]</th><th>path [m]</th><th>base [m/s]</th><th>joints [rad/s]</th>\
<th>contact</th><th>energy [J]</th><th>checks that failed; excluded by</th></tr>
<tr><td><a href="#file0">&lt;b&gt;\\udcff</a></td>\
<td><span class="result failed">failed</span></td><td>1</td><td>1</td>\
<td>1.250 s</td><td>3</td><td></td><td></td><td></td><td>0.5</td><td></td>\
<td>position; energy &gt; 9</td></tr>
<tr><td><a href="#file1">&amp;.csv</a></td>\
<td><span class="result not">not read</span></td><td></td><td></td><td></td>\
<td></td><td></td><td></td><td></td><td></td><td></td><td>1 &lt; 2.</td></tr>
</table>
<h2 id="file0">&lt;b&gt;\\udcff <span class="result failed">failed</span></h2>
<p class="about">&lt;r&gt;: length 3 s, time in contact with the floor 50 %, \
least margin of the zero-moment point 0.1235 m</p>
<table>
<tr><th></th><th>check</th><th>finding</th><th>first at</th><th>% of time</th></tr>
<tr><td><span class="result failed">failed</span></td><td>position</td>\
<td>&lt;i&gt; is far</td><td>1.250 s</td><td>50.0</td></tr>
<tr><td><span class="result warning">warning</span></td><td>fall</td>\
<td>far</td><td>1.250 s</td><td></td></tr>
</table>
<p class="about">excluded by energy &gt; 9</p>
<p class="about">1 &gt; 0</p>
<p class="about">skipped: jerk (a &amp; b)</p>
<h2 id="file1">&amp;.csv <span class="result not">not read</span></h2>
<p>1 &lt; 2.</p>
"""


def test_the_page_says_what_was_found_and_names_are_text(tmp_path):
    fall = finding(severity="warning", check="fall", subject=(), unit="")
    verdict = Verdict(
        "<r>",
        (finding(text="<i> is far"), replace(fall, cause=1)),
        ("position", "fall"),
        {"jerk": "a & b"},
        {"duration": 3.0, "contact_share": 0.5, "least_zmp_margin": 0.12346},
        notes=("1 > 0",),
        excluded_by=("energy > 9",),
    )
    failed = FileResult("<b>\udcff", verdict)  # a byte of its name is no text
    not_read = FileResult("&.csv", None, "1 < 2.", NOT_READ)
    write_page(tmp_path / "page.html", [failed, not_read], [[], []], 3)
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert text.split("<body>")[1].split("<script>")[0] == BODY
    plain = Verdict("r")
    write_page(tmp_path / "page.html", [FileResult("a.csv", plain)], [[]], 0)
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert Page(text.split("<script>")[0]).text.endswith(
        "1 file: 1 passed.\n\nfileresultfailureswarningsfirst at"
        "length [s]path [m]base [m/s]joints [rad/s]contactenergy [J]"
        "checks that failed; excluded by\n"
        "a.csvpassed00\n\na.csv passed\nr: \n"
    )


def test_the_page_counts_findings_as_the_table_does(tmp_path):
    of_one_cause = tuple(finding(subject=(name,)) for name in ("elbow", "wrist"))
    result = FileResult("a", Verdict("r", of_one_cause, ("position",)))
    write_page(tmp_path / "page.html", [result], [[]], 0)
    (row,) = csv.DictReader(io.StringIO(csv_text([result])))
    cells = f"<td>{row['failed']}</td><td>{row['warnings']}</td>"
    assert row["failed"] == "2"
    assert cells in (tmp_path / "page.html").read_text()


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
