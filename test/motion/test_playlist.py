"""The motions of a robot that are replaced before any state shows them."""

import numpy as np
import pytest

from g1_description.motion.motion import Motion
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
