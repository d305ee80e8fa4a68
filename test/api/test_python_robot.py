"""g1_description.Robot: what a program asks of a robot."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import matrix_of
from robots import chains
from scipy.spatial.transform import Rotation

import g1_description
from g1_description import Robot
from g1_description.errors import (
    DescriptionError,
    G1DescriptionError,
    InvalidValueError,
    MotionError,
    UnknownNameError,
)

ROOT = Path(__file__).parents[2]
DATA = ROOT / "test" / "data"
G1 = Robot()
ELBOW, KNEE = "left_elbow_joint", "right_knee_joint"
HERE = [1.0, 2.0, 0.8, 0.0, 0.0, 0.6, 0.8]


@pytest.fixture(scope="module")
def pinocchio():
    """Give Pinocchio."""
    reason = "pinocchio is not there, as its wheels need numpy 1.23"
    return pytest.importorskip("pinocchio", reason=reason)


@pytest.fixture(scope="module")
def oracle(pinocchio):
    """Give Pinocchio's G1, with its root fixed."""
    model = pinocchio.buildModelFromUrdf(str(ROOT / "urdf" / "g1_29dof.urdf"))
    model.gravity.linear = np.array([0.0, 0.0, -9.8])  # as Gazebo
    return model


def refused(function, *args, **kwargs):
    """Return the sentence with which something is refused."""
    with pytest.raises(G1DescriptionError) as found:
        function(*args, **kwargs)
    text = str(found.value)
    assert "\n" not in text
    return text


def test_without_arguments_it_is_the_g1():
    assert len(G1.joint_names) == len(G1.lower) == len(G1.effort_limits) == 29
    assert G1.joint_names[0] == "left_hip_pitch_joint"
    assert (len(G1.link_names), G1.base_link) == (40, "pelvis")
    assert repr(G1) == "<Robot g1_29dof: 29 joints, 40 links>"


def test_limits_are_pinocchios(oracle):
    order = [G1.joint_row(name) for name in [*oracle.names][1:]]
    assert (G1.lower[order] == oracle.lowerPositionLimit).all()
    assert (G1.upper[order] == oracle.upperPositionLimit).all()
    assert (G1.velocity_limits[order] == oracle.velocityLimit).all()
    assert (G1.effort_limits[order] == oracle.effortLimit).all()


def test_what_is_unlimited_or_without_mass_says_so():
    robot = Robot(DATA / "continuous.urdf")
    assert np.isinf(robot.upper).any()
    assert Robot('<robot name="r"><link name="a"/></robot>').mass is None


@pytest.mark.parametrize(
    "model",
    [
        "package://g1_description/urdf/g1_29dof.urdf",
        ROOT / "urdf" / "g1_29dof.urdf",
        (ROOT / "urdf" / "g1_29dof.urdf").read_text(),
    ],
    ids=["package", "path", "text"],
)
def test_a_model_is_named_as_the_commands_take_it(model):
    assert Robot(model).joint_names == G1.joint_names


def test_a_model_that_is_not_there_is_refused():
    assert "g1_29dof.urdf" in refused(Robot, ROOT / "urdf" / "g1_28dof.urdf")
    assert "package 'no_such'" in refused(Robot, "package://no_such/robot.urdf")
    with pytest.raises(DescriptionError):
        Robot("<robot")


# --- configurations ----------------------------------------------------------


def test_dictionaries_and_arrays_mean_the_same():
    array = np.zeros(29)
    array[[G1.joint_row(ELBOW), G1.joint_row(KNEE)]] = 0.7, 0.3
    assert (G1.positions({ELBOW: 0.7, KNEE: 0.3}) == array).all()
    assert (G1.positions(array.tolist()) == array).all()
    many = G1.positions({ELBOW: np.linspace(0.0, 1.0, 5), KNEE: 0.3})
    assert many.shape == (5, 29)
    assert many[:, G1.joint_row(ELBOW)].tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert (many[:, G1.joint_row(KNEE)] == 0.3).all()


def test_an_array_that_is_given_stays_as_it_is():
    given_array = np.zeros(29)
    G1.positions(given_array)[0] = 1.0
    assert given_array[0] == 0.0


def test_joints_that_are_not_named_are_neutral():
    robot = Robot(DATA / "range_2_8.urdf")
    assert (robot.positions({}) == robot.neutral).all()
    assert (robot.neutral >= robot.lower).all()
    assert robot.neutral.any()


