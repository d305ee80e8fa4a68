"""Motions of HDMI: a folder with ``motion.npz`` and ``meta.json``.

The arrays are those of BeyondMimic; names and rate are in ``meta.json``. Traps: joints
are in MuJoCo's order in published files and in Isaac Lab's from the recorder, so names
count; some links are left out of the bodies, and objects are among them; velocities may
be all zero.
"""

from __future__ import annotations

from pathlib import Path

from g1_description.motion.files.bodies import Bodies, find_base
from g1_description.motion.files.conventions import (
    check_root,
    read_velocities,
)
from g1_description.motion.files.source import MotionSource, parsed
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.text import listed

ENDINGS = ()

ARRAYS = ("joint_pos", "body_pos_w", "body_quat_w")

NPZ, META = "motion.npz", "meta.json"


def recognise(source: MotionSource) -> bool:
    """Return whether it is such a folder, or the npz in it."""
    folder = source.path if source.is_folder else source.path.absolute().parent
    if not (folder / META).is_file():
        return False
    if source.is_folder:
        return (folder / NPZ).is_file()
    return {*ARRAYS} <= {*source.arrays} and "fps" not in source.arrays


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content, or no body is the base.
    """
    path = source.path / NPZ if source.is_folder else source.path.absolute()
    meta = parsed(MotionSource(Path(path.parent, META)).text, META)
    arrays = MotionSource(path).arrays
    joints, links = meta.names("joint_names"), meta.names("body_names")
    positions = arrays.numbers("joint_pos", None, len(joints))
    places = arrays.numbers("body_pos_w", len(positions), len(links), 3)
    turns = arrays.numbers("body_quat_w", len(positions), len(links), 4)
    check_root(links, robot)
    velocities = read_velocities(arrays, "joint_vel", positions)
    times, notes = meta.times(len(positions))
    objects = [link for link in links if link not in robot.link_names]
    if objects:
        notes += (
            f"Bodies that {robot.name} does not have are ignored: {listed(objects)}.",
        )
    bodies = Bodies(places, turns, links)
    base = find_base(source, robot, bodies, positions, [joints], "wxyz")
    notes += base.notes
    return Motion(times, joints, positions, velocities, base.poses, notes)
