"""Objects that links carry in the course of a motion."""

import numpy as np
import pytest

from g1_description.errors import UnknownNameError
from g1_description.motion.motion import Motion
from g1_description.robot.load import read_description
from g1_description.robot.state import RobotState
from g1_description.robot.transform import compose, inverse
from g1_description.scenes.carried import (
    RobotLinks,
    carried_to,
    holds_of,
    motion_links,
    object_poses,
)
from g1_description.scenes.scene import Scene


@pytest.fixture(scope="module")
def robot():
    return read_description("g1_29dof")


def test_objects_stay_where_they_are_in_what_holds_them(robot):
    rng, scene = np.random.default_rng(5), Scene()
    for name in ("still", "whole", "passed"):
        scene.box(name, [0.1, 0.1, 0.1], rng.normal(size=3), rpy=rng.normal(size=3))
    scene.attach("whole", "left_hand")
    scene.attach("passed", "left_wrist_yaw_link", 1.0, 2.0)
    scene.attach("passed", "right_hand", 2.0, 3.0)
    names = [joint.name for joint in robot.movable_joints]
    bases = rng.normal(size=(6, 7))
    bases[:, 3:] /= np.linalg.norm(bases[:, 3:], axis=1, keepdims=True)
    positions = rng.normal(size=(6, len(names)))
    motion = Motion(np.arange(6.0), tuple(names), positions, base_poses=bases)
    links = motion_links(robot, motion)
    holds = holds_of(scene.values(), robot, links)
    times = np.sort(np.append(rng.uniform(-1.0, 6.0, 50), [1.0, 2.0, 3.0]))
    poses = object_poses(holds, times, links)
    np.testing.assert_array_equal(poses[:, 0], np.tile(scene["still"].pose, (53, 1)))

    def relative(link, column, some):
        return compose(inverse(links(link, times[some])), poses[some, column])

    left = robot.profile.links["left_hand"]
    for link, column, some in (
        (left, 1, times < 9.0),
        ("left_wrist_yaw_link", 2, (times >= 1.0) & (times < 2.0)),
        (robot.profile.links["right_hand"], 2, (times >= 2.0) & (times < 3.0)),
    ):
        found = relative(link, column, some)
        np.testing.assert_allclose(found, found[[0] * len(found)], atol=1e-9)
    np.testing.assert_array_equal(
        poses[times < 1.0, 2][-1:], scene["passed"].pose[np.newaxis]
    )
    # Nothing jumps when it is taken, passed on and let go.
    near = np.array([[t - 1e-9, t] for t in (0.0, 1.0, 2.0, 3.0)]).ravel()
    found = object_poses(holds, near, links).reshape(4, 2, 3, 7)
    np.testing.assert_allclose(found[:, 0], found[:, 1], atol=1e-6)
    assert len(np.unique(poses[times >= 3.0, 2], axis=0)) == 1
    # What is carried now is in the same grip at the start of another motion.
    now = RobotState(0, tuple(names), positions[3], base_pose=bases[3])
    given = [scene["still"], scene["whole"]], poses[:2, 0]
    left_now, left_then = links(left, np.array([3.0, 0.0]))
    still, whole = carried_to(*given, RobotLinks(robot), now, motion)
    np.testing.assert_array_equal(still, poses[0, 0])
    found = compose(inverse(left_then), whole)
    np.testing.assert_allclose(found, compose(inverse(left_now), poses[1, 0]))


def test_a_link_that_is_not_there_is_named(robot):
    scene = Scene()
    scene.sphere("ball", 0.1, [0, 0, 1])
    scene.attach("ball", "left_hant")
    with pytest.raises(UnknownNameError, match=r"ball .*left_hant.* left_hand"):
        holds_of(scene.values(), robot, None)