def test_an_unknown_joint_is_refused_with_those_like_it():
    text = refused(G1.positions, {"left_elbow": 1.0})
    assert text.startswith(
        "Unknown movable joint left_elbow. Known joints: left_elbow_"
    )


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        (np.zeros(28), "(28,)"),
        ([float("nan")] + 28 * [0.0], "left_hip_pitch_joint must be finite (got nan)"),
        ("wave", "must be an array of numbers"),
        ({ELBOW: [0.0, 1.0], KNEE: [0.0, 0.0, 0.0]}, "do not match"),
    ],
)
def test_positions_of_no_robot_are_refused(positions, words):
    assert words in refused(G1.positions, positions)


def test_named_poses_are_those_of_the_command():
    assert {"zero", "stand", "wave"} <= {*G1.pose_names}
    stand = G1.named_configuration("stand")
    assert stand[G1.joint_row(KNEE)] == 0.6
    assert (stand >= G1.lower).all()
    assert (stand <= G1.upper).all()
    assert "wave" in refused(G1.named_configuration, "wav")
    assert G1.profile.standing_pose == "stand"


def test_a_robot_has_only_the_poses_that_it_can_take():
    robot = Robot(DATA / "prismatic.urdf")
    assert robot.pose_names == ("zero",)
    with pytest.raises(UnknownNameError):
        robot.named_configuration("wave")


def test_random_configurations_fill_the_limits():
    drawn = G1.random_configuration(0, 4000)
    share = (drawn - G1.lower) / (G1.upper - G1.lower)
    assert share.shape == (4000, 29)
    assert (share.min(axis=0) >= 0.0).all()
    assert (share.min(axis=0) < 0.01).all()
    assert (share.max(axis=0) <= 1.0).all()
    assert (share.max(axis=0) > 0.99).all()
    assert share.mean() == pytest.approx(0.5, abs=0.01)


def test_random_configurations_repeat_with_a_seed():
    first, again = (G1.random_configuration(7) for _ in range(2))
    assert (first == again).all()
    generator = np.random.default_rng(7)
    assert (G1.random_configuration(generator) == first).all()
    assert (G1.random_configuration(generator) != first).any()
    assert G1.random_configuration(7, (2, 3)).shape == (2, 3, 29)


def test_a_joint_without_limits_is_drawn_from_a_turn():
    drawn = Robot(DATA / "continuous.urdf").random_configuration(0, 1000)
    assert drawn.min() == pytest.approx(-np.pi, abs=0.05)
    assert drawn.max() == pytest.approx(np.pi, abs=0.05)
    rail = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="rail" '
        'type="prismatic"><parent link="a"/><child link="b"/>'
        '<limit lower="-inf" upper="inf" effort="1" velocity="1"/></joint></robot>'
    )
    assert "rail needs finite limits" in refused(Robot(rail).random_configuration)


# --- kinematics and dynamics ---------------------------------------------------


def test_links_are_where_pinocchio_has_them(pinocchio, oracle):
    data = oracle.createData()
    order = [G1.joint_row(name) for name in [*oracle.names][1:]]
    for positions in G1.random_configuration(1, 20):
        pinocchio.framesForwardKinematics(oracle, data, positions[order])
        for link, pose in G1.link_poses(positions).items():
            frame = data.oMf[oracle.getFrameId(link)]
            assert np.abs(frame.translation - pose[:3]).max() < 1e-12
            turn = matrix_of(Rotation.from_quat(pose[3:]))
            assert np.abs(frame.rotation - turn).max() < 1e-12


def test_efforts_are_pinocchios(pinocchio, oracle):
    data = oracle.createData()
    order = [G1.joint_row(name) for name in [*oracle.names][1:]]
    positions, velocities, accelerations = G1.random_configuration(2, 3)
    expected = pinocchio.rnea(
        oracle, data, positions[order], velocities[order], accelerations[order]
    )
    efforts = G1.inverse_dynamics(positions, velocities, accelerations)
    assert np.abs(efforts[order] - expected).max() < 1e-9
    resting = pinocchio.computeGeneralizedGravity(oracle, data, positions[order])
    assert np.abs(G1.inverse_dynamics(positions)[order] - resting).max() < 1e-9


def test_mass_and_its_centre_are_pinocchios(pinocchio):
    file, free = ROOT / "urdf" / "g1_29dof.urdf", pinocchio.JointModelFreeFlyer()
    model = pinocchio.buildModelFromUrdf(str(file), free)  # else the root has no mass
    assert G1.mass == pytest.approx(pinocchio.computeTotalMass(model), abs=1e-9)
    positions = G1.random_configuration(3)
    order = [G1.joint_row(name) for name in [*model.names][2:]]
    configuration = np.concatenate([HERE, positions[order]])
    expected = pinocchio.centerOfMass(model, model.createData(), configuration)
    assert np.abs(G1.center_of_mass(positions, HERE) - expected).max() < 1e-12


