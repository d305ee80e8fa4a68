"""A configuration at rest is checked as a motion of one sample."""

from pathlib import Path

import numpy as np
import pytest

from g1_description.checks.checker import Checker
from g1_description.checks.thresholds import Thresholds
from g1_description.checks.thresholds_file import with_thresholds
from g1_description.errors import MotionError, UnknownNameError
from g1_description.files.uris import with_absolute_uris
from g1_description.robot.load import read_absolute
from g1_description.robot.rotation import from_rpy
from g1_description.robot.urdf import parse_urdf

ROOT = Path(__file__).parents[2]
ROBOT = parse_urdf(read_absolute(str(ROOT / "urdf" / "g1_29dof.urdf")).text)
JOINTS = tuple(joint.name for joint in ROBOT.movable_joints)
STRICT = with_thresholds(
    Thresholds(),
    {
        "center_of_mass": {"failure": -0.05},
        "penetration": {"warning": None, "failure": -0.001},
        "floating": {"warning": 0.0005},
        "position": {"warning": None, "failure": -0.1},
    },
)
"""So that almost everything is found."""


@pytest.fixture(scope="module", params=[Thresholds(), STRICT])
def checker(request):
    return Checker(ROBOT, request.param)


def random_states(count):
    """Draw configurations, some beyond limits, around the height of standing."""
    rng = np.random.default_rng(5)
    lower = np.array([joint.lower for joint in ROBOT.movable_joints])
    upper = np.array([joint.upper for joint in ROBOT.movable_joints])
    for number in range(count):
        scale = rng.choice([0.05, 0.3, 1.05])
        q = np.clip(0.0, lower, upper) + scale * (rng.uniform(lower, upper))
        turn = from_rpy(rng.normal(scale=0.1 * scale, size=3))
        height = 0.793 + rng.normal(scale=0.05)
        base = np.concatenate([rng.normal(size=2), [height], turn])
        names = JOINTS if number % 3 else JOINTS[5:20]
        yield dict(zip(names, q.tolist())), base if number % 4 else None


def test_every_check_of_a_configuration_finds_something(checker):
    found = set()
    for positions, base in random_states(30):
        verdict = checker.check_state(positions, base)
        assert verdict.figures["samples"] == 1
        assert ("floating" in verdict.checked) == (base is not None)
        found |= {finding.check for finding in verdict.findings}
    assert found >= {"position", "self_collision", "penetration", "floating"}
    assert "center_of_mass" in found


def floating(origin):
    """Let the G1 float in a world, whose joint has an origin."""
    text = (ROOT / "urdf" / "g1_29dof.urdf").read_text()
    x, y, z, roll, pitch, yaw = origin
    joint = f"""<link name="world"/><joint name="float" type="floating">
        <parent link="world"/><child link="pelvis"/>
        <origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/></joint></robot>"""
    where = ROOT / "urdf"
    text = with_absolute_uris(text.replace("</robot>", joint), where)
    return parse_urdf(text)


def test_a_robot_that_floats_in_a_world_stands_where_its_base_is(checker):
    """Whatever the origin of its joint."""
    other = Checker(floating((0.5, -1, 2, 0.3, -0.2, 1)), checker.thresholds)
    for positions, base in random_states(5):
        plain = checker.check_state(positions, base)
        found = other.check_state(positions, base)
        assert [f.text for f in found.findings] == [f.text for f in plain.findings]


def test_only_what_is_wanted_is_made(checker):
    positions, base = next(random_states(1))
    for only in (("position",), ("self_collision", "floating"), ("center_of_mass",)):
        for where in (base, None):
            verdict = checker.check_state(positions, where, only)
            assert {*verdict.checked, *verdict.skipped} == {*only}


def test_a_robot_that_is_fast_is_checked_as_at_rest_but_for_its_velocities(checker):
    """Its feet do not skate, and its centre of mass is checked."""
    rates = dict.fromkeys(JOINTS, 1.0)
    for positions, base in random_states(5):
        own = {name: rates[name] for name in positions}
        fast = checker.check_state(positions, base, (), own)
        still = checker.check_state(positions, base)
        assert {*fast.checked} == {*still.checked, "velocity"}
        assert [f.text for f in fast.findings] == [f.text for f in still.findings]


def test_velocities_are_compared_with_their_limits(checker):
    knee = ROBOT.movable_joints[JOINTS.index("left_knee_joint")]
    positions = dict.fromkeys(JOINTS, 0.0)
    for factor, count in ((0.99, 0), (1.01, 1)):
        rates = {**positions, knee.name: -factor * knee.velocity}
        verdict = checker.check_state(positions, None, ("velocity",), rates)
        assert [f.subject for f in verdict.findings] == [(knee.name,)] * count
    skipped = checker.check_state(positions).skipped
    assert skipped["velocity"] == "there is only one configuration"


@pytest.mark.parametrize(
    ("positions", "only", "error", "words"),
    [
        ({"left_nee_joint": 0.0}, (), UnknownNameError, "Its joints: left_knee_joint"),
        ({"left_knee_joint": np.nan}, (), MotionError, "nan"),
        ({}, ("balance",), UnknownNameError, "Unknown check 'balance'"),
    ],
)
def test_what_is_no_configuration_is_refused(checker, positions, only, error, words):
    with pytest.raises(error, match=words):
        checker.check_state(positions, only=only)


def test_an_effort_is_found_with_a_fixed_base():
    held = Checker(ROBOT, fixed_base=True)
    positions = {"left_shoulder_pitch_joint": -1.57}
    assert "effort" in held.check_state(positions).checked
