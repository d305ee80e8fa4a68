"""Pictures of motions: what is where in which colour, and what thinning keeps."""

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from checked import POST, post_motion
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from g1_description.checks.checker import Checker
from g1_description.checks.plot import (
    COLORS,
    MAX_BINS,
    RED,
    bars,
    in_limits,
    motion_plot,
    thinned,
)
from g1_description.checks.verdict import Finding, Verdict
from g1_description.motion.motion import Motion
from g1_description.robot.urdf import parse_urdf

ROBOT = parse_urdf(POST)


@pytest.fixture(scope="module")
def checker():
    return Checker(ROBOT)


def drawn(checker, trajectory):
    verdict = checker.check(trajectory)
    joints = ROBOT.movable_joints
    return motion_plot("a.csv", verdict, joints)


def count(picture, color):
    """Count the pixels of nearly a colour."""
    wanted = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=int)
    return int((np.abs(pixels - wanted).max(axis=2) < 12).sum())


def test_a_picture_shows_what_failed_and_is_the_same_again(checker):
    clean, failed = (drawn(checker, post_motion(reach)) for reach in (0.5, 1.5))
    assert drawn(checker, post_motion(0.5)) == clean
    for picture in (clean, failed):
        width, height = Image.open(io.BytesIO(picture)).size
        assert width == 1600
        assert 300 < height < 2000
        assert picture.startswith(b"\x89PNG")
    assert count(clean, COLORS["failed"]) < 10
    assert count(failed, COLORS["failed"]) > 1000
    assert len(Image.open(io.BytesIO(failed)).getcolors()) <= 128


@pytest.mark.parametrize(
    "trajectory",
    [
        Motion(np.zeros(1), ("arm_joint",), np.zeros((1, 1))),
        Motion(np.arange(3.0), (), np.zeros((3, 0)), base_poses=np.eye(7)[[6] * 3]),
    ],
    ids=["one sample without a base", "a base without joints"],
)
def test_any_motion_is_drawn(checker, trajectory):
    assert drawn(checker, trajectory).startswith(b"\x89PNG")


def test_missing_forces_are_drawn_as_far_as_they_are_known():
    times, known = np.arange(100.0), np.full(100, 0.4)
    reds = []
    for missing in (known, np.full(100, np.nan)):
        found = SimpleNamespace(
            times=times,
            available_friction=np.full(100, np.inf),
            friction=known,
            missing_share=missing,
        )
        measured = SimpleNamespace(
            times=times,
            joint_names=(),
            heights=None,
            balance=None,
            once=lambda _, found=found: found,
        )
        verdict = Verdict("r", checked=("contact_forces",), measured=measured)
        reds.append(count(motion_plot("a.csv", verdict, ()), RED))
    assert reds[0] > reds[1] + 500


@pytest.mark.parametrize("number", range(3))
def test_any_verdict_is_drawn(number):
    verdict = [*three_verdicts()][number]
    assert motion_plot("a.csv", verdict, JOINTS).startswith(b"\x89PNG")


@settings(max_examples=10)
@given(st.integers(4 * MAX_BINS + 1, 9 * MAX_BINS), st.integers(0, 2**31 - 1))
def test_thinning_keeps_peaks_and_order(n, seed):
    random = np.random.RandomState(seed)
    times, values = np.cumsum(random.random_sample(n)), random.standard_normal(n)
    x, y = thinned(times, values)
    assert len(x) == len(y) <= 3 * MAX_BINS
    assert (np.diff(x) >= 0.0).all()
    assert {values.min(), values.max()} <= {y.min(), y.max()}
    assert x[0] == times[0]


@given(st.lists(st.tuples(st.floats(0, 10), st.floats(0, 10)).map(sorted), max_size=6))
def test_marked_times_cover_all_and_do_not_overlap(intervals):
    found = bars(intervals, np.array([0.0, 10.0]))
    ends = [(begin, begin + width) for begin, width in found]
    for first, last in intervals:
        assert any(a <= first + 1e-9 and last <= b + 1e-9 for a, b in ends)
    assert all(b < c for (_, b), (c, _) in zip(ends, ends[1:]))
    assert all(width >= 0.03 - 1e-9 for _, width in found)