@settings(max_examples=10)
@given(chains(), st.integers(0, 1000))
def test_a_batch_is_as_its_members_one_by_one(chain, seed):
    robot = Robot(chain[0])
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(2, 3, len(robot.joint_names)))
    base = np.concatenate([rng.normal(size=(2, 3, 3)), np.zeros((2, 3, 4))], axis=-1)
    base[..., 3:] = Rotation.random(6, random_state=seed).as_quat().reshape(2, 3, 4)
    link = robot.link_names[-1]
    together = (
        robot.forward_kinematics(positions, base),
        robot.jacobian(link, positions, base),
        robot.center_of_mass(positions, base),
        robot.inverse_dynamics(positions, base=base),
    )
    for place in np.ndindex(2, 3):
        alone = (
            robot.forward_kinematics(positions[place], base[place]),
            robot.jacobian(link, positions[place], base[place]),
            robot.center_of_mass(positions[place], base[place]),
            robot.inverse_dynamics(positions[place], base=base[place]),
        )
        for whole, part in zip(together, alone):
            assert whole[place].shape == part.shape
            assert np.allclose(whole[place], part, atol=1e-12)


def test_a_jacobian_is_how_a_link_moves():
    positions, link = G1.random_configuration(4), "left_wrist_yaw_link"
    row, step = G1.link_row(link), 1e-6
    jacobian = G1.jacobian(link, positions, HERE)
    nudges = positions + step * np.eye(29)
    moved = G1.forward_kinematics(nudges, HERE)[:, row]
    back = G1.forward_kinematics(2 * positions - nudges, HERE)[:, row]
    assert np.allclose(
        jacobian[:3, 6:].T, (moved - back)[:, :3] / (2 * step), atol=1e-8
    )
    turns = Rotation.from_quat(moved[:, 3:]) * Rotation.from_quat(back[:, 3:]).inv()
    assert np.allclose(jacobian[3:, 6:].T, turns.as_rotvec() / (2 * step), atol=1e-8)


def test_one_base_goes_with_many_configurations_and_the_other_way_round():
    positions = G1.random_configuration(5, 4)
    assert G1.forward_kinematics(positions, HERE).shape == (4, 40, 7)
    bases = np.tile(HERE, (4, 1))
    assert G1.forward_kinematics(positions[0], bases).shape == (4, 40, 7)
    first = G1.forward_kinematics(positions, bases)
    assert (first == G1.forward_kinematics(positions, HERE)).all()
    assert (first[:, 0] == HERE).all()


@pytest.mark.parametrize("name", ["floating_base", "world_root", "torso_root"])
def test_the_base_link_is_where_the_base_is(name):
    robot = Robot(DATA / f"{name}.urdf")
    poses = robot.link_poses(robot.neutral, HERE)
    if robot.base_link in poses:  # the world is no link
        assert np.allclose(poses[robot.base_link], HERE, atol=1e-12)
    assert robot.forward_kinematics(robot.neutral).shape == (len(robot.link_names), 7)


@pytest.mark.parametrize(
    ("base", "words"),
    [
        ([0.0, 0.0, 0.8], "seven"),
        ([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 0.0], "length 1 (got 0)"),
        (np.tile(HERE, (3, 1)), "(3,) and (2,)"),
    ],
)
def test_a_base_that_is_none_is_refused(base, words):
    assert words in refused(G1.forward_kinematics, np.zeros((2, 29)), base)


def test_unknown_links_and_rates_that_do_not_fit_are_refused():
    assert "left_wrist_yaw_link" in refused(G1.jacobian, "left_wrist", G1.neutral)
    text = refused(G1.inverse_dynamics, G1.neutral, np.zeros((3, 29)))
    assert "velocity array of shape (3, 29)" in text
    assert "no masses" in refused(
        Robot('<robot name="r"><link name="a"/></robot>').inverse_dynamics, []
    )


# --- motions ---------------------------------------------------------------------


def wave():
    """Make a motion of all joints."""
    times = np.linspace(0.0, 1.0, 11)
    elbow = {ELBOW: np.sin(times)}
    return G1.trajectory(times, elbow, {ELBOW: np.cos(times)}, np.tile(HERE, (11, 1)))


def test_a_motion_is_made_of_the_arrays_that_it_has_by_their_names():
    arrays = ("times", "positions", "velocities", "base")
    given = {name: getattr(wave(), name) for name in arrays}
    made = G1.trajectory(**given)
    for name, array in given.items():
        np.testing.assert_array_equal(getattr(made, name), array)


