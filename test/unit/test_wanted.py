"""What motions and commands want of a robot."""

import numpy as np

from g1_description.bridge.player import Wanted
from g1_description.motion.playlist import Setpoint

POSE = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0])


def test_the_newest_of_motions_and_commands_is_wanted():
    wanted = Wanted(("hip", "knee", "ankle"))
    assert np.isnan(wanted.positions).all()
    assert np.isnan(wanted.base_pose).all()
    wanted.put(Setpoint(np.array([2, 0]), np.array([0.3, 0.1]), np.zeros(2), POSE))
    wanted.put_joint("ankle", 0.5)
    np.testing.assert_array_equal(wanted.positions, [0.1, np.nan, 0.5])
    wanted.put(Setpoint(np.array([1]), np.array([0.2]), np.zeros(1)))
    assert wanted.positions.tolist() == [0.1, 0.2, 0.5]
    assert wanted.base_pose.tolist() == POSE.tolist()
    wanted.put_base(np.nan)
    assert np.isnan(wanted.base_pose).all()
