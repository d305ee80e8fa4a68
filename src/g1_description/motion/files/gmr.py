"""Arrays of GMR, in a pickle or an npz: ``fps, root_pos, root_rot, dof_pos``.

TWIST, TWIST2, GMT and G1 Moves use the same. Traps:

- Quaternions are x y z w, which is checked: flat feet may show otherwise.
- Joints have no names, except in ``joint_names`` of a few tools. GMT's 23 are ASAP's.
- ``fps`` may be a scalar of numpy such as 29.878, and may be missing: GMR has 30 Hz.
- Some pickles have several such motions, in a dictionary or a list.
- Readers need ``local_body_pos`` and ``link_body_list``, too: GMR takes None, TWIST
  needs places of bodies relative to a root at the origin without turn.
"""

from __future__ import annotations

import numpy as np

from g1_description.motion.files.array_formats import Keys, array_format
from g1_description.motion.files.conventions import (
    of_robot,
)
from g1_description.motion.files.format import BATCH, OPEN, Writer, even_writer, number
from g1_description.motion.files.pickles import pickled
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import IDENTITY, rotate

MARKERS = {
    "left_toe_link": ("left_ankle_roll_link", (0.1, 0.0, -0.02)),
    "right_toe_link": ("right_ankle_roll_link", (0.1, 0.0, -0.02)),
    "head_mocap": ("torso_link", (0.0, 0.0, 0.4)),
}
"""Points that GMR's model of the G1 has as bodies, for which TWIST asks: the link and
the place on it in [m]."""


def _content(motion: Motion, base: np.ndarray, robot: Description, fps: float) -> bytes:
    """Write a pickle for GMR, TWIST and GMT, with the places of all links."""
    links, places = _local_bodies(motion, robot)
    content = {
        "fps": number(fps),
        "root_pos": base[:, :3],
        "root_rot": base[:, 3:],
        "dof_pos": motion.positions,
        "local_body_pos": places,
        "link_body_list": links,
    }
    return pickled(content)


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


FORMAT = array_format(
    "gmr",
    Keys("dof_pos", "root_pos", "root_rot"),
    OPEN,
    has_several=True,
    endings=(".pkl", ".pickle", ".p", ".npz"),
    assumed_rate=30.0,
    rate_of="the rate of most such files",
    writers={"gmr": Writer(".pkl", even_writer(_content, False, False))},
)
