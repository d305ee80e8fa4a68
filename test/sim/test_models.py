"""Models of any kind: anchored, static, from SDF, found by name as Gazebo does."""

import numpy as np
import pytest
from gazebo_msgs.srv import SpawnModelRequest
from oracle import assert_poses_close
from scipy.spatial.transform import Rotation

from g1_description.errors import DescriptionError, UnknownNameError
from g1_description.gazebo.services.models import (
    parse_sdf_request,
    parse_urdf_request,
)
from g1_description.robot.transform import compose, inverse
from g1_description.sdf.world import read_sdf

MASS = (
    '<inertial><origin xyz="{}"/><mass value="1"/><inertia ixx="0.02" iyy="0.03" '
    'izz="0.04" ixy="0.001" ixz="0" iyz="0"/></inertial>'
)
HERE = np.array([1.0, -2.0, 3.0, *Rotation.from_rotvec([0.4, -0.5, 0.6]).as_quat()])
UP = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
GANTRY = f"""<robot name="gantry"><link name="world"/>
<link name="post">{MASS.format("0 0 0.1")}</link>
<link name="cart">{MASS.format("0.1 0 0")}</link>
<link name="hook">{MASS.format("0 0 -0.2")}</link>
<joint name="weld" type="fixed"><parent link="world"/><child link="post"/>
<origin xyz="0 2 0"/></joint>
<joint name="rail" type="prismatic"><parent link="world"/><child link="cart"/>
<origin xyz="0 0 2" rpy="0 0 0.5"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="100" velocity="5"/></joint>
<joint name="rope" type="continuous"><parent link="cart"/><child link="hook"/>
<axis xyz="0 1 0"/></joint></robot>"""
OFFSET = """<sdf version="1.6"><model name="crank"><pose>0 0 0.5 0 0 0.3</pose>
<link name="base"><pose>0.1 0 0 0 0 0</pose><inertial>
<pose>0 0.2 0.1 0 0 0</pose><mass>3</mass></inertial></link>
<link name="arm"><pose>0.5 0.2 0 0.1 0 0.7</pose>
<inertial><pose>0.1 0.2 0.3 0 0 0</pose><mass>2</mass></inertial>
<collision name="tip"><pose>0.3 0 0 0 0 0</pose>
<geometry><sphere><radius>0.1</radius></sphere></geometry></collision></link>
<link name="rod"><pose>0.9 0.2 0.1 0 0.4 0.7</pose></link>
<joint name="turn" type="revolute"><parent>base</parent><child>arm</child>
<pose>-0.3 0.05 0.02 0 0.2 0</pose><axis><xyz>0 0.6 0.8</xyz></axis></joint>
<joint name="slide" type="prismatic"><parent>arm</parent><child>rod</child>
<pose>0.1 0 0 0 0 0</pose><axis><xyz>1 0 0</xyz><limit><lower>-1</lower>
<upper>1</upper></limit></axis></joint></model></sdf>"""
SHELF = """<sdf version="1.6"><model name="shelf"><static>true</static>
<link name="left"><pose>0 0.5 0.5 0 0 0</pose><collision name="c"><geometry>
<box><size>0.1 0.1 1</size></box></geometry></collision></link>
<link name="right"><pose>0 -0.5 0.5 0 0 0</pose></link>
<link name="board"><pose>0 0 1 0 0 0</pose><collision name="c"><geometry>
<box><size>0.4 1.2 0.02</size></box></geometry></collision></link></model></sdf>"""
CUBE = """<robot name="cube"><link name="body"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link></robot>"""


def thing(shape):
    return f"""<sdf version="1.6"><model name="thing"><link name="body">
    <collision name="c"><geometry>{shape}</geometry></collision></link></model></sdf>"""


def pybullet_centers(world, name):
    """Give each link's center of mass in the world, as PyBullet has it."""
    client, body = world.client, world.body(name)
    centers = {body.link_names[-1]: client.getBasePositionAndOrientation(body.number)}
    for index in range(client.getNumJoints(body.number)):
        centers[body.link_names[index]] = client.getLinkState(body.number, index, 0, 1)
    return {link: np.array(state[0]) for link, state in centers.items()}


