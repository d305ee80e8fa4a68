"""Quaternions agree with scipy and with the axioms of rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from g1_description.robot import rotation

SEEDS = st.integers(0, 2**32 - 1)
BATCHES = [(), (1,), (3, 1, 2)]


def random_quaternions(seed, shape=()):
    q = np.random.default_rng(seed).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


@pytest.mark.parametrize("shape", BATCHES)
@given(seed=SEEDS)
def test_products_are_scipys(shape, seed):
    a, b = random_quaternions(seed, shape), random_quaternions(seed + 1, shape)
    flat = Rotation.from_quat(a.reshape(-1, 4)) * Rotation.from_quat(b.reshape(-1, 4))
    product = rotation.multiply(a, b)
    assert product.shape == a.shape
    left = product.reshape(-1, 4)
    sign = np.sign(np.sum(left * flat.as_quat(), axis=-1, keepdims=True))
    np.testing.assert_allclose(left, sign * flat.as_quat(), atol=1e-12)


@given(SEEDS)
def test_vectors_turn_as_scipys(seed):
    q = random_quaternions(seed)
    vector = np.random.default_rng(seed).normal(size=3)
    expected = Rotation.from_quat(q).apply(vector)
    np.testing.assert_allclose(rotation.rotate(q, vector), expected, atol=1e-12)


@given(SEEDS)
def test_a_rotation_and_its_inverse_cancel(seed):
    q = random_quaternions(seed)
    identity = rotation.multiply(q, rotation.conjugate(q))
    np.testing.assert_allclose(identity, rotation.IDENTITY, atol=1e-12)


@given(st.tuples(*[st.floats(-3.2, 3.2)] * 3))
def test_roll_pitch_yaw_turn_about_fixed_axes(rpy):
    expected = Rotation.from_euler("xyz", rpy).as_quat()
    q = rotation.from_rpy(np.array(rpy))
    np.testing.assert_allclose(np.abs(q @ expected), 1.0, atol=1e-12)


@given(SEEDS, st.sampled_from([None, np.pi / 2, -np.pi / 2]))
def test_roll_pitch_yaw_come_back(seed, pitch):
    q = random_quaternions(seed)
    if pitch is not None:
        roll, yaw = np.random.default_rng(seed).uniform(-3, 3, 2)
        q = rotation.from_rpy(np.array([roll, pitch, yaw]))
    again = rotation.from_rpy(rotation.axes_to_rpy(rotation.to_axes(q)))
    np.testing.assert_allclose(np.abs(again @ q), 1.0, atol=1e-12)


@given(SEEDS, st.floats(-3.14, 3.14), st.floats(0.0, 3.14), st.sampled_from([1, -1]))
def test_swing_and_twist_are_the_turns_that_were_made(seed, angle, swing, sign):
    axis = random_quaternions(seed)[:3]
    axis = axis / np.linalg.norm(axis)
    across = np.cross(axis, random_quaternions(seed + 1)[:3])
    turns = [axis * angle, across / np.linalg.norm(across) * swing]
    twist, swung = (Rotation.from_rotvec(turn) for turn in turns)
    q = sign * (swung * twist).as_quat()
    found, residual = rotation.swing_twist(q, axis)
    # Near a half turn of the swing little of the twist is left in the numbers.
    np.testing.assert_allclose(found, angle, atol=1e-12 / np.cos(0.5 * swing))
    np.testing.assert_allclose(residual, np.sin(0.5 * swing) ** 2, atol=1e-12)


@given(SEEDS)
def test_about_no_axis_there_is_no_twist(seed):
    q = random_quaternions(seed)
    twist, residual = rotation.swing_twist(q, np.zeros(3))
    assert twist == 0.0
    np.testing.assert_allclose(residual, np.sum(q[:3] ** 2), atol=1e-12)


@given(SEEDS)
def test_the_relative_rotation_undoes_the_first_one(seed):
    q_a_b, q_b_c = random_quaternions(seed), random_quaternions(seed + 1)
    found = rotation.relative(q_a_b, rotation.multiply(q_a_b, q_b_c))
    np.testing.assert_allclose(found, q_b_c, atol=1e-12)


@given(SEEDS, st.floats(0.0, 3.14))
def test_the_angle_between_is_scipys(seed, angle):
    q_a = random_quaternions(seed)
    axis = random_quaternions(seed + 1)[:3]
    turn = rotation.from_axis_angle(axis / np.linalg.norm(axis), angle)
    q_b = rotation.multiply(q_a, turn)
    np.testing.assert_allclose(rotation.angle_between(q_a, -q_b), angle, atol=1e-9)


def test_a_zero_quaternion_means_identity_and_a_long_one_is_normalised():
    given_ones = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 2.0]])
    np.testing.assert_array_equal(
        rotation.normalized(given_ones), [rotation.IDENTITY] * 2
    )


def test_the_same_turns_have_the_same_bits_wherever_they_lie_in_memory():
    rng = np.random.default_rng(0)
    a = rotation.normalized(rng.normal(size=(256, 4)))
    b = rotation.normalized(a + 1e-2 * rng.normal(size=a.shape))
    first, kept = rotation.shorter_turn(a, b), []
    for _ in range(100):
        kept.append(np.zeros(rng.integers(1, 3000)))
        again = rotation.shorter_turn(a, b)
        kept.append(again)
        np.testing.assert_array_equal(again[1], first[1])


@given(SEEDS, st.sampled_from([-1.0, 0.0, 0.3, 1.0]))
def test_the_shortest_turn_brings_a_direction_to_another(seed, share):
    """Also where both are the same, or opposite."""
    a, b = np.random.default_rng(seed).normal(size=(2, 4, 3))
    b = a if share == 1.0 else -a if share == -1.0 else b + share * a
    a, b = (each / np.linalg.norm(each, axis=1)[:, np.newaxis] for each in (a, b))
    turns = rotation.turn_between(a, b)
    np.testing.assert_allclose(Rotation.from_rotvec(turns).apply(a), b, atol=1e-9)
    cosine = np.clip((a * b).sum(axis=1), -1.0, 1.0)
    np.testing.assert_allclose(
        np.linalg.norm(turns, axis=1), np.arccos(cosine), 1e-6, 1e-7
    )
