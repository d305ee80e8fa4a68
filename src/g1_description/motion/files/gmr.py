"""Arrays of GMR, in a pickle or an npz: ``fps, root_pos, root_rot, dof_pos``.

TWIST, TWIST2, GMT and G1 Moves use the same. Traps:

- Quaternions are x y z w, which is checked: flat feet may tell otherwise.
- Joints have no names, except in ``joint_names`` of a few tools. GMT's 23 are ASAP's.
- ``fps`` may be a scalar of numpy such as 29.878, and may be missing: GMR has 30 Hz.
- Some pickles have several such motions, in a dictionary or a list.
- Readers need ``local_body_pos`` and ``link_body_list``, too: GMR takes None, TWIST
  needs places of bodies relative to a root at the origin without turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.arrays import Arrays
from g1_description.motion.files.bodies import bodies_in, find_base
from g1_description.motion.files.conventions import (
    base_of,
    names_of_columns,
    of_robot,
    w_last,
)
from g1_description.motion.files.pickles import pickled
from g1_description.motion.files.source import MotionSource
from g1_description.motion.files.writing import BATCH, number, prepared
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import IDENTITY, rotate

ENDINGS = (".pkl", ".pickle", ".p", ".npz")

ARRAYS = ("root_pos", "root_rot", "dof_pos")
"""Places and quaternions of the base, and positions of the joints."""

NAMES = ("joint_names", "dof_names")

MARKERS = {
    "left_toe_link": ("left_ankle_roll_link", (0.1, 0.0, -0.02)),
    "right_toe_link": ("right_ankle_roll_link", (0.1, 0.0, -0.02)),
    "head_mocap": ("torso_link", (0.0, 0.0, 0.4)),
}
"""Points that GMR's model of the G1 has as bodies, for which TWIST asks: the link and
the place on it in [m]."""

DEFAULT_RATE = 30.0
"""Of files without ``fps``, in [Hz]."""

WITHOUT_VELOCITIES = (
    "This format has no velocities: those of the motion are not written."
)


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays, or motions that have them."""
    return {*ARRAYS} <= {*source.arrays} or bool(names(source))


def names(source: MotionSource) -> Sequence[str]:
    """List the names of the motions, their numbers if they are a list."""
    return source.arrays.holding(*ARRAYS)


def read(source: MotionSource, robot: Description) -> Motion:
    """Read the motion that is chosen, or the only one.

    Raises:
        MotionError: If none is chosen, or an array has a wrong shape or content.
    """
    arrays = source.arrays
    if not {*ARRAYS} <= {*arrays}:
        arrays = arrays.inside(source.chosen(names(source)))
    return read_arrays(source, arrays, robot, ARRAYS)


def read_arrays(
    source: MotionSource, arrays: Arrays, robot: Description, keys: Sequence[str]
) -> Motion:
    """Read a motion from arrays that differ only in their keys.

    Args:
        source: The file.
        arrays: Those of the motion, with its rate ``fps`` or without.
        robot: The robot.
        keys: Of places, quaternions x y z w and joints.

    Raises:
        MotionError: If an array has a wrong shape or content.
    """
    place, turn, joints = keys
    positions = arrays.numbers(joints, None, None)
    n_samples, n_joints = positions.shape
    places = arrays.numbers(place, n_samples, 3)
    turns = arrays.numbers(turn, n_samples, 4)
    named = [arrays.names(key) for key in NAMES if key in arrays]
    notes: tuple[str, ...] = ()
    if not named:
        names, notes = names_of_columns(source, positions, robot)
    elif len(named[0]) == n_joints:
        names = named[0]
    else:
        raise MotionError(f"There are {len(named[0])} names for {n_joints} joints.")
    base = base_of(places, turns, source.options.order or "xyzw")
    bodies = bodies_in(arrays, n_samples)
    if bodies is not None and not source.is_settled:
        found = (places, turns)
        settled = find_base(source, robot, bodies, positions, [names], "xyzw", found)
        base, notes = settled.poses, (*notes, *settled.notes)
    motion = Motion(np.arange(n_samples), names, positions, None, base, notes)
    if not source.options.order and not source.is_settled:
        motion = w_last(motion, robot, is_told=True)
    return with_rate(source, arrays, motion)


def with_rate(source: MotionSource, arrays: Arrays, motion: Motion) -> Motion:
    """Give times to the samples of a motion, from ``fps`` if it is there."""
    if "fps" not in arrays or arrays["fps"] is None:
        return source.timed(motion, DEFAULT_RATE, "the rate of most such files")
    times, notes = arrays.times(len(motion.times))
    return replace(motion, times=times, notes=(*motion.notes, *notes))


def write(
    motion: Motion, robot: Description, rate: float | None
) -> tuple[bytes, tuple[str, ...]]:
    """Write a pickle for GMR, TWIST and GMT, with the places of all links.

    Arguments and errors are those of ``writing.prepared``.

    Returns:
        The file's content, and messages on differences from the motion.
    """
    found, fps, notes = prepared(motion, robot, rate, tells=False)
    if motion.velocities is not None:
        notes = (*notes, WITHOUT_VELOCITIES)
    base = found.base_poses
    assert base is not None
    links, places = _local_bodies(found, robot)
    content = {
        "fps": number(fps),
        "root_pos": base[:, :3],
        "root_rot": base[:, 3:],
        "dof_pos": found.positions,
        "local_body_pos": places,
        "link_body_list": links,
    }
    return pickled(content), notes


def _local_bodies(motion: Motion, robot: Description) -> tuple[list[str], np.ndarray]:
    """Place links and ``MARKERS`` relative to a root at the origin without turn.

    Returns:
        Their names, and places in [m] as float32, shape (n_samples, n_bodies, 3).
    """
    links = list(robot.link_names)
    markers = {
        name: marker
        for name, marker in MARKERS.items()
        if name not in links and marker[0] in links
    }
    rows = [links.index(parent) for parent, _ in markers.values()]
    offsets = np.reshape([offset for _, offset in markers.values()], (-1, 3))
    positions = of_robot(motion.joint_names, motion.positions, robot)
    kinematics = Kinematics(robot)
    n_samples = len(positions)
    places = np.empty((n_samples, len(links) + len(markers), 3), np.float32)
    for begin in range(0, n_samples, BATCH):
        part = slice(begin, begin + BATCH)
        still = np.tile([0.0, 0.0, 0.0, *IDENTITY], (len(positions[part]), 1))
        poses = kinematics.link_poses(still, positions[part])
        places[part, : len(links)] = poses[..., :3]
        turned = rotate(poses[:, rows, 3:], offsets)
        places[part, len(links) :] = poses[:, rows, :3] + turned
    return [*links, *markers], places