def test_limits_are_at_minus_one_and_one():
    joint = replace(ROBOT.movable_joints[0], lower=-0.2, upper=2.8)
    found = in_limits(joint, np.array([-0.2, 1.3, 2.8, 4.3]))
    np.testing.assert_allclose(found, [-1.0, 0.0, 1.0, 2.0], atol=1e-12)
    without = replace(joint, lower=-np.inf, upper=np.inf)
    found = in_limits(without, np.array([0.0, -4.0, 2.0]))
    np.testing.assert_allclose(found, [0.0, -1.0, 0.5])
    assert in_limits(without, np.zeros(1)).tolist() == [0.0]
    assert in_limits(replace(joint, lower=2.0, upper=2.0), np.ones(1)) == [-1.0]


ARM = replace(ROBOT.movable_joints[0], lower=-1.0, upper=3.0, velocity=2.0)
JOINTS = [replace(ARM, name=f"j{number}_joint") for number in range(12)]
JOINTS += [
    replace(ARM, name="wheel_joint", lower=-np.inf, upper=np.inf, velocity=np.inf),
    replace(ARM, name="slow_joint", velocity=0.0),
]


def finding(check, severity, subject, *intervals):
    numbers = 0.5, 0.1, "rad", 1.0, 2.0, 0.5
    return Finding(check, severity, subject, *numbers, intervals, "far")


def three_verdicts():
    """Give verdicts with all there is to be shown, with many joints, and with nothing.

    Their measurements are what pictures need of them.
    """
    found = (
        finding("position", "failed", ("j1_joint",), (2.0, 10.0)),
        finding("skating", "failed", ("left_link",), (1.0, 2.0)),
        finding("self_collision", "failed", ("arm_link", "leg_link"), (2.0, 2.0)),
        finding("position", "warning", ("j1_joint",), (1.0, 10.0)),
        finding("penetration", "warning", (), (9.0, 10.0), (0.0, 1.0), (0.5, 2.0)),
        finding("floating", "failed", ("x" * 60,), (5.0, 6.0)),
        finding("center_of_mass", "warning", ("left_link",), (3.0, 4.0)),
        finding("contact_forces", "failed", (), (0.0, 0.5)),
    )
    full = SimpleNamespace(
        times=np.array([0.0, 1.0, 2.0, 10.0]),
        joint_names=("wheel_joint", "j1_joint", "slow_joint"),
        positions=np.array([[0, -1, 1], [0.5, 1, 1], [-0.25, 3, 1], [0, 9, 1]]),
        velocities=np.array([[9.0, 0, 9], [9, 1, 9], [9, -1, 9], [9, 0.5, 9]]),
        ground_links=("left_link", "other_link", "right_link"),
        heights=np.array([[0.0, 9, 0.1], [0.1, 9, np.inf], [0.0, 9, 0.5], [-1, 9, 0]]),
        balance=SimpleNamespace(
            center_margin=np.array([0.1, 0.0, np.nan, 0.05]),
        ),
        depth=np.array([0.0, 0.002, 0.02, 0.0]),
    )
    contacts = {"left_link": ((0.0, 0.5), (2.0, 3.0)), "right_link": ((9.0, 10.0),)}
    yield Verdict(
        "r", found, ("self_collision",), floor_contacts=contacts, measured=full
    )
    names = tuple(joint.name for joint in JOINTS[:12])
    state = SimpleNamespace(
        times=np.array([3.0]),
        joint_names=names,
        positions=np.linspace(-1.0, 3.0, 12)[None],
        velocities=np.linspace(0.0, 4.0, 12)[None],
        ground_links=(),
        heights=np.zeros((1, 0)),
        balance=None,
        depth=np.zeros(1),
    )
    many = tuple(finding(f"c{n}", "warning", (), (3.0, 3.0)) for n in range(16))
    yield Verdict("s", many, ("self_collision",), measured=state)
    one = {**vars(state), "joint_names": names[1:2], "heights": None}
    yield Verdict("t", measured=SimpleNamespace(**one))