def pybullet_velocities(world, name):
    """Give the velocity of each link's center of mass but the root's."""
    client, body = world.client, world.body(name)
    states = {
        body.link_names[index]: client.getLinkState(body.number, index, 1, 1)
        for index in range(client.getNumJoints(body.number))
    }
    return {link: np.concatenate(state[6:8]) for link, state in states.items()}


def our_velocities(world, name):
    model = world.model(name)
    twists = model.twists.copy()
    twists[:, :3] += np.cross(twists[:, 3:], model._levers())
    return dict(zip(model.link_names, twists))


def our_centers(world, name):
    model = world.model(name)
    return dict(zip(model.link_names, model.poses[:, :3] + model._levers()))


@pytest.mark.parametrize("name", ["gantry", "crank"])
def test_links_are_where_pybullet_has_them_while_they_move(make_world, name):
    """Anchored to the world, or joints beside their links' origins."""
    world, random = make_world("limp"), np.random.default_rng(5)
    if name == "gantry":
        world.spawn_urdf("gantry", GANTRY, HERE)
    else:
        world.spawn_sdf("crank", OFFSET, HERE)
    model = world.model(name)
    for _ in range(6):
        wanted = random.uniform(-1.0, 1.0, len(model.joint_names))
        world.set_joint_positions(name, dict(zip(model.joint_names, wanted)))
        np.testing.assert_array_equal(model.position, wanted)
        world.put(name, HERE, np.array([0, 0, 0, 1.0, 2.0, -3.0]))
        for _ in range(2):
            theirs = pybullet_centers(world, name)
            for link, center in our_centers(world, name).items():
                np.testing.assert_allclose(center, theirs[link], atol=2e-6)
            world.run(0.01)
        ours = our_velocities(world, name)
        for link, velocity in pybullet_velocities(world, name).items():
            np.testing.assert_allclose(velocity, ours[link], atol=1e-5)
    assert np.abs(model.velocity).min() > 1e-3


def test_what_hangs_on_the_world_does_not_fall(make_world):
    world = make_world("limp")
    world.spawn_urdf("gantry", GANTRY, HERE)
    model = world.model("gantry")
    assert model.link_names == ("post", "cart", "hook")
    assert model.joint_names == ("rail", "rope")
    assert world.entities.joint("weld").joint.kind == "fixed"
    before = model.poses.copy()
    world.run(0.3)
    np.testing.assert_array_equal(model.poses[0], before[0])
    np.testing.assert_array_equal(model.pose, HERE)
    assert np.abs(model.poses[1] - before[1]).max() > 1e-3
    assert model.joint_row("weld") is None


def test_a_static_model_of_loose_links_stays_and_bears_others(make_world):
    world = make_world("limp")
    world.spawn_sdf("shelf", SHELF, np.array([0, 0, 0.0, 0, 0, 0, 1]))
    world.spawn_urdf("cube", CUBE, np.array([0, 0, 1.5, 0, 0, 0, 1]))
    shelf = world.model("shelf")
    assert shelf.link_names == ("left", "right", "board")
    before = shelf.poses.copy()
    np.testing.assert_allclose(
        before[:, :3], [[0, 0.5, 0.5], [0, -0.5, 0.5], [0, 0, 1]]
    )
    world.run(1.0)
    assert world.model("cube").pose[2] == pytest.approx(1.11, abs=0.002)
    np.testing.assert_array_equal(shelf.poses, before)
    world.set_model_state(shelf, HERE, np.ones(6), world.entities.frame("world"))
    assert not shelf.twists.any()
    world.step()
    assert_poses_close(shelf.pose, HERE, 1e-12)


