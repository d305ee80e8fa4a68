"""Plain parts of the page: findings, ranges of sliders, edits, and its threads."""

from __future__ import annotations

import logging
import math
import threading
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st
from waiting import DEADLINE, wait_for

from g1_description.checks.verdict import FAILED, WARNING, Finding, Verdict
from g1_description.errors import InvalidValueError
from g1_description.robot.description import Joint
from g1_description.robot.transform import IDENTITY
from g1_description.web import findings_panel as findings
from g1_description.web import ui_loop
from g1_description.web.controls import slider_range
from g1_description.web.ui_loop import Lane, UiLoop

HOSTILE = "</div><script>alert('x')</script> \" onload='y' & <"


@pytest.fixture
def notices():
    """Give the list of texts that a browser has been notified of."""
    return []


@pytest.fixture
def ui(notices):
    """Give the threads of a page with one browser."""
    client = SimpleNamespace(
        add_notification=lambda title, text, **_: notices.append(text)
    )
    server = SimpleNamespace(get_clients=lambda: {1: client})
    return UiLoop(server, threading.Event())


# --- findings ---


def finding(*intervals, severity=FAILED, subject=("a",), text="too fast"):
    first = intervals[0][0]
    return Finding(
        "velocity",
        severity,
        subject,
        2.0,
        1.0,
        "rad/s",
        first,
        first,
        0.1,
        intervals,
        text,
    )


def bars(*found, span=(0.0, 10.0)):
    """Give the rows of strips: where each bar begins and how long it is, in %."""
    rows = ElementTree.fromstring(findings.strips([[f] for f in found], span))
    return [
        [
            tuple(
                float(part.partition(":")[2].rstrip("%"))
                for part in bar.get("style").split(";")
                if part.startswith(("left", "width"))
            )
            for bar in row
        ]
        for row in rows
    ]


def test_strips_are_where_the_findings_are():
    rows = bars(finding((3.0, 4.0), (6.5, 9.0)), finding((2.0, 12.0)), span=(2.0, 12.0))
    assert rows == [[(10.0, 10.0), (45.0, 25.0)], [(0.0, 100.0)]]


def test_a_moment_is_seen_also_at_the_end():
    least = findings.LEAST_WIDTH
    rows = bars(finding((5.0, 5.0)), finding((10.0, 10.0)))
    assert rows == [[(50.0, least)], [(100.0 - least, least)]]


def test_strips_of_a_single_sample_are_within_the_line():
    ((left, width),) = bars(finding((1.0, 1.0)), span=(1.0, 1.0))[0]
    assert 0.0 <= left <= left + width <= 100.0


@given(st.text(max_size=40))
def test_texts_of_findings_are_text(text):
    # What XML forbids at all is no matter of ours.
    printable = "".join(c for c in text + HOSTILE if c.isprintable())
    row = ElementTree.fromstring(
        findings.strips([[finding((0.0, 1.0), text=printable)]], (0.0, 1.0))
    )
    assert [element.tag for element in row.iter()] == ["div", "div", "i"]
    assert row[0].get("title") == printable
    assert {*row[0].keys()} == {"title", "style"}


def test_a_strip_has_the_colour_of_what_it_means():
    html = findings.strips([[finding((0.0, 1.0), severity=WARNING)]], (0.0, 1.0))
    assert findings.COLORS[WARNING] in html
    assert findings.COLORS[FAILED] not in html


def test_findings_of_one_cause_share_a_strip_and_a_button():
    arm = finding((1.0, 2.0), subject=("l", "r"), text="l in r")
    elbow = replace(finding((1.5, 2.5), subject=("e", "r")), worst=3.0, text="e in r")
    (row,) = ElementTree.fromstring(findings.strips([[arm, elbow]], (0.0, 10.0)))
    assert len(row) == 2
    assert row.get("title") == "e in r, also l - r"
    assert findings.title([arm, elbow]) == "1.50 s  velocity e - r +1"


def test_a_verdict_in_a_line():
    def line(*severities, **more):
        found = (finding((0.0, 1.0), severity=s) for s in severities)
        found = tuple(replace(f, cause=n) for n, f in enumerate(found))
        return findings.summary(Verdict("r", found, **more))

    assert line(checked=("velocity",)) == "**passed**"
    assert line(FAILED, WARNING, WARNING, checked=("velocity",)) == (
        "**failed**: 1 failure, 2 warnings"
    )
    skipped = {"floating": "there is no base"}
    assert "*Not checked: floating.*" in line(checked=("velocity",), skipped=skipped)
    assert line(skipped=skipped) == (
        "All checks were skipped: floating: there is no base."
    )
    assert findings.title([finding((1.5, 2.0), subject=("l", "r"))]) == (
        "1.50 s  velocity l - r"
    )
    jump = replace(finding((1.5, 2.0), subject=("base",)), check="base_jump")
    assert findings.title([jump]) == "1.50 s  base jump"


# --- sliders ---


@pytest.mark.parametrize(
    ("kind", "limits", "shown"),
    [
        ("revolute", (-1.0, 2.0), (-1.0, 2.0)),
        ("continuous", (-math.inf, math.inf), (-math.pi, math.pi)),
        ("prismatic", (-math.inf, math.inf), (-1.0, 1.0)),
        ("prismatic", (0.0, math.inf), (0.0, 1.0)),
        ("revolute", (0.5, 0.5), (-math.pi, math.pi)),  # as if it had none
        ("revolute", (4.0, math.inf), (-math.pi, math.pi)),
    ],
)
def test_a_slider_goes_as_far_as_its_joint(kind, limits, shown):
    joint = Joint("j", kind, "a", "b", IDENTITY, lower=limits[0], upper=limits[1])
    assert slider_range(joint) == shown


