"""When the robot is spawned again."""

from types import SimpleNamespace

import pytest

rospy = pytest.importorskip("rospy", reason="rospy is not installed")
pytest.importorskip("gazebo_msgs", reason="no workspace is sourced")

from g1_description.gazebo.parameters import SpawnerParameters  # noqa: E402
from g1_description.gazebo.programs import spawn_robot  # noqa: E402


def test_a_gazebo_that_is_replaced_while_the_robot_is_spawned_gets_it(monkeypatch):
    """The new one may be there before the old one's end is told."""
    address, spawned, known = ["old"], [], []

    def wait_for(*_):
        address[0] = "old"  # an older one has gone meanwhile

    def spawn(*_):
        spawned.append(address[0])
        address[0] = "new"
        raise rospy.ServiceException("transport error")

    def wait_for_another(one, timeout):
        known.append(one)
        raise rospy.ROSInterruptException

    address[0] = "older"
    monkeypatch.setattr(spawn_robot, "address_of_gazebo", lambda: address[0])
    monkeypatch.setattr(spawn_robot, "wait_for_another", wait_for_another)
    monkeypatch.setattr(spawn_robot, "spawn", spawn)
    gazebo = SimpleNamespace(wait_for=wait_for)
    spawn_robot.spawn_in_each(SpawnerParameters(), gazebo)
    assert (spawned, known) == (["old"], ["old"])
