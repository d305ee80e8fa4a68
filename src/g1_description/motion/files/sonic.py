"""Reference motions of SONIC (GR00T whole-body control): a folder of tables.

``joint_pos.csv``, ``joint_vel.csv``, ``body_pos.csv``, ``body_quat.csv`` and more.
Traps:

- Joints are in Isaac Lab's order, though their columns have numbers for names;
  quaternions are w x y z; body 0 is the pelvis.
- 50 Hz by definition: the files have no rate, and the robot plays them at that.
- Only some of the files need be there, with different numbers of bodies.
- Places may be all zero: the motion then has none.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files import table
from g1_description.motion.files.bodies import Bodies, find_base, links_of
from g1_description.motion.files.conventions import (
    ISAAC_JOINTS,
    base_of,
    isaac_joints,
)
from g1_description.motion.files.format import (
    Format,
    Writer,
    bodies,
    prepared,
    velocities_of,
)
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

RATE = 50.0
"""Samples per second, in [Hz]."""

JOINTS, SPEEDS = "joint_pos.csv", "joint_vel.csv"
PLACES, TURNS = "body_pos.csv", "body_quat.csv"
METADATA = "metadata.txt"

BODIES = (0, 4, 10, 18, 5, 11, 19, 9, 16, 22, 28, 17, 23, 29)
"""Bodies that are written, as numbers of Isaac Lab's: the root, then joints' links."""

N_JOINTS = len(ISAAC_JOINTS)

_FIRST = ("joint_0", "joint_vel_0", "body_0_x", "body_0_w", "body_0_vel_x")
"""First columns of the tables."""


def recognise(source: MotionSource) -> bool:
    """Return whether it is such a folder, or one of its tables."""
    if source.is_folder:
        return any((source.path / name).is_file() for name in (JOINTS, TURNS))
    return table.header(source)[:1] in [[name] for name in _FIRST]


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If a table has a wrong size, or it is a single table.
    """
    if not source.is_folder:
        folder = source.path.absolute().parent.name
        raise MotionError(
            f"This is one table of a motion of SONIC; give its folder, {folder}."
        )
    tables = {
        name: _table(source.path / name)
        for name in (JOINTS, SPEEDS, PLACES, TURNS)
        if (source.path / name).is_file()
    }
    n_samples = len(next(iter(tables.values())))
    for name, values in tables.items():
        if len(values) != n_samples:
            raise MotionError(
                f"{name} has {len(values)} rows, but other tables have {n_samples}."
            )
        if name in (JOINTS, SPEEDS) and values.shape[1] != N_JOINTS:
            raise MotionError(
                f"{name} has {values.shape[1]} columns; expected those of {N_JOINTS} "
                "joints."
            )
    joints = isaac_joints(source) if JOINTS in tables else ()
    positions = tables.get(JOINTS, np.empty((n_samples, 0)))
    base, notes = _base(source, robot, tables, positions, joints)
    velocities = tables.get(SPEEDS) if joints else None
    times = np.arange(n_samples, dtype=float)
    return Motion(times, joints, positions, velocities, base, notes, has_times=False)


def _table(path: Path) -> np.ndarray:
    """Read a table, shape (n_rows, n_columns); its header only takes a line."""
    try:
        return table.headed(MotionSource(path))[1]
    except MotionError as error:
        raise MotionError(f"{path.name}: {error}") from error


def _base(
    source: MotionSource,
    robot: Description,
    tables: dict[str, np.ndarray],
    positions: np.ndarray,
    joints: tuple[str, ...],
) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Return poses of the base, if there are, and a message on unknown ones."""
    if TURNS not in tables:
        return None, (f"{TURNS} is missing: the motion has no base.",)
    turns = tables[TURNS]
    places = tables.get(PLACES, np.zeros((len(turns), 3)))
    if turns.shape[1] % 4 or places.shape[1] % 3:
        raise MotionError(
            f"Bodies have 4 columns each in {TURNS} and 3 in {PLACES} (got "
            f"{turns.shape[1]} and {places.shape[1]})."
        )
    if places.any() and joints:
        links = _links(source.path / METADATA, places.shape[1] // 3, robot)
        bodies = Bodies(places.reshape(len(places), -1, 3), None, links)
        root = places[:, :3], turns[:, :4]
        found = find_base(source, robot, bodies, positions, [joints], "wxyz", root)
        return found.poses, found.notes
    base = base_of(places[:, :3], turns[:, :4], source.options.order)
    if places.any():
        return base, ()
    why = f"{PLACES} has only zeros" if PLACES in tables else f"{PLACES} is missing"
    return base, (f"{why}: the place of the base is unknown, and shown as 0.",)


def _links(path: Path, n_bodies: int, robot: Description) -> list[str]:
    """Name the bodies by their numbers, empty where these are unknown."""
    text = (path.is_file() and MotionSource(path).text) or ""
    listed = re.search(r"\[([\d\s]+)\]", text)
    numbers = [*map(int, listed[1].split())] if listed else [*BODIES]
    known = dict(enumerate(links_of(robot, ISAAC_JOINTS)))
    named = [known.get(number, "") for number in numbers]
    return named if len(named) == n_bodies else [robot.root, *[""] * (n_bodies - 1)]


def write(
    motion: Motion, robot: Description, rate: float | None
) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """Write a motion at 50 Hz.

    Args:
        motion: With a base; joints missing in it are at zero.
        robot: The robot, which has the 29 joints of the G1.
        rate: None, or 50.

    Returns:
        The tables by name, and messages on differences from the motion.

    Raises:
        MotionError: If it has no base or too many samples, or the robot or the rate is
            another.
    """
    if rate not in (None, RATE):
        raise MotionError(f"Motions of SONIC have {RATE:g} Hz (got {rate:g} Hz).")
    found, _, notes = prepared(motion, robot, RATE, ISAAC_JOINTS)
    poses, twists = (part[:, BODIES] for part in bodies(found, robot))
    speeds = velocities_of(found)
    tables = {
        JOINTS: (found.positions, ["joint_{}"]),
        SPEEDS: (speeds, ["joint_vel_{}"]),
        PLACES: (poses[..., :3], [f"body_{{}}_{axis}" for axis in "xyz"]),
        TURNS: (poses[..., [6, 3, 4, 5]], [f"body_{{}}_{axis}" for axis in "wxyz"]),
        "body_lin_vel.csv": (twists[..., :3], [f"body_{{}}_vel_{a}" for a in "xyz"]),
        "body_ang_vel.csv": (twists[..., 3:], [f"body_{{}}_angvel_{a}" for a in "xyz"]),
    }
    content = {}
    for name, (values, columns) in tables.items():
        names = [c.format(number) for number in range(values.shape[1]) for c in columns]
        rows = values.reshape(len(values), -1)
        content[name] = table.rows_text(rows, names).encode()
    # The robot's program reads which bodies there are.
    numbers = " ".join(f"{number:2d}" for number in BODIES)
    metadata = (
        "Metadata for: motion\n==============================\n\nBody part indexes:\n"
        f"[{numbers}]\n\nTotal timesteps: {len(found.times)}\n"
    )
    return {**content, METADATA: metadata.encode()}, notes


FORMAT = Format(
    "sonic",
    recognise,
    read,
    order="wxyz",
    assumed_rate=RATE,
    rate_of="the rate of all motions of SONIC",
    is_text=True,
    writers={"sonic": Writer("", write, RATE, RATE)},
)
