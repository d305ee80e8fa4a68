"""Motors of joints, read from a file."""

import math
import re
from dataclasses import replace

import pytest
from conftest import REPOSITORY

from g1_description.errors import MotorFileError
from g1_description.motion.motors import ServoMotor, motors_of, read_motors
from g1_description.robot.urdf import parse_urdf

G1 = parse_urdf((REPOSITORY / "urdf" / "g1_29dof.urdf").read_text())
OURS = motors_of(G1)


@pytest.fixture
def file(tmp_path):
    """Give what writes a file of motors."""

    def write(text):
        path = tmp_path / "motors.yaml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("joint", G1.movable_joints, ids=lambda joint: joint.name)
def test_the_packages_file_has_a_motor_for_each_joint_of_the_g1(joint):
    """As strong as the vendor's files say, the newer of which has stronger hips."""
    motor = OURS.of(joint.name)
    assert motor.effort == (139.0 if "hip_roll" in joint.name else joint.effort)
    assert (motor.position_gain, motor.velocity_gain) == (0.1, 1.0)


@pytest.mark.parametrize("name", ["h1", ""])
def test_a_robot_without_a_profile_has_the_motors_of_its_urdf(name):
    """Whatever its joints are called: those of a G1 with 23 joints are not these."""
    assert motors_of(replace(G1, name=name)).of("left_knee_joint") == ServoMotor()


def test_other_joints_have_the_default_motor():
    assert OURS.of("wheel") == ServoMotor() == ServoMotor(math.inf, 0.1, 1.0)
    assert OURS.of("my_left_knee_joint_2") == ServoMotor()


def test_the_first_pattern_that_matches_the_whole_name_counts(file):
    motors = read_motors(
        file("left_.*: {effort: 3}\nleft_knee: {effort: 4}\nknee: {velocity_gain: 0}\n")
    )
    assert motors.of("left_knee") == ServoMotor(effort=3.0)
    assert motors.of("knee") == ServoMotor(velocity_gain=0.0)
    assert motors.of("knee_2") == ServoMotor()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("- knee", "must map patterns of joint names to numbers"),
        (
            "knee: 5",
            "'knee' must map some of kind, effort, position_gain, velocity_gain, "
            "stiffness, damping, armature to their values (got 5)",
        ),
        (
            "knee: {torque: 5}",
            "unknown key torque of 'knee', which is of kind servo. Known keys: kind",
        ),
        ("knee: {effort: -1}", "effort of 'knee' must be a number at least 0 (got -1)"),
        ("knee: {position_gain: 2}", "position_gain of 'knee' .* from 0 to 1 .got 2"),
        ("'(knee': {effort: 5}", "'(knee' is not a regular expression"),
    ],
)
def test_a_wrong_file_is_refused_in_a_sentence(file, text, problem):
    path = file(text)
    with pytest.raises(MotorFileError) as caught:
        read_motors(path)
    message = str(caught.value)
    assert message.startswith(f"The file of motors {path}: ")
    pattern = problem if ".*" in problem else re.escape(problem)
    assert re.search(pattern, message), message
    assert message.endswith(".")
    assert "\n" not in message
