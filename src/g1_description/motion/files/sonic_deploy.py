"""SONIC's pickle for deployment: motions by name, from which its folders are made.

Each has ``joint_pos, joint_vel, body_pos_w, body_quat_w, _body_indexes``. Traps:

- The 29 joints are in Isaac Lab's order, quaternions w x y z.
- There are 14 of the bodies; ``_body_indexes`` are Isaac Lab's, of which 0 is the root.
- There is no rate: 50 Hz by definition. Places may be all zero: there are none then.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.bodies import Bodies, find_base, links_of
from g1_description.motion.files.conventions import (
    ISAAC_JOINTS,
    isaac_joints,
    read_velocities,
)
from g1_description.motion.files.sonic import RATE
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

ENDINGS = (".pkl", ".pickle")

ARRAYS = ("joint_pos", "body_pos_w", "body_quat_w")


def recognise(source: MotionSource) -> bool:
    """Return whether a file has such motions."""
    return bool(names(source))


def names(source: MotionSource) -> Sequence[str]:
    """List the names of the motions."""
    return source.arrays.holding(*ARRAYS)


def read(source: MotionSource, robot: Description) -> Motion:
    """Read the motion that is chosen, or the only one.

    Raises:
        MotionError: If none is chosen, or an array has a wrong shape or content.
    """
    arrays = source.arrays.inside(source.chosen(names(source)))
    positions = arrays.numbers("joint_pos", None, len(ISAAC_JOINTS))
    n_samples = len(positions)
    velocities = read_velocities(arrays, "joint_vel", positions)
    places = arrays.numbers("body_pos_w", n_samples, None, 3)
    turns = arrays.numbers("body_quat_w", n_samples, places.shape[1], 4)
    numbers = [0.0]
    if "_body_indexes" in arrays:
        numbers = arrays.numbers("_body_indexes", places.shape[1]).tolist()
    if 0.0 not in numbers or not places.shape[1]:
        raise MotionError("The bodies have no root: none has the index 0.")
    known = dict(enumerate(links_of(robot, ISAAC_JOINTS)))
    links = [known.get(int(number), "") for number in numbers]
    links += [""] * (places.shape[1] - len(links))
    joints, bodies = isaac_joints(source), Bodies(places, turns, links)
    base = find_base(source, robot, bodies, positions, [joints], "wxyz")
    notes = base.notes
    if not base.poses[:, :3].any():
        zeros = "body_pos_w has only zeros for the root"
        notes += (f"{zeros}: the place of the base is unknown, and shown as 0.",)
    times = np.arange(n_samples)
    motion = Motion(times, joints, positions, velocities, base.poses, notes)
    return source.timed(motion, RATE, "the rate of SONIC's files")
