"""The motions of a robot, sampled at the times of its states."""

import numpy as np
from scipy.spatial.transform import Rotation

from g1_description.motion.motion import Motion, sample
from g1_description.motion.playlist import Playlist, Setpoint

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
