"""How low a robot comes, against shapes placed by scipy and PyBullet's distances."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from g1_description.motion.trajectory import Trajectory
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.standing import lowest_height

SHAPES = """<robot name="r"><link name="a">
<collision><origin xyz="0.1 0 0.2" rpy="0.3 0.2 0.1"/><geometry>
<box size="0.4 0.2 0.1"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/>
<origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<link name="b"><visual><origin xyz="0 0 -0.5"/><geometry>
<sphere radius="0.07"/></geometry></visual></link></robot>"""


def still(pose, names=(), positions=()):
    return Trajectory(
        np.zeros(1), tuple(names), np.array([positions]), base_poses=np.array([pose])
    )


def test_boxes_and_spheres_are_where_scipy_puts_them():
    random = np.random.RandomState(4)
    robot = parse_urdf(SHAPES)
    for _ in range(30):
        base = Rotation.from_quat(random.normal(size=4))
        place, angle = random.normal(size=3), random.uniform(-2, 2)
        corners = np.array(
            [[x, y, z] for x in (-0.2, 0.2) for y in (-0.1, 0.1) for z in (-0.05, 0.05)]
        )
        box = Rotation.from_euler("xyz", [0.3, 0.2, 0.1]).apply(corners)
        box = base.apply(box + np.array([0.1, 0, 0.2])) + place
        ball = Rotation.from_rotvec([0, angle, 0]).apply([0, 0, -0.5])
        ball = base.apply(ball + np.array([0, 0, -0.3])) + place
        wanted = min(box[:, 2].min(), ball[2] - 0.07)
        pose = np.concatenate([place, base.as_quat()])
        found = lowest_height(robot, still(pose, ["j"], [angle]))
        assert found == pytest.approx(wanted, abs=1e-12)


def test_the_lowest_of_all_samples_counts():
    robot = parse_urdf(SHAPES)
    poses = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (3, 1))
    poses[1, 2] = -2.0
    trajectory = Trajectory(np.arange(3.0), (), np.zeros((3, 0)), base_poses=poses)
    lowest = lowest_height(robot, trajectory)
    assert lowest == lowest_height(robot, still(poses[1], (), ()))


def test_the_g1_touches_where_pybullet_sees_it_touch(make_world, g1):
    """Lowered to its lowest point, within the millimetre of PyBullet's margins."""
    robot = parse_urdf(g1)
    pose = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    names = ("left_knee_joint", "left_hip_pitch_joint")
    lowest = lowest_height(robot, still(pose, names, (0.6, -0.3)))
    for above, touches in ((0.003, False), (-0.003, True)):
        world = make_world("kinematic")
        pose[2] = 1.0 - lowest + above
        world.spawn_urdf("g1", g1, pose)
        world.set_joint_positions("g1", dict(zip(names, (0.6, -0.3))))
        links = {link for pair in world.contacts() for link in pair}
        assert ("ground_plane::link" in links) == touches
        pose[2] = 1.0