# --- edits ---


class Field:
    """An element whose values are kept in the order in which they were set."""

    def __init__(self, value, clock):
        self._clock, self.sent = clock, []
        self.edit(value)
        self.update_timestamp = 0.0

    @property
    def value(self):
        return self._value

    @value.setter
    def value(self, value):
        self.sent.append(value)
        self.edit(value)

    def edit(self, value):
        """Set a value as a browser does."""
        self._value, self.update_timestamp = value, self._clock.now


@pytest.fixture
def clock(monkeypatch):
    """Give a clock of the edits, at 100 s, that stands still."""
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(ui_loop, "time", SimpleNamespace(time=lambda: clock.now))
    return clock


def test_an_edited_element_is_held_for_a_while(clock):
    guard, field = ui_loop.Edits(), Field(0.0, clock)
    assert not guard.is_held(field)
    field.edit(1.0)
    clock.now += ui_loop.HELD - 0.01
    guard.show(field, 2.0)
    assert guard.is_held(field) and field.value == 1.0
    clock.now += 0.02
    guard.show(field, 2.0)
    assert not guard.is_held(field) and field.value == 2.0


def test_a_value_is_sent_if_it_differs_or_a_browser_has_another(clock):
    guard, field = ui_loop.Edits(), Field(1.0, clock)
    guard.show(field, 1.09, 0.1)
    assert field.sent == []
    guard.show(field, 1.25, 0.1)
    assert field.sent == [1.25]
    for delay, sent in (
        (ui_loop.ROUND_TRIP / 2, [2.25, 1.25]),
        (ui_loop.ROUND_TRIP, []),
    ):
        field.sent.clear()
        clock.now += delay
        field.edit(1.25)
        clock.now += ui_loop.HELD
        guard.show(field, 1.25)
        assert field.sent == sent, "only an edit that an update may have crossed"
    field.sent.clear()
    for value in ((1.0, 2.0), "none"):
        guard.show(field, value)
        guard.show(field, value)
    assert field.sent == [(1.0, 2.0), "none"]


# --- the ui ---


def test_only_the_newest_of_a_key_is_done_in_the_order_of_the_newest(ui):
    done = []
    for key, number in (("a", 1), ("b", 2), ("a", 3), ("c", 4), ("b", 5)):
        ui.post(key, lambda number=number: done.append(number))
    assert ui.new.is_set()
    assert done == []
    ui.do_all()
    assert done == [3, 4, 5]
    ui.do_all()
    assert done == [3, 4, 5], "each is done once"


def test_what_is_posted_meanwhile_is_done_next_time(ui):
    done = []
    ui.post("a", lambda: ui.post("a", lambda: done.append(2)) or done.append(1))
    ui.do_all()
    assert done == [1]
    ui.do_all()
    assert done == [1, 2]


def fail(error):
    raise error


def test_errors_are_notified_once_and_the_rest_is_done(ui, notices, caplog):
    done = []
    for key in range(50):
        ui.post(key, lambda: fail(InvalidValueError("Enter a name for the pose.")))
    ui.post("b", lambda: done.append(2))
    ui.do_all()
    assert done == [2]
    with caplog.at_level(logging.ERROR):
        ui.guarded(lambda: fail(ZeroDivisionError("of ours")))
    assert notices == ["Enter a name for the pose.", "Internal error; see the log."]
    assert "ZeroDivisionError" in caplog.text


def test_what_waits_is_done_one_after_the_other_and_errors_do_not_end_it(ui, notices):
    gate, done, given_back = threading.Event(), [], []
    ui.calls.do(lambda: gate.wait(DEADLINE) and done.append("first"))
    ui.calls.do(lambda: fail(InvalidValueError("Nobody answers.")))
    ui.calls.do(lambda: fail(ValueError("of ours")))
    ui.calls.do(lambda: done.append("last") or 7, given_back.append)
    assert ui.calls.is_busy and done == []
    gate.set()
    wait_for(lambda: not ui.calls.is_busy, "the end")
    assert done == ["first", "last"]
    assert given_back == [], "that is for the thread that draws"
    ui.do_all()
    assert given_back == [7]
    assert notices == ["Nobody answers.", "Internal error; see the log."]


def test_of_one_key_the_newest_is_done_and_others_in_their_order(ui):
    gate, done = threading.Event(), []
    ui.calls.do(lambda: gate.wait(DEADLINE))
    for key, number in (("a", 1), (None, 2), ("a", 3), ("a", 4), (None, 5)):
        ui.calls.do(lambda number=number: done.append(number), key=key)
    gate.set()
    wait_for(lambda: not ui.calls.is_busy, "the end")
    assert done == [2, 4, 5]


@pytest.mark.parametrize(("is_cancelled", "results"), [(False, ["b"]), (True, [])])
def test_pieces_end_where_there_is_something_newer(ui, is_cancelled, results):
    begun, gate, given, lane = threading.Event(), threading.Event(), [], Lane(ui)

    def pieces():
        yield "a"
        begun.set()
        gate.wait(DEADLINE)
        yield "b"
        yield "c"

    lane.go_through(pieces(), given.append, "key")
    assert begun.wait(DEADLINE)
    if is_cancelled:
        lane.cancel("key")
    else:
        lane.go_through(iter(()), given.append, "key")
    gate.set()
    wait_for(lambda: not lane.is_busy, "the end")
    ui.do_all()
    assert given == results
