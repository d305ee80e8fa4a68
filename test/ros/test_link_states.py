"""The wire format is genpy's own, and garbage raises."""

import io
import struct

import numpy as np
import pytest
from g1_description.msg import MotorCommands
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import JointState

from g1_description.errors import WireFormatError
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import COMMAND_FIELDS
from g1_description.ros.wire import (
    JointStateEncoder,
    LinkStatesDecoder,
    LinkStatesEncoder,
    MotorArrays,
    MotorCommandsArrays,
    encode_motors,
)

NAMES = st.lists(st.text(max_size=12), max_size=6)
SEEDS = st.integers(0, 2**32 - 1)


def random_message(names, seed):
    random = np.random.default_rng(seed)
    return (
        names,
        random.normal(size=(len(names), 7)),
        random.normal(size=(len(names), 6)),
    )


def genpy_bytes(names, poses, twists):
    """Serialise with the generated message class: the outside oracle."""
    gazebo_msgs = pytest.importorskip("gazebo_msgs.msg", reason="gazebo_msgs not built")
    from g1_description.ros.conversions import pose_from_array, twist_from_array

    message = gazebo_msgs.LinkStates(
        name=names,
        pose=[pose_from_array(pose) for pose in poses],
        twist=[twist_from_array(twist) for twist in twists],
    )
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


@settings(max_examples=20)
@given(NAMES, SEEDS)
def test_bytes_are_those_of_the_message_class(names, seed):
    message = random_message(names, seed)
    assert LinkStatesEncoder().encode(*message) == genpy_bytes(*message)


@settings(max_examples=20)
@given(st.lists(st.tuples(NAMES, SEEDS), max_size=5))
def test_what_is_written_is_read_also_when_names_change(messages):
    encoder, decoder = LinkStatesEncoder(), LinkStatesDecoder()
    for names, seed in messages:
        names, poses, twists = random_message(names, seed)
        read = decoder.decode(encoder.encode(tuple(names), poses, twists))
        assert list(read.names) == names
        np.testing.assert_array_equal(read.poses, poses)
        np.testing.assert_array_equal(read.twists, twists)


def random_motors(models, seed):
    """Make joints of models, some without efforts or a commanded base."""
    random = np.random.default_rng(seed)

    def perhaps(n):
        return random.normal(size=n) if n and random.random() < 0.5 else None

    return {
        model: MotorArrays(
            model,
            tuple(joints),
            *random.normal(size=(2, len(joints))),
            perhaps(len(joints)),
            random.normal(size=len(joints)),
            perhaps(7),
            random.random() < 0.5,
        )
        for model, joints in models.items()
    }


def stamped_bytes(names, poses, twists, stamp, frame="world", motors=None):
    """Serialise a SimulatorState with the generated message class."""
    from g1_description.msg import MotorStates, SimulatorState
    from std_msgs.msg import Header

    from g1_description.ros import conversions

    message = SimulatorState(
        name=names,
        pose=[conversions.pose_from_array(pose) for pose in poses],
        twist=[conversions.twist_from_array(twist) for twist in twists],
    )
    message.header.stamp = conversions.stamp_from_ns(stamp)
    message.header.frame_id = frame
    for one in (motors or {}).values():
        numbers = [[] if part is None else part.tolist() for part in one[2:6]]
        base = np.zeros(7) if one.commanded_base is None else one.commanded_base
        message.motors.append(
            MotorStates(
                Header(),
                one.model,
                one.names,
                *numbers,
                one.commanded_base is not None,
                conversions.pose_from_array(base),
                one.is_sample,
            )
        )
        message.motors[-1].header.stamp = message.header.stamp
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def same(one, other):
    """Whether the numbers of two models are equal."""
    parts = zip(one, other)
    return all(np.array_equal(a, b) and type(a) is type(b) for a, b in parts)


STAMPS = st.integers(0, 2**32 * 10**9 - 1)
MODELS = st.dictionaries(st.text(max_size=5), NAMES, max_size=3)


@settings(max_examples=20)
@given(NAMES, SEEDS, STAMPS, st.text(max_size=9), st.lists(MODELS, min_size=1))
def test_a_simulator_state_is_read_with_its_stamp(names, seed, stamp, frame, models):
    states = random_message(names, seed)
    decoder = LinkStatesDecoder()
    for number, one in enumerate(models):
        motors = random_motors(one, seed + number)
        data = stamped_bytes(*states, stamp, frame, motors)
        found, read, read_motors = decoder.decode_stamped(data)
        assert found == stamp
        assert list(read.names) == names
        np.testing.assert_array_equal(read.poses, states[1])
        np.testing.assert_array_equal(read.twists, states[2])
        assert read_motors.keys() == motors.keys()
        assert all(same(read_motors[model], motors[model]) for model in motors)
        written = b"".join(encode_motors(stamp, part) for part in motors.values())
        assert data.endswith(written)


@settings(max_examples=20)
@given(NAMES, SEEDS, MODELS, st.data())
def test_a_simulator_state_cut_short_raises(names, seed, models, data):
    motors = random_motors(models, seed)
    whole = stamped_bytes(*random_message(names, seed), 5, motors=motors)
    cut = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(WireFormatError):
        LinkStatesDecoder().decode_stamped(whole[:cut])
    with pytest.raises(WireFormatError, match="1 bytes follow"):
        LinkStatesDecoder().decode_stamped(whole + b"x")


@settings(max_examples=20)
@given(NAMES, SEEDS, st.data())
def test_a_message_cut_short_raises(names, seed, data):
    whole = LinkStatesEncoder().encode(*random_message(names, seed))
    decoder = LinkStatesDecoder()
    decoder.decode(whole)
    cut = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(WireFormatError):
        decoder.decode(whole[:cut])
    assert list(decoder.decode(whole).names) == names


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "ends after 0 bytes"),
        (struct.pack("<II", 1, 1000), "A name of 1000 bytes"),
        (struct.pack("<II", 0, 1), "0 names, but 1 rows"),
        (struct.pack("<III", 0, 0, 0) + b"x", "1 bytes follow"),
    ],
)
def test_what_is_wrong_is_told(data, words):
    with pytest.raises(WireFormatError, match=words):
        LinkStatesDecoder().decode(data)


def test_joint_states_are_counted_and_those_of_the_message_class():
    encoder, names = JointStateEncoder(), ("elbow", "schultergelenk_ä")
    for number, joints in enumerate((names, names, ("elbow",), ()), 1):
        stamp = 10**10 * number + 7
        positions, velocities = np.arange(len(joints)) + 0.5, -np.arange(len(joints))
        written, wanted = io.BytesIO(), io.BytesIO()
        encoder.encode(RobotState(stamp, joints, positions, velocities)).serialize(
            written
        )
        message = JointState(name=joints, position=positions, velocity=velocities)
        message.header.seq = number
        message.header.stamp.secs, message.header.stamp.nsecs = 10 * number, 7
        message.serialize(wanted)
        assert written.getvalue() == wanted.getvalue()


def test_commands_to_motors_are_those_of_the_message_class():
    both = (["elbow", "gelenk_ä"], [0.5, -1.0]), (["elbow", "gelenk_ä"], [])
    for names, numbers in (*both, both[0], (["knee"], [2.0]), ([], [])):
        given = MotorCommands("g1", names, numbers, [], numbers, [], numbers)
        written = io.BytesIO()
        given.serialize(written)
        read = MotorCommandsArrays().deserialize(written.getvalue())
        assert (read.model_name, read.joint_names) == ("g1", names)
        for field in COMMAND_FIELDS:
            assert getattr(read, field).tolist() == getattr(given, field)
