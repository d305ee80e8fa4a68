"""What physics says becomes findings, with the figures of the rollout."""

from dataclasses import replace

import numpy as np
import pytest
from checked import ARM, POST, post_motion

from g1_description.checks.checker import Checker
from g1_description.checks.report import FileResult, outcome_text
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.rollout import Conditions, rollout

ROBOT = parse_urdf(POST)
NAMES = ("tracking", "saturation", "fall")
LEVELS = {"tracking": Level(0.05), "saturation": Level(0.1), "fall": Level(0.0)}


def judged(motion, levels=(), only=NAMES, fixed_base=False):
    conditions = Conditions(fixed_base=fixed_base, stops_at_fall=True)
    thresholds = Thresholds({**LEVELS, **dict(levels)})
    checker = Checker(ROBOT, thresholds, fixed_base, physics=conditions)
    return checker.check(motion, only)


def tilting(angle=1.2):
    """Turn the whole robot onto its side, which no motor can."""
    motion = post_motion(0.0)
    base = motion.base_poses.copy()
    turn = np.linspace(0.0, angle, len(base))
    base[:, 4], base[:, 6] = np.sin(turn / 2.0), np.cos(turn / 2.0)
    return replace(motion, base_poses=base)


@pytest.fixture(scope="module")
def weak():
    return judged(post_motion(0.9, 0.4))


def test_a_weak_motor_is_told_with_the_figures_of_the_rollout(weak):
    motion, verdict = post_motion(0.9, 0.4), weak
    report = rollout(ROBOT, motion, Conditions(stops_at_fall=True)).report
    (tracking,) = verdict.of("tracking")
    (saturation,) = verdict.of("saturation")
    assert tracking.subject == saturation.subject == (ARM,)
    assert tracking.worst == report.largest_errors[0]
    assert tracking.worst_time == report.largest_error_times[0]
    assert 0.0 < tracking.first_time <= tracking.worst_time
    assert saturation.worst == saturation.share == report.limit_shares[0]
    assert saturation.first_time == report.first_limit_times[0]
    assert verdict.of("fall") == ()
    assert verdict.severity == "warning"


def test_a_verdict_without_findings_says_what_physics_found():
    motion = post_motion(0.05)
    report = rollout(ROBOT, motion, Conditions(stops_at_fall=True)).report
    verdict = judged(motion)
    assert verdict.findings == ()
    assert verdict.checked == ("tracking", "saturation", "fall")
    rms, largest = report.rms_errors[0], report.largest_errors[0]
    errors = f"tracking error of 1 joint: rms {rms:.4f} rad, largest {largest:.4f} rad"
    note = f"In simulation the robot does not fall; {errors} ({ARM})."
    assert verdict.notes[-1] == note
    assert verdict.figures["rms_tracking_error"] == pytest.approx(rms)
    assert verdict.figures["largest_tracking_error"] == largest
    assert note in outcome_text(FileResult("a.csv", verdict))


def test_a_fall_is_told_and_ends_the_figures():
    verdict = judged(tilting())
    (fall,) = verdict.of("fall")
    assert fall.first_time == verdict.figures["fall_time"]
    assert 0.5 < fall.first_time < 1.0  # it leans by 45 degrees after 0.65 s
    begin = f"In simulation the robot falls at {fall.first_time:.3f} s; tracking error"
    assert verdict.notes[-1].startswith(begin)
    assert fall.severity == "warning"


def test_thresholds_just_beyond_hide_both(weak):
    names = ("tracking", "saturation")
    worst = {name: weak.of(name)[0].worst for name in names}
    hidden = {name: Level(None, worst[name]) for name in names}
    assert judged(post_motion(0.9, 0.4), hidden).findings == ()
    below = {name: Level(None, np.nextafter(worst[name], 0.0)) for name in names}
    shown = judged(post_motion(0.9, 0.4), below, ["tracking"]).findings
    assert [found.check for found in shown] == ["tracking"]
    assert shown[0].severity == "failed"


def test_what_cannot_be_judged_is_skipped():
    verdict = judged(post_motion(), {"saturation": Level()}, fixed_base=True)
    assert verdict.checked == ("tracking",)
    assert verdict.skipped == {
        "saturation": "disabled: no threshold is set",
        "fall": "the base is fixed",
    }
    begin = "In simulation the base is fixed; tracking error"
    assert verdict.notes[-1].startswith(begin)


def test_the_same_motion_gives_the_same_verdict(weak):
    assert judged(post_motion(0.9, 0.4)).as_dict() == weak.as_dict()
