"""Findings of one cause, together."""

from dataclasses import replace
from pathlib import Path

import pytest

from g1_description.api import Robot
from g1_description.checks.verdict import (
    BY_LIMBS,
    BY_TIME,
    Finding,
    cause_text,
    with_causes,
    worst_of,
)
from g1_description.robot.assembly import limbs_of


def finding(check, subject, *intervals):
    first = intervals[0][0]
    text = " in ".join(subject)
    return Finding(
        check, "failed", subject, 1.0, 0.1, "m", first, first, 0.1, intervals, text
    )


def test_limbs_of_the_g1_are_its_arms_legs_and_trunk():
    limbs = limbs_of(Robot().description)
    found = {}
    for link, limb in limbs.items():
        found.setdefault(limb, set()).add(link)
    arm = ("shoulder", "elbow", "wrist", "rubber_hand")
    for side in ("left", "right"):
        legs = {
            n
            for n in limbs
            if n.startswith(f"{side}_") and not any(a in n for a in arm)
        }
        arms = {
            n for n in limbs if n.startswith(f"{side}_") and any(a in n for a in arm)
        }
        assert legs in found.values()
        assert arms in found.values()
    trunk = found[limbs["torso_link"]]
    assert {"waist_yaw_link", "waist_roll_link", "torso_link", "head_link"} <= trunk
    assert len(found) == 6  # and the pelvis


GROUPING = {"self_collision": BY_LIMBS, "jump": BY_TIME}
LIMBS = {"hand": "arm", "elbow": "arm", "knee": "leg", "foot": "leg", "head": "trunk"}
HAND = finding("self_collision", ("hand", "knee"), (1.0, 2.0))


@pytest.mark.parametrize(
    ("other", "is_same"),
    [
        (finding("self_collision", ("foot", "elbow"), (1.5, 3.0)), True),
        (finding("self_collision", ("foot", "elbow"), (2.05, 3.0)), True),
        (finding("self_collision", ("foot", "elbow"), (0.0, 0.1), (1.9, 3.0)), True),
        (finding("self_collision", ("foot", "elbow"), (2.5, 3.0)), False),
        (finding("self_collision", ("foot", "elbow"), (0.0, 0.5)), False),
        (finding("self_collision", ("head", "elbow"), (1.0, 2.0)), False),
        (finding("self_collision", ("hand", "elbow"), (1.0, 2.0)), False),
        (finding("jump", ("hand", "knee"), (1.0, 2.0)), False),
    ],
)
def test_pairs_of_the_same_limbs_at_the_same_time_have_one_cause(other, is_same):
    for pair in ([HAND, other], [other, HAND]):
        first, last = with_causes(pair, GROUPING, LIMBS)
        assert (first.cause == last.cause) == is_same


def test_a_later_finding_may_join_two_causes():
    one, two = (replace(HAND, intervals=((t, t + 1.0),)) for t in (1.0, 4.0))
    both = replace(HAND, intervals=((1.5, 4.5),))
    other = finding("position", ("elbow",), (1.0, 5.0))
    found = with_causes([one, two, other, both], GROUPING, LIMBS)
    assert [f.cause for f in found] == [0, 0, 1, 0]
    assert [f.cause for f in with_causes([one, two, other], GROUPING, LIMBS)] == [
        0,
        1,
        2,
    ]


def test_joints_that_jump_together_have_one_cause_and_limits_have_none():
    jumps = [finding("jump", (n,), (2.0, 2.1)) for n in ("a", "b", "c")]
    limits = [finding("position", (n,), (2.0, 2.1)) for n in ("a", "b")]
    found = with_causes([*jumps, *limits], GROUPING, LIMBS)
    assert [f.cause for f in found] == [0, 0, 0, 1, 2]


def test_six_faults_are_six_causes():
    robot = Robot()
    verdict = robot.check(Path(__file__).parents[2] / "motions" / "faulty.csv")
    found = [worst_of(findings) for findings in verdict.causes]
    checks = [finding.check for finding in found if finding.severity == "failed"]
    assert checks == [
        *("velocity", "self_collision", "position"),
        *("skating", "penetration", "center_of_mass"),
    ]
    assert len(verdict.findings) > len(found)
    texts = [cause_text(findings) for findings in verdict.causes]
    assert texts[3].endswith(", also right_ankle_roll_link")
    assert texts[1].endswith(" more pairs")
