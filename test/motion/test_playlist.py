"""The motions of a robot that are replaced before any state shows them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from g1_description.motion.motion import Motion, sample
from g1_description.motion.playlist import Playlist, Setpoint

PRESENT = Setpoint(np.arange(1), np.zeros(1), np.zeros(1))
ELBOW = Motion(np.arange(2.0), ("elbow",), np.zeros((2, 1)))


@pytest.fixture
def unseen():
    return []


@pytest.fixture
def playlist(unseen):
    return Playlist(["elbow"], lambda: unseen.append(1))


def test_a_motion_that_a_newer_one_replaces_before_it_begins_was_unseen(
    playlist, unseen
):
    playlist.add(ELBOW, 5)
    playlist.add(ELBOW, 5)
    assert len(unseen) == 1


def test_a_motion_that_a_newer_one_replaces_when_it_begins_was_unseen(playlist, unseen):
    playlist.add(ELBOW, 5)
    playlist.add(ELBOW, 6)
    assert not unseen
    playlist.begin(6, PRESENT)
    assert len(unseen) == 1


def test_a_motion_that_was_seen_is_not_counted(playlist, unseen):
    playback = playlist.add(ELBOW, 5)
    playlist.begin(5, PRESENT)
    assert playback.reaches_sample(5)
    playlist.add(ELBOW, 6)
    playlist.begin(6, PRESENT)
    assert playback.is_empty
    assert not unseen


def test_a_motion_that_is_cancelled_is_not_counted(playlist, unseen):
    playback = playlist.add(ELBOW, 5)
    playlist.release([0])
    assert playback.is_empty
    assert not unseen


MS = 1_000_000
STEPS = [*[1] * 150, 5, *[2] * 70, -60, *[1] * 80, 0, 0, 7, *[1] * 3]
"""Steps from one question to the next, in [ms]."""


def test_setpoints_are_those_of_their_times_however_they_are_asked_for():
    """Configurations of steady steps are interpolated ahead."""
    rng = np.random.default_rng(3)
    turns = Rotation.from_rotvec(rng.normal(size=(9, 3))).as_quat()
    motion = Motion(
        np.linspace(0.0, 0.6, 9),
        ("elbow", "wrist"),
        rng.normal(size=(9, 2)),
        rng.normal(size=(9, 2)),
        np.hstack([rng.normal(size=(9, 3)), turns]),
    )
    playlist = Playlist(["wrist", "knee", "elbow"])
    playback = playlist.add(motion, 1000 * MS)
    playlist.begin(1000 * MS, Setpoint(np.arange(3), np.zeros(3), np.zeros(3)))
    columns, time = [0, 1], 1000
    for number, step in enumerate(STEPS):
        time += step
        if number == 100:
            playlist.release([2])
            columns = [1]
        found = playback.setpoint(time * MS)
        wanted = sample(motion, 1e-3 * (time - 1000))
        np.testing.assert_allclose(
            found.positions, wanted.positions[columns], atol=1e-12
        )
        np.testing.assert_allclose(
            found.velocities, wanted.velocities[columns], atol=1e-9
        )
        np.testing.assert_allclose(found.base_pose, wanted.base_poses, atol=1e-12)
        np.testing.assert_allclose(found.base_twist, wanted.base_twists, atol=1e-9)
