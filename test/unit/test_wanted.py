"""What is measured is told as it is wanted, where only rounding differs."""

import warnings

import numpy as np
import pytest

from g1_description.core.bridge.estimator import Observation
from g1_description.core.bridge.wanted import Wanted
from g1_description.core.motion.playlist import Setpoint

JOINTS = "hip", "knee", "ankle"
POSE = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0])


@pytest.fixture(autouse=True)
def no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def observation(names, position, velocity, base=None):
    arrays = np.array(position), np.array(velocity)
    return Observation(names, *arrays, base, (), (), {}, True, False)


def test_only_rounding_is_replaced():
    wanted = Wanted(JOINTS)
    wanted.put(Setpoint(np.array([2, 0]), np.array([0.3, 0.1]), np.zeros(2), POSE))
    nearly = POSE + np.array([9e-13, 0, 0, 0, 0, 0, 0])
    names = JOINTS
    seen = observation(
        names, [0.1 + 5e-13, 0.2, 0.3 + 5e-12], [1e-13, 1e-13, 1], nearly
    )
    found = wanted.without_rounding(seen)
    assert found.position.tolist() == [0.1, 0.2, 0.3 + 5e-12]
    assert found.velocity.tolist() == [0.0, 1e-13, 1.0]
    assert found.base_pose.tolist() == POSE.tolist()
    assert seen.position[0] == 0.1 + 5e-13


def test_joints_are_found_by_name_as_links_come_and_go():
    wanted = Wanted(JOINTS)
    wanted.put_at_rest("knee", 0.5)
    for names in (("ankle", "knee"), ("knee",), (), JOINTS):
        position = [0.5 + 1e-13] * len(names)
        seen = observation(names, position, [1e-14] * len(names))
        found = wanted.without_rounding(seen)
        exact = [name == "knee" for name in names]
        assert [p == 0.5 for p in found.position] == exact
        assert [v == 0.0 for v in found.velocity] == exact
        assert found.base_pose is None


def test_what_is_wanted_changes_and_ends():
    wanted = Wanted(JOINTS)
    near = POSE + 1e-13
    seen = observation(("hip",), [0.2 + 1e-13], [0.0], near)
    for position in (0.1, 0.2):
        wanted.put_at_rest("hip", position)
        found = wanted.without_rounding(seen)
        assert found.position[0] == (0.2 if position == 0.2 else 0.2 + 1e-13)
    wanted.put_base(POSE)
    assert wanted.without_rounding(seen).base_pose.tolist() == POSE.tolist()
    wanted.put_base(np.nan)
    assert wanted.without_rounding(seen).base_pose.tolist() == near.tolist()
