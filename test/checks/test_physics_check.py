"""What physics says becomes findings, with the figures of the rollout."""

import re
from dataclasses import replace

import numpy as np
import pytest
from checked import ARM, POST, post_motion

from g1_description.checks.checker import Checker
from g1_description.checks.report import FileResult, outcome_text
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.checks.thresholds_file import read_thresholds
from g1_description.choices import ENGINES
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.rollout import Conditions, rollout

ROBOT = parse_urdf(POST)
NAMES = ("tracking", "saturation", "fall")
LEVELS = {"tracking": Level(0.05), "saturation": Level(0.1), "fall": Level(0.0)}


def judged(
    motion, levels=(), only=NAMES, fixed_base=False, robot=ROBOT, engine="bullet"
):
    conditions = Conditions(fixed_base=fixed_base, engine=engine)
    thresholds = Thresholds({**LEVELS, **dict(levels)})
    checker = Checker(robot, thresholds, fixed_base, physics=conditions)
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
    report = rollout(ROBOT, motion, Conditions()).report
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
    report = rollout(ROBOT, motion, Conditions()).report
    verdict = judged(motion)
    assert verdict.findings == ()
    assert verdict.checked == ("tracking", "saturation", "fall")
    rms, largest = report.rms_errors[0], report.largest_errors[0]
    errors = f"tracking error of 1 joint: rms {rms:.4f} rad, largest {largest:.4f} rad"
    note = f"In simulation with PyBullet the robot does not fall; {errors} ({ARM})."
    assert verdict.notes[-1] == note
    assert verdict.figures["rms_tracking_error"] == pytest.approx(rms)
    assert verdict.figures["largest_tracking_error"] == largest
    assert note in outcome_text(FileResult("a.csv", verdict))


def test_a_fall_is_told_and_ends_the_figures():
    verdict = judged(tilting())
    (fall,) = verdict.of("fall")
    assert fall.first_time == verdict.figures["fall_time"]
    assert 0.5 < fall.first_time < 1.0  # it leans by 45 degrees after 0.65 s
    note, cause = verdict.notes[-2:]
    assert cause.startswith("The robot falls at ") and "centre of mass" in cause
    begin = f"In simulation with PyBullet the robot falls at {fall.first_time:.3f} s"
    assert note.startswith(f"{begin} of 1.000 s, where the simulation ends; tracking")
    assert verdict.measured.played.times[-1] == fall.first_time
    assert fall.severity == "warning"


@pytest.mark.parametrize(
    ("axis", "reach", "side", "engine"),
    [("0 1 0", 0.9, "forwards", "bullet"), ("1 0 0", 0.9, "to the right", "mujoco")],
)
def test_a_fall_is_a_failure_with_its_side_and_beginning(axis, reach, side, engine):
    """The arm moves the centre of mass by 6 mm, beyond an edge at 4 mm."""
    narrow = POST.replace("0.4 0.4 0.1", "0.008 0.008 0.1").replace("0 1 0", axis)
    motion = post_motion(reach, 3.0)
    default = {"fall": read_thresholds().levels["fall"]}
    robot = parse_urdf(narrow)
    verdict = judged(motion, default, ("fall",), robot=robot, engine=engine)
    assert verdict.severity == "failed"
    (fall,) = verdict.of("fall")
    found = re.fullmatch(
        r"the robot falls at (.+) s: it leans (.+), by more than 5 degrees from (.+) s "
        "on",
        fall.text,
    )
    assert found[2] == side
    assert 0.0 < float(found[1]) - float(found[3]) < 1.0
    assert verdict.measured.played.times[-1] == fall.first_time < 3.0


@pytest.mark.parametrize("engine", ENGINES)
def test_a_saturated_motor_says_what_it_needs_and_has(engine):
    """The arm is let down to 0.9 rad and lifted again, by a motor that cannot hold."""
    motion, lever, half = post_motion(0.9, 2.0), 0.5 * 0.15, 0.5 * np.pi
    verdict = judged(motion, engine=engine)
    inertia = 0.01 + 0.15 * lever
    needed = 9.81 * lever * np.sin(0.9) + inertia * 2.0 * 0.9 * half**2
    (saturation,) = verdict.of("saturation")
    found = re.fullmatch(
        f"the motor of {ARM} is saturated .+ % of the simulated time: it "
        r"needs (.+) N m and has 0\.62 N m",
        saturation.text,
    )
    assert float(found[1]) == pytest.approx(needed, rel=0.03)
    lack = f"The largest lack of effort: {ARM} needs {found[1]} N m and has 0.62 N m."
    assert verdict.notes[-2].endswith(lack)
    assert verdict.of("fall") == ()


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
    begin = "In simulation with PyBullet the base is fixed; tracking error"
    assert verdict.notes[-1].startswith(begin)
