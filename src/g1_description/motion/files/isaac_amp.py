"""Arrays of Isaac Lab's AMP motions in an npz (humanoid_amp, AMASS for the G1).

``fps, dof_names, body_names, dof_positions, dof_velocities, body_positions,
body_rotations``; quaternions are w x y z. Traps: joints are in any order, and bodies
are any of the robot's in any order, so names count; the base is the body of its name.
"""

from __future__ import annotations

from g1_description.motion.files.bodies import Bodies, find_base
from g1_description.motion.files.conventions import (
    check_root,
    read_velocities,
)
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

ENDINGS = (".npz",)

ARRAYS = ("dof_names", "body_names", "dof_positions", "body_positions")


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays."""
    return {*ARRAYS} <= {*source.arrays}


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content, or no body is the base.
    """
    arrays = source.arrays
    joints, links = arrays.names("dof_names"), arrays.names("body_names")
    positions = arrays.numbers("dof_positions", None, len(joints))
    places = arrays.numbers("body_positions", len(positions), len(links), 3)
    turns = arrays.numbers("body_rotations", len(positions), len(links), 4)
    check_root(links, robot)
    velocities = read_velocities(arrays, "dof_velocities", positions)
    times, notes = arrays.times(len(positions))
    bodies = Bodies(places, turns, links)
    base = find_base(source, robot, bodies, positions, [joints], "wxyz")
    notes += base.notes
    return Motion(times, joints, positions, velocities, base.poses, notes)
