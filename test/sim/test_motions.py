"""Motions in the simulated world: what it shows at each step, against their samples."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from worlds import OUR_G1

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.motion.motion import Motion
from g1_description.sim.drives import PdCommand

STEP = 1_000_000
UPRIGHT = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])
ELBOW, KNEE = "left_elbow_joint", "left_knee_joint"


def base_poses(n, random):
    quaternions = Rotation.random(n, random_state=random).as_quat()
    return np.hstack([random.uniform(-2, 2, (n, 3)), quaternions])


def motion_of(model, seed=1, n=6, velocities=False, gap=0.01):
    """Make a motion of all joints inside their limits."""
    random = np.random.RandomState(seed)
    shape = n, len(model.joint_names)
    positions = random.uniform(model.lower, model.upper, shape)
    return Motion(
        gap * np.arange(n),
        model.joint_names,
        0.5 * (positions + positions.mean(axis=0)),
        random.uniform(-2, 2, shape) if velocities else None,
        base_poses(n, random),
    )


def elbow(*positions, gap=0.01, name=ELBOW):
    return Motion(
        gap * np.arange(len(positions)), (name,), np.array(positions)[:, np.newaxis]
    )


@pytest.fixture
def world(make_world):
    world = make_world("kinematic")
    world.spawn_urdf("g1", OUR_G1, UPRIGHT)
    return world


@pytest.fixture
def model(world):
    return world.model("g1")


def position(model, name=ELBOW):
    return model.position[model.joint_row(name)]


def velocity(model, name=ELBOW):
    return model.velocity[model.joint_row(name)]


def steps(world, n):
    for _ in range(n):
        world.step()


def test_each_sample_is_there_to_the_last_bit_at_its_time(world, model):
    motion = motion_of(model)
    world.motions.play(model, motion, STEP)
    seen = []
    for number in range(51):
        world.step()
        if number % 10 == 0:
            seen.append((model.position.copy(), world.link_state("g1::pelvis")[0]))
    for sample, (positions, pelvis) in zip(range(6), seen):
        assert (positions == motion.positions[sample]).all()
        assert (pelvis == motion.base_poses[sample]).all()


def test_between_samples_the_base_is_where_scipy_puts_it(world, model):
    motion = motion_of(model)
    world.motions.play(model, motion, 0)
    turns = Slerp(motion.times, Rotation.from_quat(motion.base_poses[:, 3:]))
    for number in range(1, 50):
        world.step()
        pose, _ = world.link_state("g1::pelvis")
        time = 1e-3 * number
        apart = turns([time])[0].inv() * Rotation.from_quat(pose[3:])
        assert np.linalg.norm(apart.as_rotvec()) < 1e-9
        for axis in range(3):
            wanted = np.interp(time, motion.times, motion.base_poses[:, axis])
            assert abs(pose[axis] - wanted) < 1e-12


def test_twists_of_the_links_are_the_rates_of_their_poses(world, model):
    world.motions.play(model, motion_of(model, velocities=True, gap=1.0), 0)
    steps(world, 24)
    before, names = model.poses.copy(), model.link_names
    world.step()
    twists = model.twists.copy()
    world.step()
    rates = (model.poses[:, :3] - before[:, :3]) / 2e-3
    assert len(names) > 29
    np.testing.assert_allclose(twists[:, :3], rates, atol=1e-3, rtol=1e-3)
    spins = Rotation.from_quat(model.poses[:, 3:]) * (
        Rotation.from_quat(before[:, 3:]).inv()
    )
    np.testing.assert_allclose(
        twists[:, 3:], spins.as_rotvec() / 2e-3, atol=1e-3, rtol=1e-3
    )


def test_at_its_end_it_rests_at_the_last_sample(world, model):
    motion = motion_of(model, velocities=True)
    world.motions.play(model, motion, 0)
    steps(world, 49)
    assert model.velocity.any() and model.twists.any()
    steps(world, 5)
    assert (model.position == motion.positions[-1]).all()
    assert not model.velocity.any() and not model.twists.any()


def test_it_waits_for_its_beginning(world, model):
    world.motions.play(model, elbow(0.5, 0.6), 5 * STEP)
    steps(world, 4)
    assert position(model) == 0.0
    world.step()
    assert position(model) == 0.5


def test_before_its_first_time_joints_go_there_from_where_they_are(world, model):
    world.set_joint_positions("g1", {ELBOW: 0.2})
    motion = Motion(np.array([0.01, 0.02]), (ELBOW,), np.array([[0.4], [0.6]]))
    world.motions.play(model, motion, STEP)
    found = []
    for _ in range(11):
        world.step()
        found.append(position(model))
    np.testing.assert_allclose(found, np.linspace(0.2, 0.4, 11), atol=1e-12)


def test_a_newer_motion_takes_its_joints_and_no_others(world, model):
    both = Motion(
        np.array([0.0, 0.1]), (ELBOW, KNEE), np.array([[0.0, 0.0], [1.0, 1.0]])
    )
    world.motions.play(model, both, 0)
    steps(world, 10)
    world.motions.play(model, elbow(0.7, 0.7, gap=0.02), 20 * STEP)
    steps(world, 9)
    assert position(model) == pytest.approx(0.19)  # the newer one has not begun
    steps(world, 10)
    assert position(model) == 0.7
    assert position(model, KNEE) == pytest.approx(0.29)
    steps(world, 80)
    assert (position(model), position(model, KNEE)) == (0.7, 1.0)


@pytest.mark.parametrize(("first", "second"), [(20, 10), (10, 1)])
def test_an_older_motion_that_begins_later_is_replaced(world, model, first, second):
    world.motions.play(model, elbow(0.9, 0.9), first * STEP)
    world.motions.play(model, elbow(0.3, 0.3), second * STEP)
    steps(world, first + 20)
    assert position(model) == 0.3


@pytest.mark.parametrize("again", ["joint", "link", "model", "stop"])
def test_a_newer_command_takes_what_it_sets(world, model, again):
    motion = motion_of(model)
    world.motions.play(model, motion, 0)
    steps(world, 25)
    base, joint = model.root_poses[0].copy(), position(model)
    if again == "joint":
        world.set_joint_positions("g1", {ELBOW: 0.25})
        joint = 0.25
    elif again == "link":
        entity = world.entities.link("g1::left_elbow_link")
        world.set_link_state(entity, entity.pose, np.zeros(6))
        joint = position(model)
    elif again == "model":
        world.put("g1", UPRIGHT, np.zeros(6))
        base = UPRIGHT
    else:
        world.motions.stop(model)
        assert not model.velocity.any() and not model.twists.any()
    steps(world, 40)
    moved = again in ("joint", "link")
    assert (position(model) == joint) == (again != "model")
    wanted = motion.base_poses[-1] if moved else base
    assert (model.root_poses[0] == wanted).all()
    still = again == "stop"
    assert (position(model, KNEE) == motion.positions[-1, 3]) != still


def test_joints_stop_by_name(world, model):
    world.motions.play(model, motion_of(model), 0)
    steps(world, 25)
    stopped = position(model)
    world.motions.stop(model, [ELBOW])
    assert velocity(model) == 0.0 and velocity(model, KNEE) != 0.0
    steps(world, 40)
    assert position(model) == stopped
    with pytest.raises(UnknownNameError, match="no movable joint left_ear"):
        world.motions.stop(model, ["left_ear"])


@pytest.mark.parametrize("how", ["reset", "reset_models"])
def test_a_reset_ends_it(world, model, how):
    world.motions.play(model, motion_of(model), 0)
    steps(world, 25)
    getattr(world, how)()
    before = model.position.copy()
    assert not model.velocity.any()
    steps(world, 40)
    assert (model.position == before).all()
    assert (model.root_poses[0] == UPRIGHT).all()


def test_two_robots_play_and_one_goes(world, model):
    world.spawn_urdf("other", OUR_G1, UPRIGHT)
    other = world.model("other")
    motions = [motion_of(model, seed) for seed in (1, 2)]
    world.motions.play(model, motions[0], 0)
    world.motions.play(other, motions[1], 0)
    steps(world, 10)
    assert (model.position == motions[0].positions[1]).all()
    assert (other.position == motions[1].positions[1]).all()
    world.delete("other")
    steps(world, 40)
    assert (model.position == motions[0].positions[5]).all()


def test_a_single_sample_shows_its_velocities_and_rests(world, model):
    single = Motion(np.zeros(1), (ELBOW,), np.array([[0.5]]), np.array([[2.0]]))
    world.motions.play(model, single, STEP)
    world.step()
    assert (position(model), velocity(model)) == (0.5, 2.0)
    steps(world, 99)
    assert velocity(model) == 2.0
    world.step()
    assert (position(model), velocity(model)) == (0.5, 0.0)


def test_limits_are_kept_but_for_rounding(world, model):
    upper = model.upper[model.joint_row(ELBOW)]
    lower = model.lower[model.joint_row(ELBOW)]
    for inside in ((lower, upper), (lower - 9e-4, upper + 9e-4)):
        assert world.motions.play(model, elbow(*inside), STEP).clamped == {}
    report = world.motions.play(model, elbow(lower - 0.2, lower), STEP)
    assert report.clamped == {ELBOW: (lower - 0.2, lower)}
    report = world.motions.play(model, elbow(upper + 9e-4, upper + 0.2), STEP)
    assert report.clamped == {ELBOW: (upper + 0.2, upper)}
    world.step()
    assert position(model) == upper + 9e-4
    steps(world, 5)
    assert position(model) == pytest.approx(upper + 1e-3) and velocity(model) == 0.0


def test_what_it_cannot_move_is_told(world, model):
    names = ("left_ear", ELBOW)
    motion = Motion(np.zeros(1), names, np.array([[1.0, 0.5]]))
    report = world.motions.play(model, motion, STEP)
    assert report.unknown == ["left_ear"]
    world.step()
    assert position(model) == 0.5
    with pytest.raises(InvalidValueError, match="no joint of g1"):
        world.motions.play(model, elbow(0.1, name="left_ear"), STEP)


def test_nothing_plays_where_nothing_drives(make_world):
    world = make_world("limp")
    world.spawn_urdf("g1", OUR_G1, UPRIGHT)
    with pytest.raises(InvalidValueError, match="limp"):
        world.motions.play(world.model("g1"), elbow(0.1), 0)


def test_contacts_are_those_of_the_motion(world, model):
    assert not any("g1" in one for pair in world.engine.contacts() for one in pair)
    pose = UPRIGHT.copy()
    pose[2] -= 0.02
    motion = Motion(np.zeros(1), (), np.zeros((1, 0)), base_poses=pose[np.newaxis])
    world.motions.play(model, motion, STEP)
    world.step()
    touching = {link for pair in world.engine.contacts() for link in pair}
    assert "ground_plane::link" in touching


def test_in_hold_the_motors_take_the_arm_there_and_stop_at_a_reset(make_world):
    world = make_world("hold")
    world.spawn_urdf("g1", OUR_G1, UPRIGHT, True)
    model = world.model("g1")
    world.motions.play(model, elbow(0.0, 1.0, gap=0.25), 0)
    steps(world, 120)
    assert position(model) == pytest.approx(0.48, abs=0.06)
    world.reset_models()
    steps(world, 200)
    target = model.target[model.joint_row(ELBOW)]
    assert 0.3 < target < 0.6
    assert position(model) == pytest.approx(target, abs=2e-3)


@pytest.mark.parametrize("every", [1, 5])
def test_each_sample_is_reached_in_one_of_the_states_that_are_shown(
    world, model, every
):
    """A motion of a sample each 7 ms: its last one comes with the motion's end."""
    world.motions.play(model, elbow(*np.linspace(0.0, 0.3, 4), gap=0.007), STEP)
    reached = []
    for number in range(1, 41):
        world.step()
        if number % every == 0:
            if world.motions.has_reached_sample(model):
                reached.append(number)
            world.motions.show()
    samples = [1, 8, 15, 22]
    assert reached == [every * -(-sample // every) for sample in samples]


@pytest.mark.parametrize("physics", ["kinematic", "hold"])
def test_what_is_commanded_is_known_before_limits_until_a_reset(make_world, physics):
    world = make_world(physics)
    world.spawn_urdf("g1", OUR_G1, UPRIGHT)
    model = world.model("g1")
    row, other = model.joint_row(ELBOW), model.joint_row(KNEE)
    assert np.isnan(model.commanded).all() and model.commanded_base is None
    beyond = model.upper[row] + 0.5
    world.set_joint_positions("g1", {ELBOW: beyond})
    assert model.commanded[row] == beyond
    assert np.isnan(np.delete(model.commanded, row)).all()
    with pytest.raises(InvalidValueError):
        world.set_joint_positions("g1", {ELBOW: 0.1, KNEE: np.nan})
    assert model.commanded[row] == beyond
    base = UPRIGHT + np.eye(7)[0]
    motion = Motion(np.zeros(1), (KNEE,), np.array([[0.4]]), None, base[np.newaxis])
    world.motions.play(model, motion, STEP)
    world.step()
    assert model.commanded[[row, other]].tolist() == [beyond, 0.4]
    np.testing.assert_array_equal(model.commanded_base, base)
    world.motions.stop(model)
    if world.is_dynamic:  # nothing holds the base
        assert model.commanded_base is None
    else:
        np.testing.assert_array_equal(model.commanded_base, base)
    world.put("g1", UPRIGHT, np.zeros(6))
    if world.is_dynamic:
        assert model.commanded_base is None
        world.motions.play(model, motion, STEP)
        world.step()
        assert model.commanded_base is not None
        both, zero = np.array([0.3, 0.3]), np.zeros(2)
        command = PdCommand(both, zero, np.array([40.0, 0.0]), zero, zero)
        world.drive(model, [ELBOW, KNEE], command)
        np.testing.assert_array_equal(model.commanded[[row, other]], [0.3, np.nan])
        assert model.commanded_base is None
    else:
        np.testing.assert_array_equal(model.commanded_base, model.root_poses[0])
    world.reset()
    assert np.isnan(model.commanded).all() and model.commanded_base is None
