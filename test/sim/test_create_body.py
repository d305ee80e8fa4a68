"""What PyBullet takes only in parts, or not at all, of a robot."""

import numpy as np
import pytest
from robots import BOX, MASS, link

from g1_description.core.errors import DescriptionError
from g1_description.core.transform import IDENTITY
from g1_description.sim.bullet.create_body import MAX_JOINTS
from g1_description.sim.standing import standing_height

HIGH = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0])


def row_of_boxes(count):
    """Write a link with boxes of 1 m, 2 m apart from each other."""
    boxes = [
        BOX.replace("<geometry>", f'<origin xyz="{2 * n} 0 0"/><geometry>')
        for n in range(count)
    ]
    return link("row", MASS + "".join(boxes))


def chain(count, kept):
    """Write links on top of each other, on joints that Gazebo keeps."""
    joints = "".join(
        f'<joint name="j{n}" type="{"fixed" if kept else "continuous"}">'
        f'<parent link="l{n - 1}"/><child link="l{n}"/><origin xyz="0 0 2"/></joint>'
        + kept
        * f'<gazebo reference="j{n}"><preserveFixedJoint>true'
        "</preserveFixedJoint></gazebo>"
        for n in range(1, count)
    )
    links = "".join(link(f"l{n}", MASS + BOX) for n in range(count))
    return f'<robot name="tower">{links}{joints}</robot>'


@pytest.mark.parametrize("physics", ["kinematic", "limp"])
@pytest.mark.parametrize("count", [16, 17, 40])
def test_a_link_may_have_any_number_of_shapes(make_world, physics, count):
    """PyBullet's process dies of 17 shapes that it is given at once."""
    world = make_world(physics, gravity=(0.0, 0.0, -10.0))
    robot = f'<robot name="r">{row_of_boxes(count)}{link("top", MASS + BOX)}'
    robot += '<joint name="j" type="continuous"><parent link="row"/><child link="top"/>'
    robot += '<origin xyz="0 0 2"/></joint></robot>'
    assert world.spawn_urdf("r", robot, HIGH) == ()
    cube = f'<robot name="c">{link("cube", MASS + BOX)}</robot>'
    for end in (0, count - 1):
        touching = HIGH.copy()
        touching[0] += 2.0 * end + 0.9
        world.spawn_urdf("c", cube, touching)
        assert world.contacts() == {("c::cube", "r::row")}
        world.delete("c")
    world.step()
    falls = world.is_dynamic * 10.0 * 1e-6  # [m], by Euler's semi-implicit step
    np.testing.assert_allclose(world.model("r").poses[:, 2], [5.0 - falls, 7.0 - falls])


def test_shapes_beyond_the_sixteenth_hold_no_more_gravity_off(make_world):
    """A link that gravity does not pull floats, whatever its number of shapes."""
    world = make_world("limp")
    off = '<gazebo reference="row"><turnGravityOff>true</turnGravityOff></gazebo>'
    world.spawn_urdf("r", f'<robot name="r">{row_of_boxes(40)}{off}</robot>', HIGH)
    world.run(0.1)
    np.testing.assert_allclose(world.model("r").pose, HIGH, atol=1e-9)


@pytest.mark.parametrize("kept", [True, False], ids=["fixed", "turning"])
def test_in_kinematic_a_robot_may_have_more_links_than_pybullet(make_world, kept):
    world = make_world()
    text = chain(MAX_JOINTS + 2, kept)
    assert world.spawn_urdf("tower", text, HIGH) == ()
    world.put("tower", np.array(IDENTITY), np.zeros(6))
    world.step()
    model = world.model("tower")
    assert len(model.link_names) == MAX_JOINTS + 2
    np.testing.assert_allclose(model.poses[:, 2], 2.0 * np.arange(MAX_JOINTS + 2))
    assert standing_height(model.assembly, IDENTITY[3:]) == 0.501
    world.reset()
    world.delete("tower")


@pytest.mark.parametrize("physics", ["hold", "limp"])
def test_more_links_than_pybullet_has_room_for_are_refused(make_world, physics):
    world = make_world(physics)
    assert world.spawn_urdf("fits", chain(MAX_JOINTS + 1, True), HIGH) == ()
    words = "'tower' needs 129 links, .*; only kinematic physics has room for more than"
    with pytest.raises(DescriptionError, match=words):
        world.spawn_urdf("tower", chain(MAX_JOINTS + 2, True), HIGH)
    assert "tower" not in world.models
    world.step()