def test_the_first_thing_of_a_name_is_found_and_may_be_of_the_wrong_kind(make_world):
    world = make_world()
    world.spawn_sdf("crank", OFFSET, HERE)
    world.spawn_urdf("arm", CUBE.replace("body", "rod"), UP)
    entities = world.entities
    assert entities.link("rod").scoped == "crank::rod"
    assert entities.link("arm").scoped == "crank::arm"
    assert entities.link("arm::rod").model is world.model("arm")
    assert entities.frame("arm").kind == "link"
    assert entities.frame("tip").kind == "collision"
    expected = world.model("crank").poses[1][:3] + Rotation.from_quat(
        world.model("crank").poses[1][3:]
    ).apply([0.3, 0, 0])
    np.testing.assert_allclose(entities.frame("tip").pose[:3], expected, atol=1e-12)
    assert entities.frame("sun").pose[2] == 10.0
    for name in ("turn", "tip", "crank", ""):
        with pytest.raises(UnknownNameError):
            entities.link(name)
    for name in ("default", "/world", "turn", "crank/arm"):
        with pytest.raises(UnknownNameError):
            entities.frame(name)
    world.delete("crank")
    assert world.entities.link("rod").scoped == "arm::rod"
    assert world.entities.frame("arm").kind == "model"


def test_shapes_are_where_their_links_are_though_their_joint_is_beside(make_world):
    """A small ball that touches only what is at the tip of the arm."""
    world = make_world("kinematic")
    world.spawn_sdf("crank", OFFSET, HERE)
    ball = thing("<sphere><radius>0.01</radius></sphere>")
    world.spawn_sdf("ball", ball, UP)
    for position in (0.0, 1.0, -2.0):
        world.set_joint_positions("crank", {"turn": position})
        tip = world.entities.frame("tip").pose
        for distance, touches in ((0.105, True), (0.115, False)):
            pose = compose(tip, np.array([0, 0, distance, 0, 0, 0, 1]))
            world.put("ball", pose, np.zeros(6))
            assert (("ball::body", "crank::arm") in world.engine.contacts()) is touches


def test_a_root_link_moves_its_model_as_one(make_world):
    world = make_world("limp", gravity=(0.0, 0.0, 0.0))
    world.spawn_sdf("crank", OFFSET, UP)
    model = world.model("crank")
    world.set_joint_positions("crank", {"turn": 0.5})
    twist = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    world.set_root_state(model, HERE, twist)
    assert_poses_close(model.poses[0], HERE, 1e-12)
    lever = Rotation.from_quat(HERE[3:]).apply([0, 0.2, 0.1])
    at_center = model.twists[0, :3] + np.cross(twist[3:], lever)
    np.testing.assert_allclose(at_center, twist[:3], atol=1e-12)
    np.testing.assert_allclose(model.twists[:, 3:], np.tile(twist[3:], (3, 1)))
    assert model.position[0] == 0.5
    before, speed = model.poses[0].copy(), model.twists[0, :3].copy()
    world.run(0.001)
    np.testing.assert_allclose(model.poses[0, :3] - before[:3], 1e-3 * speed, atol=1e-5)


def test_the_pose_of_a_model_is_that_of_its_first_link(make_world):
    """The arm comes first in the file, and hangs on the base."""
    base = OFFSET.index('<link name="base">')
    arm, end = OFFSET.index('<link name="arm">'), OFFSET.index('<link name="rod">')
    text = OFFSET[:base] + OFFSET[arm:end] + OFFSET[base:arm] + OFFSET[end:]
    world = make_world("limp", gravity=(0.0, 0.0, 0.0))
    world.spawn_sdf("crank", text, HERE)
    model = world.model("crank")
    assert model.link_names == ("arm", "base", "rod")
    assert_poses_close(model.pose, HERE, 1e-12)
    T_arm_model = inverse(compose(inverse(HERE), model.poses[0]))
    world.set_joint_positions("crank", {"turn": 1.0})
    assert_poses_close(model.pose, compose(model.poses[0], T_arm_model), 1e-12)
    assert np.abs(model.pose - HERE).max() > 0.1
    before = compose(inverse(model.pose), model.poses[1])
    twist = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    world.put("crank", UP, twist)
    assert_poses_close(model.pose, UP, 1e-12)
    assert_poses_close(compose(UP, before), model.poses[1], 1e-12)
    np.testing.assert_array_equal(model.twist, model.twists[0])
    world.reset()
    assert_poses_close(model.pose, HERE, 1e-12)


