"""The figures of a motion: its way, speeds, contacts and energy."""

import numpy as np
import pytest
from checked import ARM, POST, post_motion

from g1_description import Robot
from g1_description.motion.motion import Motion
from g1_description.robot.transform import compose, inverse
from g1_description.sim.standing import standing_base

MASS = 10.5


@pytest.fixture(scope="module")
def post():
    return Robot(POST)


def moved(times, ways):
    """Move the post upright along positions, shape (n, 3); it lies at height 0.05."""
    base = np.tile([0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0], (len(times), 1))
    base[:, :3] += ways
    return Motion(times, (ARM,), np.zeros((len(times), 1)), base_poses=base)


def test_a_way_there_and_back(post):
    """A circle: its length, the speed, and no energy at a constant height."""
    times = np.linspace(0.0, 4.0, 401)
    turn = np.pi / 2.0 * times
    ways = 0.5 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    figures = post.check(moved(times, ways)).figures
    assert figures["duration"] == 4.0
    assert figures["root_path"] == pytest.approx(np.pi, rel=1e-4)
    assert figures["root_speed.max"] == pytest.approx(np.pi / 4.0, rel=1e-4)
    assert figures["joint_speed.max"] == 0.0
    assert figures["largest_drift"] == pytest.approx(1.0, rel=1e-3)
    assert figures["energy"] == pytest.approx(0.0, abs=0.05)
    assert figures["contact_share"] == 1.0


def test_a_foot_that_stays_at_all_samples_does_not_drift():
    """Between samples joints move on lines, and the foot a little there and back."""
    g1 = Robot()
    times = np.arange(26) / 25.0
    bend = 0.9 * np.clip(times, 0.0, 0.8) / 0.8
    positions = np.zeros((len(times), len(g1.joint_names)))
    for joint, factor in (("hip_pitch", -1.0), ("knee", 2.0), ("ankle_pitch", -1.0)):
        for side in ("left", "right"):
            column = g1.joint_names.index(f"{side}_{joint}_joint")
            positions[:, column] = factor * bend
    feet = g1.link_poses(positions)["left_ankle_roll_link"]
    start = standing_base(g1.description, {})
    stays = g1.link_poses(np.zeros(len(g1.joint_names)), start)["left_ankle_roll_link"]
    bases = compose(stays, inverse(feet))
    motion = Motion(times, g1.joint_names, positions, base_poses=bases)
    places = g1.link_poses(positions, bases)["left_ankle_roll_link"]
    assert np.abs(places - stays).max() < 1e-9
    verdict = g1.check(motion, only=["drift"])
    assert verdict.findings == ()
    assert verdict.figures["largest_drift"] < 2e-5  # on its way there and back


def test_energy_is_what_is_lifted(post):
    """And what is lowered again is not counted; meanwhile nothing touches the floor."""
    times = np.linspace(0.0, 10.0, 501)
    height = 0.4 * np.sin(np.pi * np.clip((times - 3.0) / 4.0, 0.0, 1.0)) ** 2
    ways = np.stack([0.0 * times + 7.0, 0.0 * times, height], axis=1)
    figures = post.check(moved(times, ways)).figures
    assert figures["energy"] == pytest.approx(MASS * 9.8 * 0.4, rel=0.01)
    assert figures["root_path"] == pytest.approx(0.8, rel=1e-3)
    assert figures["contact_share"] == pytest.approx(0.6, abs=0.1)


def test_energy_of_a_turning_robot(post):
    """Turned about the y axis, far from the origin, from rest to rest."""
    times = np.linspace(0.0, 10.0, 501)
    s = np.clip((times - 3.0) / 4.0, 0.0, 1.0)
    angle = 8.0 * (10 * s**3 - 15 * s**4 + 6 * s**5)
    motion = moved(times, np.tile([9.0, -4.0, 0.0], (len(times), 1)))
    motion.base_poses[:, 4] = np.sin(angle / 2.0)
    motion.base_poses[:, 6] = np.cos(angle / 2.0)
    speed = 8.0 * 30.0 * (s * (1.0 - s)) ** 2 / 4.0
    inertia, arm = 0.11 + 0.5 * 0.15**2, 0.5 * 0.15
    energy = 0.5 * inertia * speed**2 + 9.8 * arm * np.cos(angle)
    gained = np.maximum(np.diff(energy), 0.0).sum()
    figures = post.check(motion).figures
    assert figures["energy"] == pytest.approx(gained, rel=0.02)


def test_one_foot_is_contact():
    """And both are no more: the share of the time, not of the feet."""
    robot = Robot()
    positions = robot.positions({"left_hip_pitch_joint": -0.8, "left_knee_joint": 1.4})
    named = dict(zip(robot.joint_names, positions))
    base = standing_base(robot.description, named)
    times = np.linspace(0.0, 1.0, 31)
    motion = robot.trajectory(
        times, np.tile(positions, (31, 1)), base=np.tile(base, (31, 1))
    )
    verdict = robot.check(motion)
    assert {*verdict.floor_contacts} == {"right_ankle_roll_link"}
    assert verdict.figures["contact_share"] == pytest.approx(1.0)


def test_without_a_base_there_is_no_way(post):
    motion = post_motion()
    alone = Motion(motion.times, motion.joint_names, motion.positions)
    figures = post.check(alone).figures
    assert {"root_path", "root_speed.max", "contact_share", "energy"}.isdisjoint(
        figures
    )
    assert "energy" in post.check(alone, fixed_base=True).figures
