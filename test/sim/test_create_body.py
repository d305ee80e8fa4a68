"""What PyBullet takes only in parts, or not at all, of a robot."""

import numpy as np
import pytest
import trimesh
from robots import BOX, MASS, link

from g1_description.errors import DescriptionError
from g1_description.robot.transform import IDENTITY
from g1_description.sim.bullet.create_body import MAX_JOINTS
from g1_description.sim.standing import standing_height

TENSOR = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
HIGH = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0])


def row_of_boxes(count):
    """Write a link with boxes of 1 m, 2 m apart from each other."""
    boxes = [
        BOX.replace("<geometry>", f'<origin xyz="{2 * n} 0 0"/><geometry>')
        for n in range(count)
    ]
    return link("row", MASS + "".join(boxes))


def chain(count, kept):
    """Write links on top of each other; joints turn, or are fixed and Gazebo's."""
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


@pytest.mark.parametrize(("physics", "count"), [("kinematic", 17), ("limp", 40)])
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
        assert world.engine.contacts() == {("c::cube", "r::row")}
        world.delete("c")
    world.step()
    falls = world.is_dynamic * 10.0 * 1e-6  # [m], by Euler's semi-implicit step
    np.testing.assert_allclose(world.model("r").poses[:, 2], [5.0 - falls, 7.0 - falls])


def inertia_of_urdf(**moments):
    """Write three boxes on hinges: a, c and d, which is lumped into b, are wrong."""
    wrong, right = (
        '<inertial><mass value="1"/><inertia '
        + " ".join(f'{name}="{values.get(name, 0)}"' for name in TENSOR)
        + "/></inertial>"
        for values in (moments, {"ixx": 1, "iyy": 1, "izz": 1})
    )
    part = '<collision><geometry><box size="0.2 0.3 0.1"/></geometry></collision>'
    return (
        f'<robot name="r">{link("a", wrong + part)}{link("b", right + part)}'
        f"{link('c', wrong + part)}{link('d', wrong)}"
        '<joint name="ab" type="continuous"><parent link="a"/><child link="b"/>'
        '<origin xyz="0 0 -0.2"/><axis xyz="0 1 0"/></joint>'
        '<joint name="bc" type="continuous"><parent link="b"/><child link="c"/>'
        '<origin xyz="0 0 -0.2"/><axis xyz="0 1 0"/></joint>'
        '<joint name="bd" type="fixed"><parent link="b"/><child link="d"/></joint>'
        "</robot>"
    )


def spawn(world, text):
    """Spawn a robot askew and above the floor; return what is told."""
    askew = np.array([0.0, 0.0, 1.0, np.sin(0.3), 0.0, 0.0, np.cos(0.3)])
    return world.spawn_urdf("r", text, askew)


@pytest.mark.parametrize(
    "moments",
    [{"ixx": 0.01, "iyy": 0.01, "izz": 0.01, "ixy": 0.02}, {}],
    ids=["negative", "zero"],
)
def test_what_has_an_inertia_that_is_not_positive_falls_as_in_gazebo(
    make_world, moments
):
    """PyBullet threw such a model away, or its poses became no numbers."""
    world = make_world("limp")
    assert spawn(world, inertia_of_urdf(**moments)) == (
        "inertia of a, c is not positive definite; 1 kg m^2 about each axis is used, "
        "as in Gazebo",
    )
    body = world.body("r")
    for number, name in ((-1, "a"), (1, "c")):
        assert body.link_names[number] == name
        found = world.client.getDynamicsInfo(body.number, number)[2]
        np.testing.assert_allclose(found, 1.0)
    inertia = world.model("r").links["a"].inertial.inertia
    assert inertia[0, 0] == moments.get("ixx", 0)  # what the file says is told
    for _ in range(2):
        world.run(0.5)
        assert np.abs(world.model("r").poses[:, :3]).max() < 1.5
        assert np.abs(world.model("r").twists).max() < 20.0


def test_a_moment_greater_than_the_others_together_is_named_and_kept(make_world):
    """As in Gazebo."""
    world = make_world("limp")
    assert spawn(world, inertia_of_urdf(ixx=1, iyy=1, izz=2.5)) == (
        "inertia of a, c violates the triangle inequality; it is used unchanged",
    )
    found = world.client.getDynamicsInfo(world.body("r").number, -1)[2]
    np.testing.assert_allclose(sorted(found), [1.0, 1.0, 2.5], rtol=1e-6)