def test_a_world_of_another_file_has_no_ground(make_world):
    text = """<sdf version="1.6"><world name="w"><gravity>0 0 -1</gravity><scene/>
    <light type="point" name="lamp"/><model name="ball"><pose>0 0 5 0 0 0</pose>
    <link name="l"><sensor name="eye" type="camera"/><collision name="c"><geometry>
    <sphere><radius>1</radius></sphere></geometry></collision></link></model></world></sdf>"""
    world = make_world("limp", content=read_sdf(text))
    assert list(world.models) == ["ball"]
    assert list(world.lights) == ["lamp"]
    assert world.left_out == (
        "scene of the world is not simulated",
        "ball: sensor of link l is not simulated",
    )
    world.run(0.5)
    assert world.model("ball").pose[2] == pytest.approx(5.0 - 4.9 * 0.25, abs=5e-3)


def test_links_are_counted_without_those_that_are_fixed(make_world, monkeypatch):
    monkeypatch.setattr("g1_description.sim.world.MAX_LINKS", 3)
    links = "".join(
        f'<link name="l{n}">{MASS.format("0 0 0")}</link>' for n in range(4)
    )
    joints = "".join(
        f'<joint name="j{n}" type="continuous"><parent link="l0"/>'
        f'<child link="l{n}"/></joint>'
        for n in range(1, 4)
    )
    text = f'<robot name="long">{links}{joints}</robot>'
    world = make_world("limp")
    with pytest.raises(DescriptionError, match=r"at most 3 links, .*got 4"):
        world.spawn_urdf("long", text, UP)
    world.spawn_urdf("long", text.replace("continuous", "fixed"), UP)
    assert world.model("long").link_names == ("l0",)


WRONG = '<model name="bad"/>'
DARK = '<light name="dark" type="laser"/>'
GOOD = '<model name="good"><link name="a"/></model>'
BAD_HAS_NO_LINKS = "Model 'bad' has no links."


@pytest.mark.parametrize(
    ("inside", "words"),
    [
        (WRONG, BAD_HAS_NO_LINKS),
        (f'<world name="w"><scene/>{WRONG}</world>', BAD_HAS_NO_LINKS),
        (
            f'<world name="w">{WRONG}{DARK}</world>',
            "Unknown type 'laser' of light dark. Known types: point, directional, "
            "spot. "
            f"{BAD_HAS_NO_LINKS}",
        ),
        (
            '<world name="w"><include><uri>lamp</uri></include></world>',
            "The file has no model and no light (include of lamp is ignored: A model "
            "must be given as model://NAME, file://FOLDER or an absolute path).",
        ),
        (
            f'<world name="w">{GOOD}{GOOD.replace("good", "fine")}{WRONG}</world>',
            "The file must have one model or light (got 2 models and 0 lights) "
            "(model bad is ignored: Model 'bad' has no links).",
        ),
    ],
)
def test_a_request_that_cannot_be_met_has_the_reason_alone(inside, words):
    request = SpawnModelRequest(model_xml=f'<sdf version="1.7">{inside}</sdf>')
    refusal = parse_sdf_request(True, request).content
    assert str(refusal) == f"SpawnModel: Failure - {words}"


@pytest.mark.parametrize("physics", ["kinematic", "hold"])
def test_a_joint_whose_limits_are_in_the_wrong_order_goes_anywhere(make_world, physics):
    world = make_world(physics)
    text = GANTRY.replace('lower="-1" upper="1"', 'lower="1" upper="-1"')
    (told,) = world.spawn_urdf("gantry", text, UP)
    assert told.startswith("joint rail has no limits: ")
    assert not world.set_joint_positions("gantry", {"rail": 3.0}).clamped
    for _ in range(3):
        world.step()
    rail = world.model("gantry").joint_names.index("rail")
    assert world.model("gantry").position[rail] == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize(
    ("parse", "text", "what"),
    [
        (parse_urdf_request, '<robot name="r">{}</robot>', "robot description"),
        (parse_sdf_request, '<robot name="r">{}</robot>', "model"),
        (parse_sdf_request, '<sdf version="1.7">{}</sdf>', "model"),
    ],
)
def test_a_text_to_spawn_may_be_no_larger_than_a_file(parse, text, what):
    """Reading a robot of 28 MB took a minute or more."""
    request = SpawnModelRequest(model_xml=text.format('<link name="a"/>' * 1_000_000))
    assert str(parse(True, request).content) == (
        f"SpawnModel: Failure - The {what} is 16 MB; the limit is 10 MB."
    )
