"""Joint velocities against PyBullet's own, of robots thrown into free motion."""

import numpy as np
import pytest
from conftest import REPOSITORY
from scipy.spatial.transform import Rotation

from g1_description.bridge.estimator import JointStateEstimator
from g1_description.robot.urdf import parse_urdf

LEFT_OUT = (
    "floating",
    "floating_base",
    "free_bodies",
    "planar",
    "no_joints",
    "range_none",
)
"""They are several bodies, or have a joint that cannot move."""
ROBOTS = [
    file
    for file in sorted((REPOSITORY / "test" / "data").glob("*.urdf"))
    if file.stem not in LEFT_OUT
]
HIGH = np.array([1.0, 2.0, 30.0, 0.0, 0.0, 0.0, 1.0])
SPINNING = np.array([0.3, -0.2, 0.5, 2.0, -3.0, 1.0])
every_robot = pytest.mark.parametrize("file", ROBOTS, ids=lambda file: file.stem)


class Thrown:
    """A robot that flies, spins and moves its joints, and what PyBullet says of it."""

    def __init__(self, world, text):
        world.spawn_urdf("robot", text, HIGH)
        world.put("robot", HIGH, SPINNING)
        self._client, self._body = world.client, world.body("robot").number
        self._index = world.joint_numbers("robot")
        name_of = world.body("robot").link_name
        self._links = [name_of(index) for index in range(-1, len(self._index))]
        self._let_go(parse_urdf(text), np.random.default_rng(1))

    def _let_go(self, description, random):
        """Put joints within a half turn of the middle of their limits, and move."""
        for joint in description.movable_joints:
            middle = 0.5 * (joint.lower + joint.upper)
            middle = middle if np.isfinite(middle) else 0.0
            lower, upper = np.clip([joint.lower, joint.upper], middle - 3, middle + 3)
            start = random.uniform(lower, upper), random.uniform(-3.0, 3.0)
            self._client.resetJointState(self._body, self._index[joint.name], *start)

    def joint_states(self, names):
        """Give positions and velocities, each of shape (n_joints,)."""
        states = [
            self._client.getJointState(self._body, self._index[name])[:2]
            for name in names
        ]
        return np.array(states).reshape(-1, 2).T

    def link_states(self):
        """Give names, poses and twists of the links' frames."""
        states = [self._base_state()]
        for index in range(len(self._index)):
            state = self._client.getLinkState(
                self._body, index, computeLinkVelocity=1, computeForwardKinematics=1
            )
            states.append((state[0], state[4], state[5], state[6], state[7]))
        center, origin, rotation, linear, angular = map(np.array, zip(*states))
        linear = linear + np.cross(angular, origin - center)
        names = tuple(f"robot::{link}" for link in self._links)
        return names, np.hstack([origin, rotation]), np.hstack([linear, angular])

    def _base_state(self):
        """Give what getLinkState does not give of the base."""
        center, turned = self._client.getBasePositionAndOrientation(self._body)
        inertial = self._client.getDynamicsInfo(self._body, -1)[3:5]
        rotation = Rotation.from_quat(turned) * Rotation.from_quat(inertial[1]).inv()
        origin = np.array(center) - rotation.apply(inertial[0])
        velocity = self._client.getBaseVelocity(self._body)
        return (center, origin, rotation.as_quat(), *velocity)


def assert_as_fast(measured, expected, tolerance):
    """Compare velocities, each relative to the joint's largest."""
    measured, expected = np.array(measured), np.array(expected)
    largest = np.abs(expected).max(axis=0)
    assert (largest > 0.1).all()
    assert (np.abs(measured - expected).max(axis=0) / largest).max() < tolerance


@pytest.mark.slow
@pytest.mark.parametrize("gravity", [0.0, -9.8])
@every_robot
def test_joints_are_as_fast_as_pybullet_says(make_world, file, gravity):
    """Links lumped as the world lumps them."""
    text = file.read_text()
    world = make_world("limp", gravity=(0.0, 0.0, gravity))
    robot, estimator = (
        Thrown(world, text),
        JointStateEstimator({"robot": parse_urdf(text)}),
    )
    names = world.link_names
    measured, expected = [], []
    for _ in range(100):
        world.step()
        (seen,) = estimator.update(names, *world.link_states(), world.time_ns)
        position, velocity = robot.joint_states(seen.names)
        np.testing.assert_allclose(seen.positions, position, atol=1e-9)
        measured.append(seen.velocities)
        expected.append(velocity)
    assert not world.contacts()
    assert_as_fast(measured, expected, 1e-6)


@every_robot
def test_the_link_velocities_of_pybullet_give_its_joint_velocities(make_world, file):
    """No kinematics of ours.

    PyBullet rounds the frames it tells to floats, and an axis that is off by 1e-7 rad
    tells a velocity that is off by the square of that.
    """
    text = file.read_text()
    world = make_world("limp")
    robot, estimator = (
        Thrown(world, text),
        JointStateEstimator({"robot": parse_urdf(text)}),
    )
    measured, expected = [], []
    for _ in range(40):
        world.step()
        (seen,) = estimator.update(*robot.link_states(), world.time_ns)
        measured.append(seen.velocities)
        expected.append(robot.joint_states(seen.names)[1])
    assert_as_fast(measured, expected, 1e-9)
