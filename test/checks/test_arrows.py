"""Contact forces are arrows where the floor pushes, as long as they are large."""

import numpy as np
import pytest
import trimesh

from g1_description import Robot
from g1_description.checks.arrows import (
    BLUE,
    HEAD,
    HEAD_LENGTH,
    LENGTH,
    RED,
    SHAFT,
    SIDES,
    Arrow,
    motion_arrows,
)
from g1_description.errors import MotionError
from g1_description.motion.motion import Motion
from g1_description.robot.state import RobotState
from g1_description.robot.transform import compose

ROBOT = Robot()
NAMES = tuple(ROBOT.joint_names)
STAND, BASE = ROBOT.named_configuration("stand"), np.array([0, 0, 0.7634, 0, 0, 0, 1])
TIMES = np.arange(0.0, 1.001, 0.02)


def standing(height=0.0):
    """Return arrows of a robot that stands, or hovers at a height in [m]."""
    base = np.tile(BASE, (len(TIMES), 1))
    base[:, 2] += height
    motion = Motion(TIMES, NAMES, np.tile(STAND, (len(TIMES), 1)), None, base)
    return motion_arrows(ROBOT.description, motion)


def test_arrows_on_both_feet_are_together_as_long_as_the_weight():
    found = standing().at(0.507)
    assert [arrow.color for arrow in found] == [BLUE, BLUE]
    whole = sum(arrow.vector for arrow in found)
    assert whole == pytest.approx([0.0, 0.0, LENGTH], abs=1e-3)
    poses = ROBOT.link_poses(STAND, BASE)
    for arrow, side in zip(found, ("left", "right")):
        ankle = poses[f"{side}_ankle_roll_link"][:3]
        assert np.abs(arrow.start[:2] - ankle[:2]).max() < 0.1
        assert arrow.start[2] == pytest.approx(0.0, abs=0.005)
    assert not standing().text(0.5)


def test_a_robot_in_the_air_lacks_its_weight_above_the_floor():
    found = standing(0.1)
    (arrow,) = found.at(0.5)
    assert arrow.color == RED
    assert arrow.vector == pytest.approx([0.0, 0.0, LENGTH])
    center = ROBOT.center_of_mass(STAND, BASE)
    assert arrow.start == pytest.approx([*center[:2], 0.0], abs=1e-6)
    assert found.text(0.5) == "344 N and 0.0 N m are missing"
    for unknown in (0.0, 1.0, 1.2):  # without accelerations, and after the end
        assert found.at(unknown) == [] and found.text(unknown) == ""


def test_arrows_go_with_a_robot_that_stands_elsewhere_but_as_in_the_motion():
    found, moved = standing(), np.array([3.0, 1.0, 0.0, 0.6, 0.0, 0.0, 0.8])
    state = RobotState(0, NAMES, np.array(STAND), base_pose=compose(moved, BASE))
    for before, after in zip(found.at(0.5), found.on(state, 0.5)):
        points = before.start, before.start + before.vector
        start, tip = (compose(moved, np.append(p, BASE[3:]))[:3] for p in points)
        assert after.start == pytest.approx(start)
        assert after.start + after.vector == pytest.approx(tip)
    bent = RobotState(0, NAMES, np.array(STAND) + 0.3, base_pose=BASE)
    assert found.on(bent, 0.5) == []


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.4), (-0.2, 0.1, 0.0), (0.02, 0, 0)])
def test_the_triangles_of_an_arrow_are_a_shaft_and_a_head(vector):
    start, vector = np.array([1.0, 2.0, 3.0]), np.array(vector)
    corners = Arrow(start, vector, RED).corners()
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3))
    length = np.linalg.norm(vector)
    head = min(HEAD_LENGTH, length / 2.0)
    area = SIDES / 2.0 * np.sin(2.0 * np.pi / SIDES)  # of a radius of 1
    volume = area * (SHAFT**2 * (length - head) + HEAD**2 * head / 3.0)
    assert mesh.volume == pytest.approx(volume)
    along = (corners - start) @ vector / length
    assert along.min() == pytest.approx(0.0, abs=1e-9)
    assert corners[along.argmax()] == pytest.approx(start + vector)


def test_without_a_base_forces_are_unknown_and_that_is_said():
    motion = Motion(TIMES, NAMES, np.tile(STAND, (len(TIMES), 1)))
    with pytest.raises(MotionError, match="Contact forces are unknown: the motion has"):
        motion_arrows(ROBOT.description, motion)
