"""Arrays of BeyondMimic, mjlab and unitree_rl_lab in an npz; also written.

``fps, joint_pos, joint_vel, body_pos_w, body_quat_w``; body 0 is the root, unless
``body_names`` say otherwise; quaternions are w x y z. Traps:

- Isaac Lab (whole_body_tracking, unitree_rl_lab) orders joints and bodies breadth
  first, MuJoCo (mjlab) as in the file, and the file does not say which. The order
  follows from ``joint_names``, which this package writes, or from the positions of the
  bodies.
- Unitree's deployed program reads float32 whatever the type is, so all is float32 in
  files for training. They need all six arrays and ``fps`` of shape (1,).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.bodies import Bodies, find_base
from g1_description.motion.files.conventions import (
    JOINT_ORDERS,
    breadth_first,
    layouts,
    names_of_columns,
)
from g1_description.motion.files.format import (
    Format,
    Writer,
    bodies,
    even,
    npz,
    number,
    prepared,
    usual_joints,
    velocities_of,
)
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import MAX_SAMPLES, Motion
from g1_description.robot.description import Description
from g1_description.text import MAX_NAME

ARRAYS = ("fps", "joint_pos", "body_pos_w", "body_quat_w")

OVERHEAD = 20_000
"""Most bytes of an npz without numbers and names."""

NO_BASE = "An npz needs base poses, and this motion has none; write .csv."

UNKNOWN_ORDER = "The joint order is unknown; assuming that of the robot's file."

CONTROL_RATE = 50.0
"""Samples per second at which both trainers step, in [Hz]."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays; rate, velocities and names may miss."""
    return {*ARRAYS[1:]} <= {*source.arrays}


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content, or there is no rate.
    """
    arrays = source.arrays
    positions = arrays.numbers("joint_pos", None, None)
    n_samples, n_joints = positions.shape
    places = arrays.numbers("body_pos_w", n_samples, None, 3)
    turns = arrays.numbers("body_quat_w", n_samples, places.shape[1], 4)
    velocities = None
    if "joint_vel" in arrays:
        velocities = arrays.numbers("joint_vel", *positions.shape)
    if not places.shape[1]:
        raise MotionError("body_pos_w must have at least one body, the root.")
    named = links = None
    if "joint_names" in arrays:
        named = arrays.names("joint_names")
        if len(named) != n_joints:
            raise MotionError(
                f"joint_names has {len(named)} names for {n_joints} joints."
            )
    lacking: tuple[str, ...] = ()
    if "body_names" in arrays:
        links = arrays.names("body_names")[: places.shape[1]]
        if links and robot.root not in links:
            lacking = (
                f"The bodies lack the base, {robot.root}: assuming the first one, "
                f"{links[0][:MAX_NAME]}.",
            )
    bodies = Bodies(places, turns, links)
    orders = [named] if named else _orders(source, n_joints, robot)
    base = find_base(source, robot, bodies, positions, orders, "wxyz")
    names, notes = base.joint_names, base.notes
    if named is None and not base.joints_are_known:
        names, of_joints = names_of_columns(source, positions, robot)
        unknown = () if source.options.joint_order else (UNKNOWN_ORDER,)
        notes = (*of_joints, *unknown, *notes)
    elif named is None and names not in layouts(n_joints, robot):
        notes = ("Joint order: Isaac Lab.", *notes)
    notes = (*notes, *lacking)
    times = np.arange(n_samples)
    motion = Motion(times, names, positions, velocities, base.poses, notes)
    return arrays.timed(motion)


def _orders(
    source: MotionSource, n_joints: int, robot: Description
) -> list[tuple[str, ...]]:
    """List the possible orders of unnamed joints."""
    found = layouts(n_joints, robot)
    isaac = [breadth_first(robot, names) for names in found]
    isaac = [order for order in isaac if len(order) == n_joints]
    by_name = dict(zip(JOINT_ORDERS, (found, isaac)))
    return by_name.get(source.options.joint_order or "", [*found, *isaac])


def most_samples(joints: Sequence[str], has_base: bool, size: int) -> int:
    """Return the largest number of samples of a file.

    Args:
        joints: Names of the joints, which have velocities.
        has_base: Whether there is a base.
        size: Largest file size in bytes.

    Raises:
        MotionError: If there is no base.
    """
    if not has_base:
        raise MotionError(NO_BASE)
    n_joints, n_bodies = len(joints), len(joints) + 1
    names = 4 * n_joints * max(map(len, joints), default=0)
    sample = 2 * 8 * n_joints + (7 * 8 + 6 * 4) * n_bodies
    return min((size - OVERHEAD - names) // sample, MAX_SAMPLES)


def write(
    motion: Motion, robot: Description, rate: float | None
) -> tuple[bytes, tuple[str, ...]]:
    """Write a motion with evenly spaced times from zero.

    Args:
        motion: With a base; joints missing in it are at zero.
        robot: The robot.
        rate: Samples per second, in [Hz]; None: those of the motion, on average.

    Returns:
        The file's content, and messages on differences from the motion.

    Raises:
        MotionError: If it has no base or too many samples.
    """
    if motion.base_poses is None:
        raise MotionError(NO_BASE)
    evenly, fps, notes = even(motion, rate)
    arrays = _arrays(evenly, robot)
    for name in ("body_lin_vel_w", "body_ang_vel_w"):
        arrays[name] = arrays[name].astype(np.float32)
    if evenly.velocities is None:
        del arrays["joint_vel"]
    names = np.array(evenly.joint_names, dtype=str)
    return npz({"fps": np.array([fps]), **arrays, "joint_names": names}), notes


def _arrays(motion: Motion, robot: Description) -> dict[str, np.ndarray]:
    """Return joints, bodies and their velocities."""
    poses, twists = bodies(motion, robot)
    return {
        "joint_pos": motion.positions,
        "joint_vel": velocities_of(motion),
        "body_pos_w": poses[..., :3],
        "body_quat_w": poses[..., [6, 3, 4, 5]],
        "body_lin_vel_w": twists[..., :3],
        "body_ang_vel_w": twists[..., 3:],
    }


def write_mjlab(
    motion: Motion, robot: Description, rate: float | None
) -> tuple[bytes, tuple[str, ...]]:
    """Write the npz from which mjlab trains: joints in MuJoCo's order.

    Arguments and errors are those of ``format.prepared``.

    Returns:
        The file's content, and messages on differences from the motion.
    """
    return _for_training(*prepared(motion, robot, rate), robot)


def write_whole_body_tracking(
    motion: Motion, robot: Description, rate: float | None
) -> tuple[bytes, tuple[str, ...]]:
    """Write the npz from which whole_body_tracking trains: in Isaac Lab's order.

    Arguments, results and errors are those of ``write_mjlab``.
    """
    isaac = breadth_first(robot, usual_joints(motion, robot))
    return _for_training(*prepared(motion, robot, rate, isaac), robot)


def _for_training(
    motion: Motion, fps: float, notes: tuple[str, ...], robot: Description
) -> tuple[bytes, tuple[str, ...]]:
    """Write all six arrays as float32, in the order of the motion's joints."""
    if abs(fps - CONTROL_RATE) > 1e-3:
        notes += (
            f"The file has {fps:g} Hz. Training plays a sample per control step, "
            f"usually at {CONTROL_RATE:g} Hz: resample the motion first.",
        )
    arrays = _arrays(motion, robot).items()
    content = {name: array.astype(np.float32) for name, array in arrays}
    return npz({"fps": np.array([number(fps)]), **content}), notes


FORMAT = Format(
    "tracking",
    recognise,
    read,
    (".npz",),
    order="wxyz",
    arrays=ARRAYS,
    writers={
        "npz": Writer(".npz", write, most_samples=most_samples),
        "mjlab": Writer(".npz", write_mjlab),
        "whole_body_tracking": Writer(".npz", write_whole_body_tracking),
    },
)
