"""Motions through keyframes."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import BASE, SLIDER, chains
from scipy.spatial.transform import Rotation

from g1_description import Robot
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.ik.inverse_kinematics import InverseKinematics
from g1_description.ik.keyframes import PASS, PERIOD, STOP, Keyframe, keyframe_pieces

FEET = ("left_ankle_roll_link", "right_ankle_roll_link")


@pytest.fixture(scope="module")
def pick_up(g1):
    """Stand, reach to the floor, lift, and step with the right foot."""
    stand = g1.named_configuration("stand")
    down = g1.ik({"left_hand": [0.25, 0.3, 0.15]}, stand, BASE, balance=True)
    up = g1.ik({"left_hand": [0.3, 0.2, 0.9]}, stand, BASE, balance=True)
    foot = g1.link_poses(up.positions, up.base)[FEET[1]].copy()
    foot[:3] += [0.15, 0.0, 0.05]
    step = g1.ik({"right_foot": foot}, up.positions, up.base)
    assert down.reached
    assert up.reached
    assert step.reached
    return [
        Keyframe(0.0, stand, BASE),
        Keyframe(1.0, down.positions, down.base),
        Keyframe(2.5, up.positions, up.base),
        Keyframe(3.5, step.positions, step.base),
    ]


def through(robot, frames, way=STOP, feet=FEET):
    inverse = InverseKinematics(robot.description)
    *_, made = keyframe_pieces(robot.description, inverse, feet, frames, way)
    return made


def speeds(motion):
    return np.diff(motion.positions, axis=0) / np.diff(motion.times)[:, np.newaxis]


def base_rates(motion):
    """Return speeds, accelerations and turning speeds of the base."""
    bases = motion.base_poses[[0, *range(len(motion.times)), -1]]  # at rest before
    steps = np.diff(bases[:, :3], axis=0) / PERIOD
    turns = Rotation.from_quat(bases[:, 3:])
    angles = np.linalg.norm((turns[:-1].inv() * turns[1:]).as_rotvec(), axis=1)
    changes = np.diff(steps, axis=0) / PERIOD
    return (
        np.linalg.norm(steps, axis=1).max(),
        np.linalg.norm(changes, axis=1).max(),
        angles.max() / PERIOD,
    )


def at(motion, time):
    return int(np.argmin(np.abs(motion.times - time)))


@pytest.mark.parametrize("way", [STOP, PASS])
def test_keyframes_are_passed_and_standing_feet_stay(g1, pick_up, way):
    made = through(g1, pick_up, way)
    motion = made.motion
    np.testing.assert_allclose(made.times, [0.0, 1.0, 2.5, 3.5], atol=1e-12)
    np.testing.assert_allclose(np.diff(motion.times), PERIOD, atol=1e-12)
    for frame in pick_up:
        row = at(motion, frame.time)
        np.testing.assert_allclose(motion.positions[row], frame.positions, atol=1e-9)
        turn = motion.base_poses[row, 3:] @ frame.base[3:]
        assert abs(turn) == pytest.approx(1.0)
        np.testing.assert_allclose(motion.base_poses[row, :3], frame.base[:3])
    places = [
        g1.link_poses(q, base) for q, base in zip(motion.positions, motion.base_poses)
    ]
    lifted = at(motion, 2.5)
    assert np.abs(speeds(motion)[lifted]).max() < 0.1  # a foot is about to move
    for foot, last in ((FEET[0], len(places)), (FEET[1], lifted + 1)):
        poses = np.array([place[foot] for place in places[:last]])
        np.testing.assert_allclose(
            poses[:, :3], poses[:1, :3].repeat(last, 0), atol=3e-4
        )
        turns = Rotation.from_quat(poses[:, 3:])
        angles = np.linalg.norm((turns[0].inv() * turns).as_rotvec(), axis=1)
        assert angles.max() < 2e-3
    assert places[-1][FEET[1]][0] - places[lifted][FEET[1]][0] > 0.14
    assert (g1.lower <= motion.positions).all()
    assert (motion.positions <= g1.upper).all()


@pytest.mark.parametrize("way", [STOP, PASS])
def test_a_motion_rests_at_its_ends_and_at_keyframes_where_it_stops(g1, way):
    stand, squat = g1.named_configuration("stand"), g1.named_configuration("squat")
    half = stand + 0.5 * (squat - stand)
    times, rows = (0.0, 1.0, 2.0), (stand, half, squat)
    frames = [Keyframe(t, q, BASE) for t, q in zip(times, rows)]
    moved = np.abs(speeds(through(g1, frames, way, ()).motion)).max(axis=1)
    assert moved[0] < 0.06
    assert moved[-1] < 0.06
    assert (moved[49] < 0.06) == (way == STOP)


def test_nothing_overshoots_between_two_keyframes(g1, pick_up):
    motion = through(g1, pick_up, PASS, ()).motion
    for first, last in zip(pick_up, pick_up[1:]):
        rows = slice(at(motion, first.time), at(motion, last.time) + 1)
        both = np.stack([first.positions, last.positions])
        assert (motion.positions[rows] >= both.min(axis=0) - 1e-9).all()
        assert (motion.positions[rows] <= both.max(axis=0) + 1e-9).all()


def test_times_that_are_too_short_are_lengthened(g1, pick_up):
    short = [f._replace(time=PERIOD * n) for n, f in enumerate(pick_up)]
    made = through(g1, short, PASS)
    relative = np.abs(speeds(made.motion)) / g1.velocity_limits
    assert relative.max() <= 1.0
    assert (np.array(base_rates(made.motion)) <= (1.0, 3.0, 2.0)).all()
    assert (np.diff(made.times)[:2] > PERIOD).all()
    assert made.times[-1] < 3.0
    late = f"Keyframe 2 is later than set, at {made.times[1]:.2f} s instead of 0.02 s"
    assert made.message == f"{late}: the base would be too fast."


def test_the_checks_find_nothing_invalid_in_it(g1, pick_up):
    motion = through(g1, pick_up).motion
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        verdict = g1.check(motion)
    assert not {"position", "velocity"} & {f.check for f in verdict.findings}


@pytest.mark.parametrize(
    ("times", "problem"),
    [((0.0,), "at least two keyframes"), ((0.0, 0.0), "times of keyframes must incr")],
)
def test_invalid_keyframes_are_refused(g1, times, problem):
    frames = [Keyframe(t, g1.named_configuration("stand"), BASE) for t in times]
    with pytest.raises(InvalidValueError, match=problem):
        through(g1, frames)


def test_keyframes_beyond_limits_and_joints_without_speeds_make_no_endless_motion(g1):
    stand = g1.named_configuration("stand")
    beyond = stand.copy()
    beyond[[4, 10]] = g1.upper[[4, 10]] + 0.5  # ankles
    frames = [Keyframe(0.0, stand, BASE), Keyframe(1.0, beyond, BASE)]
    made = through(g1, frames)
    assert made.times == (0.0, 1.0)
    assert made.motion.positions[-1, 4] == pytest.approx(g1.upper[4])
    given, within = (
        g1.keyframes([q, q], [0, 1]).motion
        for q in (beyond, np.minimum(beyond, g1.upper))
    )
    np.testing.assert_allclose(given.base, within.base, atol=1e-12)
    still = Robot(SLIDER.replace('velocity="0.5"', 'velocity="0"'))
    ends = [Keyframe(t, np.array([t]), BASE) for t in (0.0, 1.0)]
    made = through(still, ends, feet=())
    assert made.times == (0.0, 1.0)
    assert made.motion.duration == pytest.approx(1.0)


def test_a_program_gives_keyframes_in_any_form(g1):
    stand, squat = g1.named_configuration("stand"), g1.named_configuration("squat")
    reach = g1.ik({"left_hand": [0.25, 0.3, 0.15]}, stand, BASE, balance=True)
    by_joint = dict(zip(g1.joint_names, squat))
    above = BASE.copy()
    above[2] += 1.0
    times = (1.0, 2.2, 3.7, 6.7, 9.7)
    keys = g1.keyframes(
        ["stand", by_joint, reach, stand, (squat, above)], times, through="pass"
    )
    assert keys.times == pytest.approx(times)
    assert keys.message == ""
    rows = [at(keys.motion, time) for time in keys.times]
    expected = np.stack([stand, squat, reach.positions, stand, squat])
    np.testing.assert_allclose(keys.motion.positions[rows], expected, atol=1e-9)
    bases = keys.motion.base_poses[rows]
    np.testing.assert_allclose(bases[2, :3], reach.base[:3], atol=1e-9)
    np.testing.assert_allclose(bases[[0, 3, 4]], [BASE, BASE, above], atol=1e-3)
    part = slice(rows[0], rows[1] + 1)  # its feet stay on the floor
    feet = g1.forward_kinematics(keys.motion.positions, keys.motion.base_poses)
    feet = feet[part, [g1.link_row(FEET[0])], :3]
    assert np.ptp(feet, axis=0) == pytest.approx(0.0, abs=3e-4)


@pytest.mark.parametrize("through", ["stop", "pass"])
def test_saved_keyframes_are_read_as_they_were(g1, tmp_path, through):
    file = tmp_path / "pick.yaml"
    file.write_text("pick_1: {}\n\n# mine\nother_3:\n  left_elbow_joint: 0.5\n")
    g1.keyframes(["stand", "squat", "stand"], [0, 1, 2]).save(file)
    keys = g1.keyframes([("squat", BASE), "t_pose"], [0, 0.5], ["left_hand"], through)
    keys.save(file)
    read = g1.read_keyframes(file)
    assert (read.times, read.through) == (keys.times, through)
    assert [*read.fixed_links] == ["left_hand"]
    np.testing.assert_allclose(read.motion.positions, keys.motion.positions, atol=1e-5)
    np.testing.assert_allclose(read.motion.base, keys.motion.base, atol=1e-5)
    assert "# mine\nother_3:\n  left_elbow_joint: 0.5\n" in file.read_text()
    keys.save(file, "again")
    with pytest.raises(UnknownNameError, match="must be one of pick, again"):
        g1.read_keyframes(file)
    assert g1.read_keyframes(file, "again").times == keys.times


@pytest.mark.parametrize(
    ("entry", "times", "options", "problem"),
    [
        ("stand", [0.0, np.nan], {}, "times of keyframes must increase"),
        ("stand", [0.0], {}, "Each of the 2 keyframes needs a time"),
        ("stand", [0.0, 3e6], {}, "would last 3e.06 s, at most 2000 s"),
        ("sqat", [0, 1], {}, "Keyframe 2: Unknown pose 'sqat'"),
        ([0.1, 0.2], [0, 1], {}, "Keyframe 2: The last axis .* 29 joints"),
        (np.zeros((2, 29)), [0, 1], {}, "Keyframe 2: .* single configuration"),
        (np.full(29, np.nan), [0, 1], {}, "Keyframe 2: .* must be finite"),
        (("stand", [0, 0, 1]), [0, 1], {}, "Keyframe 2: The base must be seven"),
        ("stand", [0, 1], {"fixed_links": ["left_fot"]}, "link 'left_fot'.* left_foot"),
        ("stand", [0, 1], {"fixed_links": "left_foot"}, "fixed_links must be a list"),
        ("stand", [0, 1], {"through": "slow"}, "through must be stop or pass"),
    ],
)
def test_keyframes_of_a_program_that_are_invalid(g1, entry, times, options, problem):
    with pytest.raises((InvalidValueError, UnknownNameError), match=problem):
        g1.keyframes(["stand", entry], times, **options)


def test_a_link_that_cannot_stay_and_a_jump_are_reported():
    joints = [
        f'<joint name="j{n}" type="revolute"><parent link="{parent}"/><child '
        f'link="l{n}"/><origin xyz="{min(n - 1, 1)} 0 0"/><axis xyz="0 0 1"/><limit '
        f'lower="-3" upper="3" velocity="3" effort="1"/></joint><link name="l{n}"/>'
        for n, parent in ((1, "world"), (2, "l1"), (3, "l2"))
    ]
    arm = Robot(f'<robot name="arm"><link name="world"/>{"".join(joints)}</robot>')
    other_way = [[0.5, -1.0, 0.5], [-0.5, 1.0, -0.5]]
    assert "Even so" not in arm.keyframes(other_way, [0, 1]).message
    said = arm.keyframes(other_way, [0, 1], ["l3"]).message
    assert "Even so, j2 is too fast before keyframe 2. At " in said
    assert "l3 is 245 mm" in said


@settings(max_examples=8)
@given(
    chains(max_joints=5),
    st.integers(0, 1000),
    st.integers(2, 5),
    st.sampled_from([STOP, PASS]),
)
def test_motions_of_any_robot_keep_to_its_limits(chain, seed, count, way):
    robot, random = Robot(chain[0]), np.random.default_rng(seed)
    lower = np.where(np.isfinite(robot.lower), robot.lower, -3.0)
    upper = np.where(np.isfinite(robot.upper), robot.upper, 3.0)
    times = np.cumsum(random.uniform(0.02, 0.5, count))
    frames = []
    for time in times - times[0]:
        base = np.concatenate([random.uniform(-1, 1, 3), random.normal(size=4)])
        base[3:] /= np.linalg.norm(base[3:])
        frames.append(Keyframe(time, random.uniform(lower, upper), base))
    made = through(robot, frames, way, ())
    motion = made.motion
    assert (np.abs(speeds(motion)) <= robot.velocity_limits).all()
    assert (np.array(base_rates(motion)) <= (1.0, 3.0, 2.0)).all()
    assert (motion.positions >= robot.lower - 1e-9).all()
    assert (motion.positions <= robot.upper + 1e-9).all()
    norms = np.linalg.norm(motion.base_poses[:, 3:], axis=1)
    np.testing.assert_allclose(norms, 1.0, atol=1e-9)
    for frame, time in zip(frames, made.times):
        row = at(motion, time)
        np.testing.assert_allclose(motion.positions[row], frame.positions, atol=1e-9)