def test_an_impossible_inertia_is_named_only_where_physics_uses_it(make_world):
    assert spawn(make_world(), inertia_of_urdf()) == ()
    flat = "<inertial><mass>1</mass><inertia><izz>0</izz></inertia></inertial>"
    assert make_world("limp").spawn_sdf("m", sdf(flat), HIGH) == ()
    assert make_world("limp").spawn_sdf("m", sdf(flat, static=False), HIGH) != ()


def test_in_kinematic_a_robot_may_have_more_links_than_pybullet(make_world):
    world = make_world(engine="bullet")
    text = chain(MAX_JOINTS + 2, kept=False)
    (message,) = world.spawn_urdf("tower", text, HIGH)
    assert message.startswith("its contacts are not computed: Robot 'tower' must have")
    world.put("tower", np.array(IDENTITY), np.zeros(6))
    world.step()
    model = world.model("tower")
    assert len(model.link_names) == MAX_JOINTS + 2
    np.testing.assert_allclose(model.poses[:, 2], 2.0 * np.arange(MAX_JOINTS + 2))
    assert standing_height(model.assembly, IDENTITY[3:]) == 0.501
    world.reset()
    world.delete("tower")


def test_more_links_than_pybullet_has_room_for_are_refused(make_world):
    world = make_world("hold", engine="bullet")
    assert world.spawn_urdf("fits", chain(MAX_JOINTS + 1, True), HIGH) == ()
    words = "'tower' must have at most 128 links in hold and limp .got 129"
    with pytest.raises(DescriptionError, match=words):
        world.spawn_urdf("tower", chain(MAX_JOINTS + 2, True), HIGH)
    assert "tower" not in world.models
    world.step()


def sdf(text, static=True):
    """Write a model of one link."""
    return (
        f'<sdf version="1.6"><model name="m"><static>{str(static).lower()}</static>'
        f'<link name="l">{text}</link></model></sdf>'
    )


def cube(world):
    """Put a cube where it overlaps one around the origin of what is HIGH."""
    touching = HIGH + 0.9 * np.eye(7)[0]
    world.spawn_urdf(
        "c", f'<robot name="c">{link("cube", MASS + BOX)}</robot>', touching
    )


def test_a_static_mesh_may_have_any_name(make_world, tmp_path):
    """PyBullet's process dies of a name beyond ASCII."""
    file = tmp_path / "\u00e4 b.stl"
    trimesh.creation.box((1.0, 1.0, 1.0)).export(file)
    mesh = f"<geometry><mesh><uri>file://{file}</uri></mesh></geometry>"
    world = make_world()
    world.spawn_sdf("m", sdf(f'<collision name="c">{mesh}</collision>'), HIGH)
    cube(world)
    assert world.engine.contacts() == {("c::cube", "m::l")}


def test_a_mesh_of_many_parts_is_one_shape(make_world, tmp_path):
    """Twenty links, each of a mesh with a hundred parts that are hulls of their own."""
    boxes = []
    for n in range(100):
        box = trimesh.creation.box((1.0, 1.0, 1.0))
        corners = "".join(f"v {x + 2 * n} {y} {z}\n" for x, y, z in box.vertices)
        faces = "".join(
            f"f {a} {b} {c}\n" for a, b, c in box.faces + 1 + n * len(box.vertices)
        )
        boxes.append(f"o part{n}\n{corners}{faces}")
    (tmp_path / "row.obj").write_text("".join(boxes))
    mesh = f'<mesh filename="file://{tmp_path / "row.obj"}"/>'
    row = MASS + f"<collision><geometry>{mesh}</geometry></collision>"
    text = "".join(link(f"l{n}", row) for n in range(20)) + "".join(
        f'<joint name="j{n}" type="continuous"><parent link="l{n - 1}"/>'
        f'<child link="l{n}"/><origin xyz="0 2 0"/></joint>'
        for n in range(1, 20)
    )
    world = make_world("hold", gravity=(0.0, 0.0, 0.0))
    assert world.spawn_urdf("r", f'<robot name="r">{text}</robot>', HIGH) == ()
    small = BOX.replace("1 1 1", "0.5 0.5 0.5")
    boxed = f'<robot name="c">{link("cube", MASS + small)}</robot>'
    for x, touched in ((198.0, {("c::cube", "r::l19")}), (197.0, set())):
        world.spawn_urdf("c", boxed, HIGH + np.array([x, 38.0, 0, 0, 0, 0, 0]))
        assert world.engine.contacts() == touched
        world.delete("c")
