"""Anchors in the simulated world: where scipy puts the link that should stay."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import assert_poses_close, forward_kinematics
from robots import chains
from scipy.spatial.transform import Rotation
from worlds import OUR_G1, Bench

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.motion.motion import Motion
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.profile import Profile
from g1_description.robot.urdf import parse_urdf

STEP = 1_000_000
UPRIGHT = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])
TILTED = np.concatenate(
    [[1.0, -2.0, 3.0], Rotation.from_rotvec([0.4, -0.5, 0.6]).as_quat()]
)
LEFT, RIGHT = "left_ankle_roll_link", "right_ankle_roll_link"
LEGS = {"hip_pitch": -0.5, "knee": 1.0, "ankle_pitch": -0.5}
"""A squat: the soles stay parallel to the pelvis."""


def poses_of(model, text=OUR_G1):
    """Place the links of a model by scipy, from its root and joints alone."""
    positions = dict(zip(model.joint_names, model.position))
    return forward_kinematics(text, model.root_poses[0], positions)


def lowest_point(pose, link=LEFT):
    """Find the lowest point of a foot, whose shapes are spheres, by scipy."""
    text = OUR_G1[OUR_G1.index(f'<link name="{link}"') :].split("</link>")[0]
    balls = text.split("<collision>")[1:]
    points = [re.search('xyz="(.*?)"', ball).group(1).split() for ball in balls]
    assert len(points) == 4
    below = Rotation.from_quat(pose[3:]).apply(np.array(points, dtype=float))
    return pose[2] + below[:, 2].min() - 0.005


def random_positions(model, random):
    return dict(zip(model.joint_names, random.uniform(model.lower, model.upper)))


def legs(left, right=None):
    """Give positions of both legs, as fractions of a squat."""
    return {
        f"{side}_{joint}_joint": fraction * position
        for side, fraction in (
            ("left", left),
            ("right", left if right is None else right),
        )
        for joint, position in LEGS.items()
    }


def motion(times, *configurations, base_poses=None):
    rows = [[*configuration.values()] for configuration in configurations]
    names = tuple(configurations[0])
    return Motion(np.array(times), names, np.array(rows), None, base_poses)


@pytest.fixture
def world(make_world):
    world = make_world("kinematic")
    world.spawn_urdf("g1", OUR_G1, UPRIGHT)
    return world


@pytest.fixture
def model(world):
    return world.model("g1")


def steps(world, n):
    for _ in range(n):
        world.step()


@settings(max_examples=12)
@given(chains(), st.data())
def test_any_link_of_any_robot_stays_where_it_is(robot, data):
    """On fixed joints, too; and joints are where they were commanded."""
    text, positions = robot
    world = Bench()
    try:
        world.spawn_urdf("r", text, TILTED)
        model = world.model("r")
        world.set_joint_positions("r", positions)
        before = poses_of(model, text)
        link = data.draw(st.sampled_from(sorted(before)))
        world.anchors.set(model, link)
        for fraction in data.draw(
            st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4)
        ):
            commanded = {
                name: float(np.clip(fraction * position, lower, upper))
                for (name, position), lower, upper in zip(
                    sorted(positions.items()),
                    model.lower[model.joint_rows(sorted(positions))],
                    model.upper[model.joint_rows(sorted(positions))],
                )
            }
            world.set_joint_positions("r", commanded)
            shown = dict(zip(model.joint_names, model.position))
            assert shown == commanded
            now = poses_of(model, text)
            assert_poses_close(now[link], before[link], 1e-9)
            placed = np.array([now[name] for name in model.link_names])
            assert_poses_close(model.poses, placed, 1e-9)
            assert not model.twists.any()
    finally:
        world.close()


def test_it_stays_to_rounding_and_does_not_drift(world, model):
    """The base has no memory: the same joints give the same base, to the last bit."""
    random = np.random.RandomState(2)
    world.put("g1", TILTED, np.zeros(6))
    world.anchors.set(model, LEFT)
    row = model.link_names.index(LEFT)
    target, first = model.poses[row].copy(), random_positions(model, random)
    world.set_joint_positions("g1", first)
    root = model.root_poses[0].copy()
    for _ in range(200):
        world.set_joint_positions("g1", random_positions(model, random))
        assert np.abs(model.poses[row] - target).max() < 1e-14
    world.set_joint_positions("g1", first)
    assert (model.root_poses[0] == root).all()


def test_a_hand_on_a_fixed_joint_stays_on_its_wall(world, model):
    before = poses_of(model)["left_rubber_hand"]
    assert "left_rubber_hand" not in model.link_names
    world.anchors.set(model, "g1::left_rubber_hand")
    random = np.random.RandomState(3)
    world.set_joint_positions("g1", random_positions(model, random))
    assert_poses_close(poses_of(model)["left_rubber_hand"], before, 1e-9)


def test_a_motion_of_joints_moves_the_base_with_the_right_twist(world, model):
    random = np.random.RandomState(4)
    rows = [random_positions(model, random) for _ in range(3)]
    world.anchors.set(model, RIGHT)
    before = poses_of(model)[RIGHT]
    world.motions.play(model, motion([0.0, 1.0, 2.0], *rows), 0)
    steps(world, 400)
    place, twist = model.root_poses[0].copy(), model.root_twists[0].copy()
    twists = dict(zip(model.link_names, model.twists.copy()))
    assert np.abs(twists[RIGHT]).max() < 1e-12
    np.testing.assert_allclose(twists["pelvis"], twist, atol=1e-12)
    assert np.abs(twist).max() > 0.1
    world.step()
    assert_poses_close(poses_of(model)[RIGHT], before, 1e-9)
    np.testing.assert_allclose(
        (model.root_poses[0, :3] - place[:3]) / 1e-3, twist[:3], atol=0.01
    )
    turned = Rotation.from_quat(model.root_poses[0, 3:]) * (
        Rotation.from_quat(place[3:]).inv()
    )
    np.testing.assert_allclose(turned.as_rotvec() / 1e-3, twist[3:], atol=0.01)
    steps(world, 1700)
    assert_poses_close(poses_of(model)[RIGHT], before, 1e-9)
    assert not model.twists.any()


@pytest.mark.parametrize("end", ["command", "none"])
def test_no_twist_is_left_when_the_joints_stop(world, model, end):
    world.anchors.set(model, LEFT)
    world.motions.play(model, motion([0.0, 1.0], legs(0.0), legs(1.0)), 0)
    steps(world, 500)
    assert model.root_twists.any()
    if end == "command":
        world.set_joint_positions("g1", legs(0.2))
    elif end == "stop":
        world.motions.stop(model)
    else:
        world.motions.stop(model)
        world.motions.play(model, motion([0.0, 1.0], legs(0.0), legs(1.0)), STEP)
        world.step()
        world.anchors.set(model, "")
    assert not model.root_twists.any()


def test_legs_that_move_by_two_motions_are_one_change(world, model):
    """Between the two, one foot would be below the other one."""
    world.anchors.set(model, "lowest_foot")
    before = poses_of(model)
    for side in ("left", "right"):
        rows = [
            {n: p for n, p in legs(fraction).items() if n.startswith(side)}
            for fraction in (0.0, 1.0)
        ]
        world.motions.play(model, motion([0.0, 0.1], *rows), 0)
    steps(world, 150)
    assert model.position[model.joint_row("right_knee_joint")] == LEGS["knee"]
    for foot in (LEFT, RIGHT):
        assert_poses_close(poses_of(model)[foot], before[foot], 1e-9)


def test_a_path_of_the_base_counts_and_the_link_is_held_where_it_ends(world, model):
    world.anchors.set(model, LEFT)
    bases = np.array([UPRIGHT, TILTED])
    path = motion([0.0, 0.1], legs(0.0), legs(0.4), base_poses=bases)
    world.motions.play(model, path, 0)
    steps(world, 50)
    np.testing.assert_allclose(
        model.root_poses[0, :3], (UPRIGHT + TILTED)[:3] / 2, atol=1e-12
    )
    now = model.root_poses[0].copy()
    world.set_joint_positions("g1", {"left_knee_joint": 0.1})
    assert (model.root_poses[0] == now).all()
    steps(world, 100)
    assert_poses_close(model.root_poses[0], TILTED, 1e-12)
    after = poses_of(model)[LEFT]
    world.set_joint_positions("g1", legs(1.0))
    assert_poses_close(poses_of(model)[LEFT], after, 1e-9)


def move_model(world, model):
    world.put("g1", TILTED, np.zeros(6))


def move_root(world, model):
    world.set_link_state(world.entities.link("g1::pelvis"), TILTED, np.zeros(6))


def move_knee(world, model):
    entity = world.entities.link("g1::left_knee_link")
    pose = entity.pose.copy()
    pose[3:] = (
        Rotation.from_quat(pose[3:]) * Rotation.from_rotvec([0.0, 0.5, 0.0])
    ).as_quat()
    world.set_link_state(entity, pose, np.zeros(6))
    assert model.position[model.joint_row("left_knee_joint")] > 0.4


def reset_models(world, model):
    world.put("g1", TILTED, np.zeros(6))
    world.reset_models()


def reset(world, model):
    world.put("g1", TILTED, np.zeros(6))
    world.set_joint_positions("g1", legs(1.0))
    world.reset()


@pytest.mark.parametrize(
    "move", [move_model, move_root, move_knee, reset_models, reset]
)
def test_whatever_else_moves_the_robot_the_link_is_held_at_its_new_place(
    world, model, move
):
    other = Bench()
    other.spawn_urdf("g1", OUR_G1, UPRIGHT)
    move(other, other.model("g1"))
    world.anchors.set(model, LEFT)
    move(world, model)
    # As without an anchor: only joints move the base.
    assert (model.root_poses == other.model("g1").root_poses).all()
    other.close()
    before = poses_of(model)[LEFT]
    world.set_joint_positions("g1", legs(0.7))
    assert_poses_close(poses_of(model)[LEFT], before, 1e-9)


def test_both_feet_stay_in_a_squat_on_the_lowest_one(world, model):
    turned = np.array([0.3, 0.7, 0.793, 0.0, 0.0, np.sin(0.35), np.cos(0.35)])
    world.put("g1", turned, np.zeros(6))
    world.anchors.set(model, "lowest_foot")
    before = poses_of(model)
    world.set_joint_positions("g1", legs(0.3))
    root = model.root_poses[0].copy()
    for fraction in np.linspace(0.0, 1.0, 10):
        world.set_joint_positions("g1", legs(fraction))
        for foot in (LEFT, RIGHT):
            assert_poses_close(poses_of(model)[foot], before[foot], 1e-9)
    assert model.root_poses[0, 2] < UPRIGHT[2] - 0.05
    world.set_joint_positions("g1", legs(0.3))
    assert (model.root_poses[0] == root).all(), "the anchor has changed meanwhile"


def test_a_walk_of_joints_goes_on_foot_by_foot_on_the_floor(world, model):
    """A leg swings while it is short, and pushes while it is long."""
    phase = np.linspace(0.0, 2 * np.pi, 40, endpoint=False)

    def walk(angle):
        found = {}
        for side, shift in (("left", 0.0), ("right", np.pi)):
            swing, lift = 0.25 * np.sin(angle + shift), max(0.0, np.cos(angle + shift))
            found[f"{side}_hip_pitch_joint"] = -swing - 0.4 * lift
            found[f"{side}_knee_joint"] = 0.8 * lift
            found[f"{side}_ankle_pitch_joint"] = swing - 0.4 * lift
        return found

    world.set_joint_positions("g1", walk(0.0))
    world.anchors.set(model, "lowest_foot")
    heights = {
        foot: lowest_point(poses_of(model)[foot], foot) for foot in (LEFT, RIGHT)
    }
    floor = min(heights.values())
    stance = min(heights, key=heights.get)
    assert stance == RIGHT
    changes, places = 0, [model.root_poses[0, 0]]
    before = poses_of(model)[stance]
    for angle in np.tile(phase, 2):
        world.set_joint_positions("g1", walk(angle))
        now = poses_of(model)
        heights = {foot: lowest_point(now[foot], foot) for foot in (LEFT, RIGHT)}
        assert min(heights.values()) == pytest.approx(floor, abs=2e-6)
        if np.abs(now[stance][:3] - before[:3]).max() > 1e-9:
            changes += 1
            stance = LEFT if stance == RIGHT else RIGHT
            before = now[stance]
        assert_poses_close(now[stance], before, 1e-9)
        assert heights[stance] == pytest.approx(floor, abs=1e-9)
        places.append(model.root_poses[0, 0])
    assert changes >= 4
    assert (np.diff(places) >= -1e-15).all()  # but for rounding
    assert places[-1] > 1.0


def test_a_foot_on_its_toes_is_held_by_its_toes(world, model):
    """Its ankle is the higher one of the two."""
    toes = {"right_hip_pitch_joint": -0.1, "right_ankle_pitch_joint": 0.6}
    world.set_joint_positions("g1", toes)
    now = poses_of(model)
    assert now[RIGHT][2] > now[LEFT][2]
    assert lowest_point(now[RIGHT], RIGHT) < lowest_point(now[LEFT], LEFT)
    world.anchors.set(model, "lowest_foot")
    world.set_joint_positions("g1", {"right_hip_pitch_joint": -0.05})
    assert_poses_close(poses_of(model)[RIGHT], now[RIGHT], 1e-9)


@pytest.mark.parametrize(
    ("name", "error", "text"),
    [
        (
            "left_ankle",
            UnknownNameError,
            "no link 'left_ankle'; known anchors: left_ank",
        ),
        ("lowest", UnknownNameError, "no link 'lowest'; known anchors: lowest_foot, "),
        ("pelvis::x", UnknownNameError, "no link 'pelvis::x'"),
    ],
)
def test_what_is_no_link_is_refused_and_the_anchor_stays(
    world, model, name, error, text
):
    world.anchors.set(model, LEFT)
    with pytest.raises(error, match=text):
        world.anchors.set(model, name)
    assert world.anchors.name(model) == LEFT


def test_feet_that_nobody_knows_and_bases_that_cannot_move_are_refused(world):
    links = '<link name="a"/><link name="b"/>'
    joint = (
        '<joint name="j" type="continuous"><parent link="{}"/><child link="b"/></joint>'
    )
    world.spawn_urdf(
        "r", f'<robot name="r">{links}{joint.format("a")}</robot>', UPRIGHT
    )
    with pytest.raises(UnknownNameError, match="profile of r has no feet"):
        world.anchors.set(world.model("r"), "lowest_foot")
    links = '<link name="world"/><link name="b"/>'
    fixed = f'<robot name="f">{links}{joint.format("world")}</robot>'
    world.spawn_urdf("f", fixed, UPRIGHT)
    with pytest.raises(InvalidValueError, match="fixed to the world"):
        world.anchors.set(world.model("f"), "b")


def test_a_foot_on_a_fixed_joint_is_a_foot(world):
    links = "".join(f'<link name="{name}"/>' for name in ("a", "shin", "foot"))
    joints = (
        '<joint name="j" type="continuous"><parent link="a"/><child link="shin"/>'
        '</joint><joint name="f" type="fixed"><parent link="shin"/><child link="foot"/>'
        '<origin xyz="0 1 -1"/></joint>'
    )
    text = f'<robot name="r">{links}{joints}</robot>'
    profile = Profile(links={"right_foot": "foot", "left_foot": "nowhere"})
    robot = replace(parse_urdf(text), given_profile=profile)
    world.spawn("r", lump_fixed_joints(robot, is_dynamic=False), TILTED)
    model = world.model("r")
    before = poses_of(model, text)["foot"]
    world.anchors.set(model, "lowest_foot")
    world.set_joint_positions("r", {"j": 1.0})
    assert_poses_close(poses_of(model, text)["foot"], before, 1e-9)
    assert np.abs(model.root_poses[0] - TILTED).max() > 0.1


def test_a_link_of_a_free_part_holds_that_part(world):
    links = "".join(f'<link name="{name}"/>' for name in "abc")
    joints = (
        '<joint name="f" type="floating"><parent link="a"/><child link="b"/></joint>'
        '<joint name="j" type="continuous"><parent link="b"/><child link="c"/>'
        '<origin xyz="0 1 0"/></joint>'
    )
    world.spawn_urdf("r", f'<robot name="r">{links}{joints}</robot>', TILTED)
    model = world.model("r")
    world.anchors.set(model, "c")
    before = dict(zip(model.link_names, model.poses.copy()))
    world.set_joint_positions("r", {"j": 1.0})
    after = dict(zip(model.link_names, model.poses))
    assert_poses_close(after["c"], before["c"], 1e-12)
    assert (after["a"] == before["a"]).all()
    assert np.abs(after["b"] - before["b"]).max() > 0.1


def test_where_physics_moves_the_base_it_is_refused(make_world):
    physics = "hold"
    world = make_world(physics)
    world.spawn_urdf("g1", OUR_G1, UPRIGHT)
    model = world.model("g1")
    with pytest.raises(InvalidValueError, match=f"in {physics} physics moves the base"):
        world.anchors.set(model, LEFT)
    world.anchors.set(model, "")
    assert world.anchors.name(model) == ""
