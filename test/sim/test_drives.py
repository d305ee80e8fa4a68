"""Motors of kind pd, and a controller's commands, against mechanics."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import REPOSITORY
from worlds import OUR_G1

from g1_description.errors import InvalidValueError, MotorFileError
from g1_description.motion.motors import Motors, PdMotor, ServoMotor, read_motors
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.profile import Profile
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.drives import PdCommand

ARM = """<robot name="arm"><link name="world"/><link name="mount"><inertial>
<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link><link name="fore"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="anchor" type="fixed"><parent link="world"/><child link="mount"/>
<origin xyz="0 0 2"/></joint>
<joint name="elbow" type="{kind}"><parent link="mount"/><child link="fore"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="30" velocity="50"/>
<dynamics damping="{damping}" friction="{friction}"/></joint></robot>"""
INERTIA = 0.02 + 2.0 * 0.5**2
NOWHERE = (0.0, 0.0, 0.0)
UP = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
FREE = {"kind": "revolute", "damping": 0.0, "friction": 0.0}


def arm(make_world, motor, gravity=NOWHERE, physics="hold", **numbers):
    """Give a world with an arm, and the arm."""
    world = make_world(physics, gravity, motors=Motors({".*": motor}))
    world.spawn_urdf("arm", ARM.format(**{**FREE, **numbers}), UP)
    return world, world.model("arm")


def arm_with(file):
    """Give the arm with a profile that has a file of motors."""
    robot = replace(parse_urdf(ARM.format(**FREE)), given_profile=Profile(motors=file))
    return lump_fixed_joints(robot)


def command(position=0.0, velocity=0.0, stiffness=0.0, damping=0.0, effort=0.0):
    """Give a command to one joint."""
    numbers = position, velocity, stiffness, damping, effort
    return PdCommand(*(np.array([number]) for number in numbers))


@pytest.mark.both_engines
@pytest.mark.parametrize("armature", [0.0, 0.4])
def test_it_swings_as_a_spring_with_a_damper_and_a_rotor(make_world, armature):
    """X'' = -(k x + d x') / (I + armature), in closed form."""
    k, d = 60.0, 2.0
    world, model = arm(make_world, PdMotor(200.0, k, d, armature))
    world.set_joint_positions("arm", {"elbow": 0.5})
    world.engine.follow(model, np.array([0]), np.zeros(1), np.zeros(1))
    inertia = INERTIA + armature
    decay, rate = d / (2.0 * inertia), math.sqrt(k / inertia - (d / (2 * inertia)) ** 2)
    for _ in range(400):
        world.step()
        t = 1e-9 * world.time_ns
        wave = math.cos(rate * t) + decay / rate * math.sin(rate * t)
        wanted = 0.5 * math.exp(-decay * t) * wave
        assert model.position[0] == pytest.approx(wanted, abs=0.006)
        assert abs(world.engine.efforts(model)[0]) <= 30.0 + 1e-9


@pytest.mark.both_engines
def test_a_rotor_at_a_sliding_joint_resists_or_is_told(make_world, engine):
    world = make_world("hold", NOWHERE, motors=Motors({".*": PdMotor(armature=3.0)}))
    told = world.spawn_urdf("arm", ARM.format(**{**FREE, "kind": "prismatic"}), UP)
    world.drive(world.model("arm"), ["elbow"], command(effort=10.0))
    world.run(0.1)
    ignored = (
        "the armature of elbow is ignored: with PyBullet only joints that turn have one"
    )
    inertia = 2.0 if engine == "bullet" else 5.0
    assert told == ((ignored,) if engine == "bullet" else ())
    assert world.model("arm").velocity[0] == pytest.approx(1.0 / inertia, rel=1e-3)


@pytest.mark.both_engines
def test_it_sags_by_its_load_over_its_stiffness(make_world):
    world, model = arm(make_world, PdMotor(200.0, 90.0, 15.0), (0.0, 0.0, -9.8))
    world.run(4.0)
    sag = model.position[0]
    assert 90.0 * sag == pytest.approx(2.0 * 9.8 * 0.5 * math.cos(sag), rel=1e-3)
    assert world.engine.efforts(model)[0] == pytest.approx(-90.0 * sag, rel=1e-3)


@pytest.mark.both_engines
def test_a_look_for_contacts_leaves_the_efforts(make_world):
    world, model = arm(make_world, ServoMotor(), (0.0, 0.0, -9.8))
    world.run(0.1)
    assert world.engine.contacts() == set()
    assert world.engine.efforts(model)[0] == pytest.approx(-9.8, rel=1e-3)


@pytest.mark.both_engines
def test_a_damper_too_strong_for_the_step_stops_the_joint(make_world, engine):
    """Per step v' = v / (1 + d h / I), from more than the limit; 150 of 30 N m."""
    if engine == "bullet":
        pytest.skip("PyBullet's efforts do not change within a step")
    damping, velocity = 3000.0, 0.05
    world, model = arm(make_world, PdMotor())
    world.drive(model, ["elbow"], command(damping=damping))
    model.velocity[0] = velocity
    world.engine.write(model)
    for _ in range(3):
        world.step()
        velocity /= 1.0 + 0.001 * damping / INERTIA
        assert abs(world.engine.efforts(model)[0]) <= 30.0
        assert model.velocity[0] == pytest.approx(velocity, rel=0.01)


@pytest.mark.both_engines
def test_the_joint_keeps_its_friction_and_damping(make_world):
    """A constant effort against both: v = (effort - friction) / damping."""
    world, model = arm(
        make_world, PdMotor(), kind="continuous", friction=1.5, damping=2.0
    )
    world.drive(model, ["elbow"], command(effort=1.4))
    world.run(0.2)
    assert abs(model.velocity[0]) < 1e-3
    world.drive(model, ["elbow"], command(effort=5.5))
    world.run(3.0)
    assert model.velocity[0] == pytest.approx((5.5 - 1.5) / 2.0, rel=0.01)


def test_in_kinematic_a_controller_is_refused(make_world):
    world, model = arm(make_world, ServoMotor(), physics="kinematic")
    with pytest.raises(InvalidValueError, match="nothing drives the joints in kinem"):
        world.drive(model, ["elbow"], command(effort=1.0))


MOTORS = {
    "5020": ((0.139e-4, 0.017e-4, 0.169e-4), (1 + 46 / 18, 1 + 56 / 16)),
    "7520-14": ((0.489e-4, 0.098e-4, 0.533e-4), (4.5, 1 + 48 / 22)),
    "7520-22": ((0.489e-4, 0.109e-4, 0.738e-4), (4.5, 5.0)),
    "4010": ((0.068e-4, 0.0, 0.0), (5.0, 5.0)),
}
"""Moments of inertia of the turning parts in [kg m^2], and ratios of the stages."""

USED = {
    ("hip_pitch", "hip_yaw", "waist_yaw"): ("7520-14", 1),
    ("hip_roll", "knee"): ("7520-22", 1),
    ("ankle_pitch", "ankle_roll", "waist_roll", "waist_pitch"): ("5020", 2),
    ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"): ("5020", 1),
    ("wrist_roll",): ("5020", 1),
    ("wrist_pitch", "wrist_yaw"): ("4010", 1),
}
"""Motor and how many of it, by joints."""


def test_the_g1s_figures_follow_from_its_rotors_and_gears(make_world):
    folder = REPOSITORY / "config" / "robots" / "g1_29dof"
    motors, servos = (read_motors(folder / f"motors{n}.yaml") for n in ("_pd", ""))
    world = make_world("hold", motors=motors)
    world.spawn_urdf("g1", OUR_G1, UP, fixed_base=True)
    natural = 2.0 * math.pi * 10.0
    for name in world.model("g1").joint_names:
        stem = name.replace("left_", "").replace("right_", "")[: -len("_joint")]
        (used,) = [motor for joints, motor in USED.items() if stem in joints]
        (i1, i2, i3), (first, second) = MOTORS[used[0]]
        rotor = used[1] * (i1 * (first * second) ** 2 + i2 * second**2 + i3)
        motor = motors.of(name)
        assert motor.armature == pytest.approx(rotor, rel=1e-5), name
        assert motor.stiffness == pytest.approx(rotor * natural**2, rel=1e-5)
        assert motor.damping == pytest.approx(4.0 * rotor * natural, rel=1e-5)
        assert motor.effort == servos.of(name).effort


@pytest.mark.both_engines
def test_the_hanging_g1_comes_to_rest_on_its_pd_motors(make_world):
    """Plain torques of such gains let the wrists oscillate, without the rotors."""
    world = make_world("hold", motors="pd")
    pose = np.array([0.0, 0.0, 1.2, 0.0, 0.0, 0.0, 1.0])
    assert world.spawn_urdf("g1", OUR_G1, pose, fixed_base=True) == ()
    model = world.model("g1")
    elbows = {"left_elbow_joint": 1.0, "right_elbow_joint": 1.0}
    rows = np.array(model.joint_rows(elbows))
    world.engine.follow(model, rows, np.ones(2), np.zeros(2))
    world.run(3.0)
    assert np.abs(model.velocity).max() < 0.01
    assert np.abs(model.position[rows] - 1.0).max() < 0.15


def test_a_model_without_such_motors_has_those_of_its_file(make_world):
    world = make_world("hold", motors="pd")
    (told,) = world.spawn_urdf("arm", ARM.format(**FREE), UP)
    assert told == (
        "A robot without profile has no motors 'pd'. Known motors: the usual ones"
    )
    world.run(0.1)
    assert abs(world.model("arm").position[0]) < 1e-6


def test_with_a_wrong_file_of_motors_nothing_is_spawned(make_world, file):
    world = make_world("hold", NOWHERE)
    motors = file("elbow: {torque: 5}", "motors.yaml")
    with pytest.raises(MotorFileError, match="unknown key torque"):
        world.spawn("arm", arm_with(motors), UP)
    world.step()
    motors.write_text("elbow: {effort: 5}")
    world.spawn("arm", arm_with(motors), UP)
    world.step()
    assert world.engine.effort_limits(world.model("arm"))[0] == 5.0


def test_a_reset_keeps_the_motors_whatever_has_become_of_their_file(make_world, file):
    world = make_world("hold", NOWHERE)
    motors = file("elbow: {effort: 5}", "motors.yaml")
    world.spawn("arm", arm_with(motors), UP)
    motors.write_text("elbow: {torque: 5}")
    world.reset()
    world.step()
    assert world.engine.effort_limits(world.model("arm"))[0] == 5.0


@pytest.mark.both_engines
def test_gains_however_large_leave_the_robot_in_one_piece(make_world, engine):
    """First a spring, then a damper: contacts saw accelerations that it took away."""
    if engine == "bullet":
        pytest.skip("PyBullet's efforts do not change within a step")
    world = make_world("hold")
    world.spawn_urdf("g1", OUR_G1, np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0]))
    model, names = world.model("g1"), ["left_elbow_joint"]
    world.run(0.1)
    world.drive(model, names, command(0.5, stiffness=1e8))
    world.run(1.6)
    world.drive(model, names, command(0.5, damping=1e8))
    world.run(0.3)
    assert np.abs(model.velocity).max() < 10.0
    assert abs(model.pose[2] - 0.793) < 0.1
    assert world.engine.take_failure() == ""


@pytest.mark.parametrize("is_given", [True, False])
def test_a_pattern_of_no_joint_is_told(make_world, tmp_path, is_given):
    file = tmp_path / "motors.yaml"
    file.write_text("'.*_elbw_joint': {effort: 5}\nelbow: {effort: 5}\n")
    world = make_world("hold", NOWHERE, motors=read_motors(file) if is_given else None)
    told = world.spawn("arm", arm_with(file), UP)
    assert told == ("the file of motors has patterns of no joint: .*_elbw_joint",)


@pytest.mark.parametrize("motors", [None, "pd"])
def test_motors_of_this_package_have_no_pattern_of_no_joint(make_world, motors):
    """G1s with 23 joints have the motors of that with 29, of which some match none."""
    world = make_world("hold", motors=motors)
    told = world.spawn_urdf("g1", OUR_G1, UP)
    file = REPOSITORY / "config" / "robots" / "g1_29dof" / "motors.yaml"
    robot = parse_urdf(ARM.format(**FREE).replace("elbow", "left_knee_joint"))
    robot = replace(robot, given_profile=Profile(name="g1_23dof", motors=file))
    told += world.spawn("arm", lump_fixed_joints(robot), UP)
    assert not [note for note in told if "patterns" in note]
