"""Configurations that inverse kinematics finds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import BASE, SLIDER, chains
from scipy.spatial.transform import Rotation

from g1_description import Robot
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.motion.motion import Motion
from g1_description.sim.standing import lowest_height

FEET = ("left_ankle_roll_link", "right_ankle_roll_link")
HANDS = ("left_rubber_hand", "right_rubber_hand")

ARM = """
<robot name="arm">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="tip"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="lower"/><axis xyz="0 0 1"/>
    <origin xyz="1 0 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="wrist" type="fixed">
    <parent link="lower"/><child link="tip"/><origin xyz="0.5 0 0"/>
  </joint>
</robot>
"""


def errors(robot, result, targets):
    """Measure by forward kinematics how far links are from their targets."""
    poses = robot.link_poses(result.positions, result.base)
    found = []
    for link, target in targets.items():
        distance = np.linalg.norm(poses[link][:3] - target[:3])
        turn = 0.0
        if len(target) == 7:
            turns = Rotation.from_quat([poses[link][3:], target[3:]])
            turn = np.linalg.norm((turns[0].inv() * turns[1]).as_rotvec())
        found.append((distance, turn))
    return np.array(found)


def is_within_limits(robot, positions):
    return bool(((robot.lower <= positions) & (positions <= robot.upper)).all())


def reachable(robot, seed):
    """Draw poses of both hands that the robot reaches on its feet from ``stand``."""
    random = np.random.default_rng(seed)
    start = robot.named_configuration("stand")
    feet = {link: robot.link_poses(start, BASE)[link] for link in FEET}
    while True:
        posture = robot.random_configuration(random)
        posture[:12] = start[:12]
        base = BASE.copy()
        base[:3] += random.uniform([-0.1, -0.1, -0.3], [0.1, 0.1, 0.0])
        base[3:] = Rotation.from_rotvec(random.uniform(-0.3, 0.3, 3)).as_quat()
        found = robot.ik({"pelvis": base}, posture, BASE, fixed_links=FEET)
        if (errors(robot, found, feet) < 1e-4).all():
            poses = robot.link_poses(found.positions, found.base)
            return {hand: poses[hand] for hand in HANDS}


@pytest.mark.parametrize("seed", range(4))
def test_hands_reach_what_can_be_reached_while_the_feet_stay(g1, seed):
    start, targets = g1.named_configuration("stand"), reachable(g1, seed)
    feet = {link: g1.link_poses(start, BASE)[link] for link in FEET}
    result = g1.ik(targets, start, BASE)
    assert result.reached
    assert result.message == ""
    assert is_within_limits(g1, result.positions)
    found = errors(g1, result, {**targets, **feet})
    assert (found < [1e-3, np.radians(0.5)]).all()
    assert (found[2:] < [1e-4, 1e-3]).all()
    told = [result.errors[name] for name in (*HANDS, "left_foot", "right_foot")]
    np.testing.assert_allclose(told, found, rtol=0, atol=1e-7)


@pytest.mark.parametrize("target", [[0.45, 0.25, 0.4], [3.0, 0.0, 0.0]])
def test_a_balanced_robot_stands_and_does_not_touch_itself(g1, target):
    start = g1.named_configuration("stand")
    result = g1.ik(
        {"left_hand": target}, start, BASE, balance=True, avoid_collisions=True
    )
    assert result.reached == (target[0] < 1.0)
    only = ("position", "center_of_mass", "self_collision")
    verdict = g1.check_state(result.positions, result.base, only)
    assert set(verdict.checked) == set(only)
    assert verdict.findings == ()


def test_balance_makes_a_difference(g1):
    target = {"left_hand": [0.75, 0.2, 0.8]}
    start, only = g1.named_configuration("stand"), ("center_of_mass",)
    free = g1.ik(target, start, BASE)
    kept = g1.ik(target, start, BASE, balance=True)
    assert free.reached
    assert not g1.check_state(free.positions, free.base, only).passed
    assert g1.check_state(kept.positions, kept.base, only).passed


def test_collisions_make_a_difference(g1):
    target = {"left_hand": [0.0, 0.0, 0.8]}
    start = g1.named_configuration("stand")
    through = g1.ik(target, start, BASE)
    around = g1.ik(target, start, BASE, avoid_collisions=True)
    assert len(g1.self_collisions(through.positions, through.base).pair)
    assert not len(g1.self_collisions(around.positions, around.base).pair)


def test_an_unreachable_target_leaves_the_feet_and_is_reported(g1):
    start = g1.named_configuration("stand")
    feet = {link: g1.link_poses(start, BASE)[link] for link in FEET}
    result = g1.ik({"left_hand": [2.0, 0.3, 0.9]}, start, BASE)
    assert not result.reached
    assert (errors(g1, result, feet) < [1e-3, np.radians(0.5)]).all()
    millimetres = 1e3 * result.errors["left_hand"].position
    assert result.errors["left_hand"].rotation is None
    assert result.message == (
        f"Not reached: left_hand is {millimetres:.0f} mm from its target."
    )


def test_straight_knees_bend(g1):
    """There the pelvis cannot begin to sink: its Jacobian is singular."""
    base = np.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0])
    lower = base - [0.0, 0.0, 0.15, 0.0, 0.0, 0.0, 0.0]
    result = g1.ik({"pelvis": lower}, None, base)
    assert result.reached
    assert result.positions[g1.joint_row("left_knee_joint")] > 0.8


def test_a_robot_that_is_where_it_should_be_stays(g1):
    start = g1.named_configuration("stand")
    hand = g1.link_poses(start, BASE)["left_rubber_hand"]
    result = g1.ik({"left_hand": hand}, start, BASE)
    assert result.steps == 0
    np.testing.assert_allclose(result.positions, start, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("x", "y"), [(3.0, 0.0), (2.0, 1.0)])
def test_an_arm_stretches_towards_what_is_too_far(x, y):
    result = Robot(ARM).ik({"tip": [x, y, 0.0]}, [0.3, 0.4])
    assert not result.reached
    far = np.hypot(x, y) - 1.5
    assert result.errors["tip"].position == pytest.approx(far, abs=1e-5)
    wanted = [np.arctan2(y, x), 0.0]
    np.testing.assert_allclose(result.positions, wanted, rtol=0, atol=5e-3)


class Wall:
    """Keeps the frame of the last link at an x below that of a wall."""

    def __init__(self, x):
        self.x = x

    def approach(self, jacobians):
        place = jacobians.link_poses[-1, :3]
        row = np.array([len(jacobians.link_poses) - 1])
        rates = jacobians.of_points(row, place[np.newaxis])[:, 0]
        return rates, np.array([self.x - place[0]])

    def excess_message(self, excess):
        return f"the tip is {1e3 * excess:.0f} mm behind the wall"


@pytest.mark.parametrize(
    ("rates", "room"),
    [((2, 8), (3,)), ((1, 7), (1,)), ((1, 8), (1, 1)), (np.nan, (1,))],
)
def test_a_limit_that_returns_something_else_is_refused(rates, room):
    limit = Wall(1.0)
    wrong = np.full((1, 8), np.nan) if rates is np.nan else np.zeros(rates)
    limit.approach = lambda jacobians: (wrong, np.zeros(room))
    with pytest.raises(InvalidValueError, match=r"Wall\.approach must return finite"):
        Robot(ARM).ik({"tip": [1.0, 0.0, 0.0]}, limits=[limit])


def test_a_limit_of_ones_own_is_kept_as_far_as_possible():
    arm, target = Robot(ARM), {"tip": [1.4, 0.3, 0.0]}
    assert arm.ik(target).reached
    kept = arm.ik(target, limits=[Wall(1.2)])
    assert arm.link_poses(kept.positions)["tip"][0] < 1.2005
    assert not kept.reached
    beyond = arm.ik({}, limits=[Wall(-2.0)])
    assert "mm behind the wall" in beyond.message


def test_an_arm_stops_at_its_limits():
    result = Robot(ARM).ik({"tip": [-1.5, 0.0, 0.0]}, [0.1, 0.1])
    assert not result.reached
    assert np.abs(result.positions).max() == pytest.approx(2.0)


@pytest.mark.parametrize("angles", [(0.5, 1.0), (1.9, 1.9)])
def test_an_arm_reaches_where_its_angles_say(angles):
    first, both = angles[0], sum(angles)
    x = np.cos(first) + 0.5 * np.cos(both)
    y = np.sin(first) + 0.5 * np.sin(both)
    result = Robot(ARM).ik({"tip": [x, y, 0.0]}, [0.0, 0.0])
    assert result.reached
    assert result.errors["tip"].position < 1e-4


def test_a_start_outside_the_limits_is_moved_into_them():
    result = Robot(ARM).ik({}, [5.0, 0.0])
    np.testing.assert_array_equal(result.positions, [2.0, 0.0])


@pytest.mark.parametrize(("x", "wanted"), [(0.5, 0.5), (2.0, 1.0), (-7.0, -1.0)])
def test_a_slider_slides(x, wanted):
    result = Robot(SLIDER).ik({"cart": [x, 0.0, 0.0]})
    assert result.positions[0] == pytest.approx(wanted, abs=1e-4)
    assert result.reached == (x == wanted)


@pytest.mark.parametrize(
    ("weights", "wanted"), [(None, 0.5), ({"load": 2.0}, 0.8), ({"cart": np.inf}, 1e-4)]
)
def test_contradictory_targets_are_weighted(weights, wanted):
    """The least sum of weighted squares is at their mean by squared weights."""
    load = '<link name="load"/><joint name="f" type="fixed"><parent link="cart"/>'
    text = SLIDER.replace("</robot>", f'{load}<child link="load"/></joint></robot>')
    targets = {"cart": [0.0, 0.0, 0.0], "load": [1.0, 0.0, 0.0]}
    result = Robot(text).ik(targets, [0.3], weights=weights)
    assert result.positions[0] == pytest.approx(wanted, abs=2e-4)
    assert not result.reached


def test_fixed_links_prevail_over_targets_of_infinite_weight(g1):
    start = g1.named_configuration("stand")
    weights = {"left_hand": np.inf}
    result = g1.ik({"left_hand": [3.0, 0.2, 2.0]}, start, BASE, weights=weights)
    feet = [result.errors[foot].position for foot in ("left_foot", "right_foot")]
    assert max(feet) < 0.03


@pytest.mark.parametrize("motion", ["fixed", "planar"])
def test_the_base_moves_as_far_as_it_may(g1, motion):
    start, target = g1.named_configuration("stand"), [1.2, 0.5, 1.0]
    result = g1.ik(
        {"left_hand": target}, start, BASE, fixed_links=(), base_motion=motion
    )
    assert result.reached == (motion == "planar")
    if motion == "fixed":
        np.testing.assert_allclose(result.base, BASE, rtol=0, atol=1e-15)
    else:
        np.testing.assert_allclose(result.base[2:5], BASE[2:5], rtol=0, atol=1e-9)


def test_a_base_on_the_world_never_moves():
    text = SLIDER.replace('link name="rail"', 'link name="world"').replace(
        'link="rail"', 'link="world"'
    )
    result = Robot(text).ik({"cart": [0.0, 5.0, 0.0]}, base_motion="free")
    assert not result.reached
    assert result.errors["cart"].position == pytest.approx(5.0)


def test_a_foot_with_a_target_is_not_fixed(g1):
    start = g1.named_configuration("stand")
    foot = g1.link_poses(start, BASE)["left_ankle_roll_link"].copy()
    foot[:3] += [0.1, 0.05, 0.1]
    result = g1.ik({"left_foot": foot}, start, BASE)
    assert result.reached
    assert set(result.errors) == {"left_foot", "right_foot"}
    assert errors(g1, result, {"left_ankle_roll_link": foot})[0, 0] < 1e-3


def test_no_link_gets_below_the_floor(g1):
    floor = -0.2
    start, base = g1.named_configuration("stand"), BASE.copy()
    base[2] += floor
    low = {"left_hand": [0.3, 0.35, floor + 0.01]}
    through = g1.ik(low, start, base, balance=True)
    above = g1.ik(low, start, base, balance=True, floor=floor)
    assert through.reached
    assert not above.reached
    heights = []
    for result in (through, above):
        place = result.base.copy()
        place[2] -= floor
        motion = Motion(
            np.zeros(1), g1.joint_names, result.positions[None], base_poses=place[None]
        )
        heights.append(lowest_height(g1.description, motion))
    assert heights[0] < -0.02
    assert heights[1] > -1.1e-3


def test_a_hand_rests_on_the_floor_where_there_is_room(g1):
    start = g1.named_configuration("stand")
    result = g1.ik({"left_hand": [0.3, 0.35, 0.12]}, start, BASE, floor=0.0)
    assert result.reached


def test_a_fingertip_is_brought_to_its_target(g1):
    start, tip = g1.named_configuration("stand"), np.array([0.11, 0.02, -0.03])
    target = np.array([0.3, 0.3, 0.9, 0.0, 0.0, 0.0, 1.0])
    result = g1.ik({"left_hand": target}, start, BASE, points={"left_hand": tip})
    assert result.reached
    hand = g1.link_poses(result.positions, result.base)["left_rubber_hand"]
    turn = Rotation.from_quat(hand[3:])
    np.testing.assert_allclose(hand[:3] + turn.apply(tip), target[:3], atol=1e-3)
    assert np.linalg.norm(turn.as_rotvec()) < np.radians(0.5)


def test_feet_stand_where_their_points_are_put(g1):
    """The same configuration, whether origins of feet are targets or their heels."""
    start, heel = g1.named_configuration("stand"), np.array([-0.05, 0.0, -0.03])
    feet = {foot: g1.link_poses(start, BASE)[foot] for foot in FEET}
    goals = {
        foot: np.concatenate([p[:3] + Rotation.from_quat(p[3:]).apply(heel), p[3:]])
        for foot, p in feet.items()
    }
    hand = {"left_hand": [0.35, 0.3, 0.7]}
    by_origins = g1.ik({**feet, **hand}, start, BASE, balance=True)
    points = dict.fromkeys(FEET, heel)
    by_heels = g1.ik({**goals, **hand}, start, BASE, balance=True, points=points)
    assert by_origins.reached
    assert by_heels.reached
    for foot, pose in feet.items():
        found = g1.link_poses(by_heels.positions, by_heels.base)[foot]
        np.testing.assert_allclose(found, pose, rtol=0, atol=1e-3)


@settings(max_examples=12)
@given(chains(max_joints=6), st.integers(0, 1000))
def test_any_robot_keeps_to_its_limits_and_tells_its_distance(chain, seed):
    text, _ = chain
    robot, random = Robot(text), np.random.default_rng(seed)
    link = robot.link_names[-1]
    target = random.uniform(-5.0, 5.0, 3)
    result = robot.ik({link: target})
    assert is_within_limits(robot, result.positions)
    (distance, _) = errors(robot, result, {link: target})[0]
    assert result.errors[link].position == pytest.approx(distance, abs=1e-9)
    assert result.reached == (distance <= 1e-3)
    np.testing.assert_array_equal(result.base, [0, 0, 0, 0, 0, 0, 1])


@settings(max_examples=12)
@given(chains(max_joints=6), st.integers(0, 1000))
def test_any_robot_reaches_where_one_of_its_configurations_is(chain, seed):
    text, _ = chain
    robot, random = Robot(text), np.random.default_rng(seed)
    lower = np.where(np.isfinite(robot.lower), robot.lower, -3.0)
    upper = np.where(np.isfinite(robot.upper), robot.upper, 3.0)
    link = robot.link_names[-1]
    target = robot.link_poses(random.uniform(lower, upper))[link][:3]
    result = robot.ik({link: target})
    assert result.reached
    assert errors(robot, result, {link: target})[0, 0] < 1e-3


def test_a_path_is_continuous_and_keeps_to_the_speeds(g1):
    start, times = g1.named_configuration("stand"), np.linspace(0.0, 2.0, 41)
    turn = np.pi * times
    circle = np.stack(
        [0.3 + 0.1 * np.cos(turn), 0.25 + 0.1 * np.sin(turn), 1.0 + 0.0 * turn], axis=1
    )
    path = g1.ik_trajectory(times, {"left_hand": circle}, start, BASE, balance=True)
    assert path.reached
    motion = path.motion
    np.testing.assert_array_equal(motion.times, times)
    speeds = np.abs(np.diff(motion.positions, axis=0)) / np.diff(times)[:, np.newaxis]
    assert (speeds <= g1.velocity_limits).all()
    hands = [
        g1.link_poses(q, base)["left_rubber_hand"][:3]
        for q, base in zip(motion.positions, motion.base_poses)
    ]
    np.testing.assert_allclose(hands, circle, rtol=0, atol=1e-3)
    steps = np.abs(np.diff(motion.positions, axis=0)).max()
    assert steps < 0.3


def test_samples_that_are_too_fast_lag_and_catch_up():
    times = np.linspace(0.0, 4.0, 81)
    x = np.where(times < 1.0, 0.0, 0.8)
    targets = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    path = Robot(SLIDER).ik_trajectory(times, {"cart": targets}, smooth=False)
    speeds = np.abs(np.diff(path.motion.positions[:, 0])) / 0.05
    assert speeds.max() == pytest.approx(0.5, rel=2e-3)
    assert not path.reached
    assert [result.reached for result in path.results[:20]] == [True] * 20
    assert path.results[25].errors["cart"].position > 0.5
    assert path.results[-1].reached


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"targets": {"left_hnad": [0, 0, 0]}}, "Unknown link 'left_hnad'.*left_hand"),
        ({"targets": {"left_hand": [0, 0]}}, "target of left_hand must be a position"),
        ({"targets": {"left_hand": [0] * 7}}, "quaternion of left_hand must have len"),
        (
            {"targets": {"left_hand": [300, 0, 1]}},
            "300 m from the robot: targets are in",
        ),
        ({"fixed_links": ["foot"]}, "Unknown link 'foot'"),
        (
            {"fixed_links": [], "balance": True},
            "Balance needs links that stand on the floor",
        ),
        ({"targets": [0.4, 0.2, 0.4]}, "targets must be a dictionary by link"),
        ({"floor": 0.02}, "floor is 48 mm above the lowest point of the fixed links"),
        ({"floor": "low"}, "floor must be the height of the floor in m"),
        (
            {"targets": {"head": [0, 0, 1]}, "points": {"head": [0, 0]}},
            "point of head must be x y z",
        ),
        ({"points": {"head": [0, 0, 0]}}, "There is a point but no target of head"),
        (
            {"targets": {"left_hand": [0, 0, 1], "left_rubber_hand": [0, 0, 1]}},
            "left_hand and left_rubber_hand are the same link",
        ),
        (
            {"targets": {"left_hand": [0, 0, 1]}, "fixed_links": ["left_rubber_hand"]},
            "left_rubber_hand is a fixed link, so it cannot have a target",
        ),
        ({"base_motion": "sideways"}, "must be one of free, planar, fixed .*sideways"),
        ({"start": np.zeros((2, 29))}, "Positions must be a single configuration"),
        ({"limits": [3]}, "limits must be a list of objects"),
        ({"limits": [type("Half", (), {"approach": 0})()]}, "excess_message .*Half"),
        ({"limits": 3}, "limits must be a list of objects"),
        (
            {"balance": 30},
            r"balance must be True, False, 'zmp' or a margin in m.*\(got 30\)",
        ),
        ({"balance": -0.01}, r"or a margin in m, from 0 to 1 \(got -0.01\)"),
        ({"balance": np.nan}, r"or a margin in m, from 0 to 1 \(got nan\)"),
        ({"balance": "no"}, r"or a margin in m, from 0 to 1 \(got no\)"),
        ({"targets": {"left_plam": [0, 0, 1]}}, "Unknown link 'left_plam'.*left_palm"),
        (
            {"targets": {"left_palm": [0, 0, 1]}, "points": {"left_palm": [0, 0, 0]}},
            "The target of left_palm has more than one point",
        ),
        (
            {"avoid_collisions": "no"},
            r"avoid_collisions must be True or False \(got no\)",
        ),
        ({"floor": 700.0}, "floor is 699 m above the robot: it is in m, at most 100 m"),
        (
            {"targets": {"head": [0, 0, 1]}, "points": {"head": [50, 0, 0]}},
            "point of head is 50 m from the link's origin along an axis: points are",
        ),
    ],
)
def test_a_wrong_request_is_refused_in_a_sentence(g1, given, problem):
    request = {"targets": {}, "base": BASE, **given}
    with pytest.raises((InvalidValueError, UnknownNameError), match=problem):
        g1.ik(**request)


def test_balance_is_also_that_of_feet_with_targets(g1):
    start = g1.named_configuration("stand")
    poses = g1.link_poses(start, BASE)
    feet = {"left_foot": poses[FEET[0]].copy(), "right_foot": poses[FEET[1]].copy()}
    feet["left_foot"][1] -= 0.04
    feet["right_foot"][1] += 0.04
    targets = {**feet, "left_hand": [0.35, 0.25, 0.5]}
    result = g1.ik(targets, start, BASE, balance=True)
    assert result.reached
    only = ("center_of_mass",)
    assert g1.check_state(result.positions, result.base, only).passed


def test_a_path_reaches_in_each_sample_what_can_be_reached(g1):
    """Where tasks leave a choice, steps must not overshoot from sample to sample."""
    start, times = g1.named_configuration("stand"), np.linspace(0.0, 4.0, 101)
    hand = g1.link_poses(start, BASE)["left_rubber_hand"][:3]
    share = 0.5 - 0.5 * np.cos(np.pi * times / 4.0)
    goal = np.array([0.2, 0.3, 0.2])
    targets = {"left_hand": hand + share[:, np.newaxis] * (goal - hand)}
    options = {"balance": True, "avoid_collisions": True}
    path = g1.ik_trajectory(times, targets, start, BASE, **options)
    assert path.message == ""
    speeds = np.diff(path.motion.positions, axis=0) / 0.04
    assert np.abs(speeds).max() < 1.5
    assert np.abs(np.diff(speeds, axis=0)).max() / 0.04 < 60.0


def test_a_path_at_the_limits_of_speed_passes_the_check(g1):
    times = np.linspace(0.0, 0.05, 11)
    targets = {"left_hand": np.linspace([0.1, 0.2, 0.7], [0.2, 0.3, 1.5], 11)}
    path = g1.ik_trajectory(times, targets, g1.named_configuration("stand"), BASE)
    assert not path.reached
    assert path.message.startswith("Not all is reached in ")
    assert g1.check(path.motion, only=("velocity",)).findings == ()


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"cart": [3000.0, 0.0, 0.0]}, "target of cart at 0.500 s is 3e.03 m from"),
        ({"cart": 4.0}, "target of cart must be a position"),
        ({"times": [[0.0, 0.5]]}, "times of a path must be a row of numbers"),
    ],
)
def test_a_wrong_sample_of_a_path_is_refused_in_a_sentence(given, problem):
    request = {"times": [0.0, 0.5], **given}
    target = request.pop("cart", np.zeros(3))
    rows = target if np.ndim(target) == 0 else [np.zeros(3), target]
    with pytest.raises(InvalidValueError, match=problem):
        Robot(SLIDER).ik_trajectory(targets={"cart": rows}, **request)


def test_times_of_a_path_must_increase():
    with pytest.raises(InvalidValueError, match="times of a path must increase"):
        Robot(SLIDER).ik_trajectory([1.0, 0.0], {"cart": np.zeros((2, 3))})


def test_an_unknown_option_of_a_path_is_refused():
    with pytest.raises(TypeError, match="argument 'balanc'"):
        Robot(SLIDER).ik_trajectory([0.0], {"cart": np.zeros((1, 3))}, balanc=True)


def test_a_step_without_solution_is_an_answer():
    """Lengths in mm: numbers differ by more than the precision of the solver."""
    origin = '<origin xyz="0 0 100"/><axis xyz="0 {0} {1}"/>'
    limits = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
    joints = "".join(
        f'<link name="l{n + 1}"/><joint name="j{n}" type="revolute">'
        f'<parent link="l{n}"/><child link="l{n + 1}"/>'
        f"{origin.format(n % 2, 1 - n % 2)}{limits}</joint>"
        for n in range(4)
    )
    robot = Robot(f'<robot name="arm"><link name="l0"/>{joints}</robot>')
    target = [50.0, 20.0, 50.0]
    result = robot.ik({"l4": target}, weights={"l4": np.inf})
    assert is_within_limits(robot, result.positions)
    assert not result.reached
    (distance, _) = errors(robot, result, {"l4": target})[0]
    assert result.message == (
        f"Not reached: l4 is {distance:.2f} m from its target; the search ended early, "
        "as the solver found no further step."
    )
    path = robot.ik_trajectory([0.0, 1.0], {"l4": [target] * 2}, weights={"l4": np.inf})
    assert "first at 0.00 s" in path.message


@pytest.mark.parametrize("rows", [0, 3])
def test_a_path_needs_a_target_per_time(rows):
    times = np.arange(4.0) if rows else np.zeros(0)
    with pytest.raises(InvalidValueError, match=r"but 3 targets|at least one sample"):
        Robot(SLIDER).ik_trajectory(times, {"cart": np.zeros((rows, 3))})
