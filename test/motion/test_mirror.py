"""A mirrored motion is what a mirror beside the robot shows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from g1_description import Robot
from g1_description.errors import MotionError
from g1_description.motion.edit import mirrored
from g1_description.robot.urdf import parse_urdf


def random_motion(robot, seed=0):
    positions = robot.random_configuration(seed, 20)
    random = np.random.RandomState(seed)
    quaternions = Rotation.from_quat(random.normal(size=(20, 4))).as_quat()
    base = np.hstack([random.normal(size=(20, 3)), quaternions])
    return robot.trajectory(np.arange(20) / 10, positions, positions, base)


def swapped(name):
    sides = {"left": "right", "right": "left"}
    return "_".join(sides.get(word, word) for word in name.split("_"))


def test_links_are_where_a_mirror_shows_them(g1_text):
    robot = Robot(g1_text)
    motion = random_motion(robot)
    found = mirrored(motion, robot.description)
    before = robot.link_poses(motion.positions, motion.base_poses)
    after = robot.link_poses(robot.positions_of(found), found.base_poses)
    moving = {joint.child for joint in robot.description.movable_joints}
    for link in moving:
        shown = before[link][:, :3] * [1, -1, 1]
        np.testing.assert_allclose(
            after[swapped(link)][:, :3], shown, atol=1e-3, err_msg=link
        )


def test_twice_mirrored_it_is_the_same():
    robot = Robot()
    motion = random_motion(robot, 1)
    back = mirrored(mirrored(motion, robot.description), robot.description)
    for name in ("positions", "velocities", "base_poses"):
        np.testing.assert_array_equal(getattr(back, name), getattr(motion, name))
    assert back.joint_names == motion.joint_names


def test_a_motion_of_one_arm_becomes_one_of_the_other():
    robot = Robot()
    one = random_motion(robot)
    arm = replace(
        one,
        joint_names=("left_shoulder_roll_joint", "left_elbow_joint"),
        positions=one.positions[:, :2],
        velocities=None,
        base_poses=None,
    )
    found = mirrored(arm, robot.description)
    assert found.joint_names == ("right_shoulder_roll_joint", "right_elbow_joint")
    np.testing.assert_array_equal(found.positions, arm.positions * [-1, 1])


ARMS = """<robot name="arms"><link name="trunk"/><link name="a"/><link name="b"/>
<joint name="L_arm" type="{kind}"><parent link="trunk"/><child link="a"/>
<origin xyz="0 0.1 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1"
velocity="1"/></joint>
<joint name="{right}" type="{kind}"><parent link="trunk"/><child link="b"/>
<origin xyz="{x} -0.1 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1"
velocity="1"/></joint></robot>"""


@pytest.mark.parametrize(("kind", "sign"), [("revolute", 1.0), ("prismatic", -1.0)])
def test_a_mirror_turns_displacements_but_no_turns_about_its_normal(kind, sign):
    robot = Robot(ARMS.format(kind=kind, right="R_arm", x=0))
    motion = robot.trajectory([0.0, 1.0], [[0.1, 0.2], [0.3, 0.4]])
    found = mirrored(motion, robot.description).positions
    np.testing.assert_array_equal(found, sign * motion.positions[:, ::-1])


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"right": "R_arm", "x": 0.05}, r"not symmetric at zero \(L_arm, R_arm\)"),
        ({"right": "other", "x": 0}, "L_arm have no counterparts"),
    ],
)
def test_a_robot_that_is_not_symmetric_is_told(given, told):
    robot = Robot(ARMS.format(kind="revolute", **given))
    motion = robot.trajectory([0.0, 1.0], np.zeros((2, 2)))
    with pytest.raises(MotionError, match=told):
        mirrored(motion, robot.description)
    other = parse_urdf('<robot name="no"><link name="a"/></robot>')
    with pytest.raises(MotionError, match="no has no joints L_arm"):
        mirrored(motion, other)
