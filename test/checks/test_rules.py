"""Rules are complete, and compare sizes in either direction."""

import numpy as np
import pytest
from checked import POST as TEXT
from checked import assert_as_kept, post_motion

from g1_description.checks.measured import CHUNK, CheckedRobot
from g1_description.checks.measuring import measure
from g1_description.checks.rule import Rule
from g1_description.checks.rules import RULES
from g1_description.checks.rules.self_collision import per_pair
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.checks.verdict import Finding
from g1_description.collisions.find_pairs import collisions_of
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.robot.urdf import parse_urdf

POST = parse_urdf(TEXT)


def test_each_rule_is_listed_once():
    names = [rule.name for rule in RULES]
    assert len(names) == len({*names})
    assert not {*names} & {*vars(Thresholds())}


def test_rules_are_what_they_were(tmp_path):
    lines = []
    for rule in RULES:
        functions = [f.__name__ for f in (rule.find, rule.measure, rule.skip) if f]
        told = {k: v for k, v in vars(rule).items() if v and not callable(v)}
        del told["about"], told["limit"]  # prose
        lines.append(f"{told.pop('name')} {' '.join(functions)}\n")
        lines += [f"  {name}: {value}\n" for name, value in told.items()]
    assert_as_kept("".join(lines), "rules.txt", tmp_path)


@pytest.mark.parametrize(
    ("lower_is_worse", "sizes", "severities"),
    [
        (
            False,
            [0.1, 0.11, 0.2, 0.21, np.nan],
            ["", "warning", "warning", "failed", ""],
        ),
        (
            True,
            [0.2, 0.19, 0.1, 0.09, np.nan],
            ["", "warning", "warning", "failed", ""],
        ),
    ],
)
def test_a_size_beyond_a_threshold_is_found(lower_is_worse, sizes, severities):
    level = Level(0.2, 0.1) if lower_is_worse else Level(0.1, 0.2)
    rule = Rule("size", "", level, "", lambda *_: (), lower_is_worse=lower_is_worse)
    robot = CheckedRobot(POST, Thresholds(), collisions_of(POST), False)
    measured = measure(robot, post_motion(seconds=0.08), (), {})
    beyond = [column for column, severity in enumerate(severities) if severity]
    assert rule.columns(measured, np.tile(sizes, (5, 1))) == beyond
    finding = rule.compared(measured, ("a",), np.array(sizes), "{worst} m{when}")
    assert (finding.worst, finding.worst_time) == (sizes[3], measured.times[3])
    assert finding.severity == "failed"
    assert finding.intervals == ((finding.worst_time, finding.worst_time),)
    assert finding.text == f"{sizes[3]} m at 0.060 s"
    one = np.full(5, np.nan)
    for column, severity in enumerate(severities):
        one[0] = sizes[column]
        found = rule.compared(measured, (), one, "")
        assert (found.severity if found else "") == severity


def test_measurements_of_rules_are_joined_over_all_samples():
    """A long motion is measured piece by piece."""
    robot = CheckedRobot(POST, Thresholds(), SelfCollisions(POST, ()), False)
    motion = post_motion(1.2, seconds=30.0)
    own = {
        "height": lambda robot, poses: poses[:, robot.links.index("arm"), 2],
        "near": lambda robot, poses: robot.collisions.contacts(poses, 0.5, [0]),
    }
    measured = measure(robot, motion, (), own)
    assert len(measured.times) > CHUNK
    assert measured.own["height"].shape == measured.times.shape
    frames = measured.own["near"].sample
    assert (np.diff(frames) > 0).all() and frames[-1] > CHUNK
    pairs = robot.collisions.pairs
    for pair, distances, points in per_pair(measured, measured.own["near"], pairs):
        assert pair == robot.collisions.pairs[0]
        np.testing.assert_array_equal(np.flatnonzero(~np.isnan(distances)), frames)
        apart = np.linalg.norm(points[frames, 1] - points[frames, 0], axis=1)
        np.testing.assert_allclose(apart, np.abs(distances[frames]), atol=1e-9)


def test_of_two_findings_the_worse_one_is_known():
    texts = {"check": "a", "severity": "failed", "subject": (), "unit": "", "text": ""}
    times = {"first_time": 0.0, "worst_time": 0.0, "share": 0.0, "intervals": ()}
    low, lower = (
        Finding(**texts, **times, worst=w, bound=1.0).badness for w in (0.5, 0.4)
    )
    high, higher = (
        Finding(**texts, **times, worst=w, bound=1.0).badness for w in (1.5, 1.6)
    )
    assert lower > low
    assert higher > high