def test_a_motion_is_read_as_it_was_written(tmp_path):
    ending = "npz"
    file = tmp_path / f"wave.{ending}"
    assert G1.write_motion(file, wave()) == ()
    motion = G1.read_motion(str(file))
    assert motion.notes == ()
    assert (G1.positions_of(motion) == G1.positions_of(wave())).all()
    assert (motion.base_poses == wave().base_poses).all()
    assert np.abs(motion.times - wave().times).max() < 1e-12


def test_joints_that_a_motion_does_not_move_are_neutral():
    motion = G1.read_motion(DATA / "elbow.csv", 10.0)
    positions = G1.positions_of(motion)
    others = [
        row for row, n in enumerate(G1.joint_names) if n not in motion.joint_names
    ]
    assert others
    assert (positions[:, others] == 0.0).all()
    assert positions.shape == (len(motion.times), 29)


def test_an_invalid_motion_is_refused():
    with pytest.raises(MotionError):
        G1.trajectory([0.0, 0.0], np.zeros((2, 29)))
    with pytest.raises(MotionError):
        G1.trajectory([0.0, 1.0, 2.0], np.zeros((2, 29)))
    with pytest.raises(InvalidValueError):
        G1.trajectory([0.0, 1.0], np.zeros((2, 29)), np.zeros((3, 29)))
    with pytest.raises(MotionError):
        G1.read_motion("no_such.csv")


# --- the package ---------------------------------------------------------------------


def test_public_names_are_listed_and_others_refused():
    assert {"Client", "Robot"} <= {*dir(g1_description)}
    with pytest.raises(AttributeError, match="no_such"):
        _ = g1_description.no_such


def test_a_motion_comes_from_a_pose_by_name_or_positions():
    robot = Robot()
    squat = robot.named_configuration("squat")
    motion = robot.trajectory([0.0, 0.5, 1.0], np.tile(squat, (3, 1)))
    by_name = robot.padded(motion, "stand", {"left_elbow_joint": 1.0})
    by_array = robot.padded(motion, robot.named_configuration("stand"))
    np.testing.assert_array_equal(by_name.positions[:5], by_array.positions)
    np.testing.assert_allclose(by_name.positions[0], robot.named_configuration("stand"))
    assert by_name.positions[-1].tolist() == pytest.approx(
        robot.positions({"left_elbow_joint": 1.0}).tolist()
    )
    with pytest.raises(InvalidValueError, match="must be a single configuration"):
        robot.padded(motion, motion.positions)
    with pytest.raises(UnknownNameError, match="Unknown pose 'stnd'"):
        robot.padded(motion, "stnd")


STILL = G1.trajectory([0.0, 1.0], np.zeros((2, 29)), base=np.tile(HERE, (2, 1)))
TARGET = {"left_hand": [0.4, 0.25, 0.9]}


@pytest.mark.parametrize(
    ("former", "use", "get"),
    [
        ("Robot.pose", "named_configuration", lambda: G1.pose("stand")),
        ("Robot.collisions", "self_collisions", lambda: G1.collisions(G1.neutral).pair),
        (
            "Contacts.frame",
            "sample",
            lambda: G1.self_collisions(G1.neutral, margin=0.1).frame,
        ),
        (
            "Robot(collisions=...)",
            "allowed_collisions=...",
            lambda: Robot(collisions="pairs.yaml").mass,
        ),
        (
            "Robot.ik(hold=...)",
            "fixed_links=...",
            lambda: G1.ik(TARGET, base=HERE, hold=()).positions,
        ),
        (
            "Robot.ik(collisions=...)",
            "avoid_collisions=...",
            lambda: G1.ik(TARGET, base=HERE, collisions=True).positions,
        ),
        (
            "Robot.positions_of(trajectory=...)",
            "motion=...",
            lambda: G1.positions_of(trajectory=STILL),
        ),
        (
            "Robot.trajectory(base_poses=...)",
            "base=...",
            lambda: G1.trajectory([0.0], G1.neutral[None], base_poses=[HERE]).base,
        ),
        (
            "Verdict.bearing",
            "floor_contacts",
            lambda: G1.check_state(G1.neutral, HERE, ["penetration"]).bearing,
        ),
        ("Motion.trajectory", "the motion itself", lambda: STILL.trajectory.times),
    ],
)
def test_former_names_work_with_a_warning(former, use, get):
    with pytest.warns(DeprecationWarning) as caught:
        assert get() is not None
    assert str(caught[0].message) == f"{former} is deprecated; use {use}"
    assert Path(caught[0].filename).samefile(__file__)
