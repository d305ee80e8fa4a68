"""Objects that a link carries."""

import numpy as np
import pytest
from oracle import assert_poses_close
from worlds import OUR_G1

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.motion.motion import Motion
from g1_description.robot.transform import compose, inverse
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import sdf_of

PLACE = np.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0])
WRIST, ELBOW = "left_wrist_yaw_link", "left_elbow_joint"
MASS = '<inertial><origin xyz="{x} 0 0.1"/><mass value="2"/>' + (
    '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>'
)
ARM = f"""<robot name="arm"><link name="world"/><link name="base">{MASS}</link>
<joint name="fix" type="fixed"><parent link="world"/><child link="base"/></joint>
<link name="arm">{MASS}</link><joint name="turn" type="revolute"><parent link="base"/>
<child link="arm"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="500"
velocity="10"/></joint></robot>""".replace("{x}", "0.2")


def spawn_box(world, at, name="box", **given):
    box = Scene().box(name, [0.2, 0.1, 0.1], at, **given)
    world.spawn_sdf(name, sdf_of([box]), box.pose)
    return world.model(name)


def held(world, robot, box):
    """Give the place of a box in the frame of the wrist."""
    row = robot.link_names.index(WRIST)
    return compose(inverse(robot.poses[row]), box.root_poses[0])


def test_an_object_goes_where_its_link_goes_and_stays_where_it_is_let_go(make_world):
    world = make_world()
    world.spawn_urdf("g1", OUR_G1, PLACE)
    robot, box = world.model("g1"), spawn_box(world, [0.3, 0.2, 0.9], rpy=[1, 2, 3])
    grip = held(world, robot, box)
    cup = spawn_box(world, [0.3, 0.2, 1.0], "cup")
    on_box = compose(inverse(box.root_poses[0]), cup.root_poses[0])
    world.attachments.attach(cup, "", box, "link")  # before the box is carried itself
    world.attachments.attach(box, "", robot, "left_hand")
    other = np.array([3.0, 2.0, 1.0, 0.0, 0.6, 0.0, 0.8])
    world.put("g1", other, np.zeros(6))
    world.set_joint_positions("g1", {ELBOW: 1.0})
    assert_poses_close(held(world, robot, box), grip, 1e-9)
    now = compose(inverse(box.root_poses[0]), cup.root_poses[0])
    assert_poses_close(now, on_box, 1e-9)
    positions = np.array([[1.0], [0.0]])
    world.motions.play(
        robot, Motion(np.array([0.0, 0.5]), (ELBOW,), positions), world.time_ns
    )
    world.run(0.25)
    assert_poses_close(held(world, robot, box), grip, 1e-9)
    before, twist = box.root_poses[0].copy(), box.twist
    world.run(0.001)
    np.testing.assert_allclose(
        (box.root_poses[0] - before)[:3] / 0.001, twist[:3], atol=0.02
    )
    world.put("box", other, np.zeros(6))  # placed elsewhere, it is carried from there
    world.run(0.5)
    moved = box.root_poses[0].copy()
    assert not np.allclose(moved, other)
    world.attachments.detach(box)
    world.set_joint_positions("g1", {ELBOW: 0.5})
    np.testing.assert_array_equal(box.root_poses[0], moved)
    assert not box.twist.any()


@pytest.mark.both_engines
def test_the_mass_of_an_object_counts_while_it_is_carried(make_world):
    world = make_world("hold")
    world.spawn_urdf("arm", ARM, PLACE)
    arm, box = world.model("arm"), spawn_box(world, [0.5, 0, 0.9], mass=3)
    world.attachments.attach(box, "", arm, "arm")
    start = box.root_poses[0].copy()
    world.run(0.5)
    assert_poses_close(box.root_poses[0], start, 2e-3)
    both = world.engine.efforts(arm)[0]
    assert both == pytest.approx(-9.8 * (2 * 0.2 + 3 * 0.5), rel=0.01)
    world.set_joint_positions("arm", {"turn": 0.5})
    world.run(0.5)
    turned = np.array([np.cos(0.5), 0.0, -np.sin(0.5)])
    np.testing.assert_allclose(
        box.root_poses[0][:3] - PLACE[:3],
        0.5 * turned + 0.1 * np.array([np.sin(0.5), 0.0, np.cos(0.5)]),
        atol=3e-3,
    )
    world.attachments.detach(box)
    world.run(0.2)
    alone = world.engine.efforts(arm)[0]
    assert alone == pytest.approx(
        -9.8 * 2 * (0.2 * np.cos(0.5) + 0.1 * np.sin(0.5)), rel=0.02
    )
    assert box.twist[2] == pytest.approx(-9.8 * 0.2, rel=0.05)
    world.attachments.attach(box, "", arm, "arm")
    world.run(0.1)
    world.delete("arm")
    world.run(0.1)
    world.reset()
    world.run(0.1)


def test_what_cannot_be_carried_is_refused_with_the_reason(make_world):
    world = make_world("limp")
    world.spawn_urdf("g1", OUR_G1, PLACE)
    robot, box = world.model("g1"), spawn_box(world, [1, 0, 1], mass=1)
    shelf = spawn_box(world, [2, 0, 1], name="shelf")
    with pytest.raises(UnknownNameError, match="g1 has no link left_hnad"):
        world.attachments.attach(box, "", robot, "left_hnad")
    with pytest.raises(UnknownNameError, match="box has no link lid"):
        world.attachments.attach(box, "lid", robot, WRIST)
    with pytest.raises(InvalidValueError, match="shelf is static"):
        world.attachments.attach(shelf, "", robot, WRIST)
    with pytest.raises(InvalidValueError, match="no link carries box"):
        world.attachments.detach(box)
    world.attachments.attach(box, "", robot, WRIST)
    with pytest.raises(InvalidValueError, match="box is carried by g1"):
        world.attachments.attach(robot, "", box, "link")
    assert world.attachments
    world.delete("g1")
    assert not world.attachments
