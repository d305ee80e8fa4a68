"""Tables of comma-separated numbers, with or without a header.

Without a header a row is a sample: x y z and quaternion x y z w of the base, then the
joints, as in the LAFAN1 retargeting set of the G1. Tables of Kimodo have w first, which
is detected. With a header, which may be a comment, the columns are named:

- ``time``, unless the user or the name of the file gives the rate;
- ``base_x`` to ``base_qw``, also with another prefix or none, or none of them;
- each joint by its name;
- ``NAME.velocity`` for each joint, or for none.

Traps of tables without a header: the order of the quaternion is not in the file, nor is
the rate; 23 joints have two layouts. A numeric npy has the same columns: AMASS for the
G1, whose files have the rate at most in their names (``_120_jpos.npy``).
"""

from __future__ import annotations

import io
import re
from array import array
from collections.abc import Iterator, Sequence

import numpy as np

from g1_description.errors import MotionError, NoMotionError
from g1_description.motion.files.arrays import NPY
from g1_description.motion.files.conventions import names_of_columns, w_last
from g1_description.motion.files.format import OPEN, Format, Writer, even_writer
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.motion.paths import rate_in
from g1_description.robot.description import Description
from g1_description.text import listed

TIME = "time"
BASE = tuple(f"base_{part}" for part in ("x", "y", "z", "qx", "qy", "qz", "qw"))
"""Columns of the base: position in [m] and quaternion."""

VELOCITY = ".velocity"
"""Suffix of the columns of joint velocities."""

DEFAULT_RATE = 30.0
"""Rate of a table without times, in [Hz]: that of the LAFAN1 set."""

MAX_COLUMNS = 3000

MAX_LINE = 100_000
"""Longest line, in characters."""

MAX_LINES = 1_000_000
"""Largest number of lines: a quarter of an hour at 1 kHz."""

MAX_NUMBERS = 8_000_000
"""Largest number of numbers: an hour of 29 joints and the base at 60 Hz."""

NUMBER_LENGTH = 25
"""Longest written number, with its comma: -1.2345678901234567e-300."""

XML = {
    "robot": "a robot description (URDF)",
    "sdf": "a model or world of Gazebo (SDF)",
    "launch": "a launch file",
    "html": "a web page (HTML)",
}
"""Kinds of XML by the name of the root element."""

_SEPARATOR = re.compile(r"[,;\t ]+")
"""Column separators of other kinds of tables."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file is text."""
    return source.text is not None


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a table; columns without names are the robot's joints.

    Raises:
        MotionError: If it is not such a table, with the line.
        NoMotionError: If it is text of another kind.
    """
    text = source.text
    assert text is not None
    kind = _kind(source, text)
    if kind:
        raise NoMotionError(f"This is {kind}.")
    above, comment = 0, ""
    for number, line in _lines(text):
        if not line.startswith("#"):
            break
        above, comment = number, line[1:]
    else:
        raise MotionError("The file is empty.")
    names = [name.strip() for name in _fields(number, line, None)]
    rows = _rows(text, number)
    if not names[0]:  # the index of pandas
        names, rows = names[1:], ((n, line.partition(",")[2]) for n, line in rows)
        if names == [*map(str, range(len(names)))]:
            return _headless(source, rows, (number, len(names)), robot)
    if not _is_number(names[0]):
        return _headed(source, rows, number, names, robot)
    # numpy.savetxt writes its header as a comment.
    header = [name.strip() for name in comment.split(",")]
    if TIME in header and len(header) == len(names):
        return _headed(source, _rows(text), above, header, robot)
    return _headless(source, _rows(text), (number, len(names)), robot)


def _kind(source: MotionSource, text: str) -> str:
    """Say what other kind of text a file is; empty if it may be a table."""
    if source.xml_root:
        return XML.get(source.xml_root, f"XML with the root <{source.xml_root}>")
    if source.ending == ".md":
        return "Markdown"
    return "JSON" if text.lstrip()[:1] in ("{", "[") else ""


def _headless(
    source: MotionSource,
    rows: Iterator[tuple[int, str]],
    first: tuple[int, int],
    robot: Description,
) -> Motion:
    """Read a table without a header, whose first line has this number and width."""
    number, width = first
    if width <= len(BASE):
        raise MotionError(
            f"Line {number} has {width} columns; expected x y z, quaternion x y z w "
            "and joints."
        )
    values = _numbers(rows, width)
    return _unnamed(source, values, robot)


def is_npy(source: MotionSource) -> bool:
    """Return whether a file is a numeric npy with rows, as of AMASS for the G1."""
    values = source.arrays[NPY] if [*source.arrays] == [NPY] else None
    return isinstance(values, np.ndarray) and values.ndim == 2


def read_npy(source: MotionSource, robot: Description) -> Motion:
    """Read an npy with the columns of a table without a header.

    Raises:
        MotionError: If the array has a wrong shape, or the order of the quaternion is
            not known.
    """
    values = source.arrays.numbers(NPY, None, None)
    if values.shape[1] <= len(BASE):
        raise MotionError(
            f"The array has {values.shape[1]} columns; expected x y z, quaternion x y "
            "z w and joints."
        )
    return _unnamed(source, values, robot)


def _unnamed(source: MotionSource, values: np.ndarray, robot: Description) -> Motion:
    """Make a motion of columns without names: place, quaternion and joints."""
    base, positions = values[:, : len(BASE)], values[:, len(BASE) :]
    joints, notes = names_of_columns(source, positions, robot)
    times = np.arange(len(values), dtype=float)
    motion = Motion(times, joints, positions, None, base, notes, has_times=False)
    return w_last(motion, robot, source.options.order)


def header(source: MotionSource) -> list[str]:
    """Return the columns that the first line of a text names; none: not a text."""
    lines = (source.text or "")[:MAX_LINE].splitlines()
    return [name.strip() for name in lines[0].split(",")] if lines else []


def headed(source: MotionSource) -> tuple[list[str], np.ndarray]:
    """Read a table whose first line names its columns.

    Returns:
        The names, and the numbers, shape (n_rows, n_columns).

    Raises:
        MotionError: If it is no such table, with the line.
    """
    for number, line in _lines(source.text or ""):
        names = [name.strip() for name in _fields(number, line, None)]
        return names, _numbers(_rows(source.text or "", number), len(names))
    raise MotionError("The file is empty.")


def check_once(number: int, names: list[str]) -> None:
    """Check that the columns of a line have different names.

    Raises:
        MotionError: If they have not.
    """
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise MotionError(f"Line {number} has duplicate columns: {listed(twice)}.")


def _headed(
    source: MotionSource,
    rows: Iterator[tuple[int, str]],
    number: int,
    names: list[str],
    robot: Description,
) -> Motion:
    """Read a table with a header, whose line has this number."""
    shown, notes = names, []
    for prefix in [name[:-2] for name in names if name.endswith("qw")]:
        others = [name.replace("base_", prefix) for name in BASE]
        if {*others} <= {*names}:
            names = [dict(zip(others, BASE)).get(name, name) for name in names]
            if prefix not in ("base_", "root_", ""):
                notes.append(f"{prefix}x ... {prefix}qw are read as those of the base.")
    check_once(number, names)
    base = [name for name in BASE if name in names]
    joints = [
        name
        for name in names
        if name not in (TIME, *BASE) and not name.endswith(VELOCITY)
    ]
    velocities = [joint + VELOCITY for joint in joints]
    has_velocities = any(name.endswith(VELOCITY) for name in names)
    own = {joint.name for joint in robot.movable_joints}
    is_untimed = TIME not in names and bool(own & {*joints})
    has_rate = is_untimed and bool(source.options.rate or rate_in(source.path))
    timing = () if has_rate else (TIME,)
    needed = [*timing, *(BASE if base else ()), *(velocities if has_velocities else ())]
    missing = [name for name in needed if name not in names]
    if missing:
        hint = "; columns must be separated by commas" if len(names) == 1 else ""
        if missing == [TIME] and is_untimed:
            hint = "; or give the rate, --fps"
        is_motion = _may_be_motion(names, next(rows, (0, "0"))[1], robot)
        raise (MotionError if is_motion else NoMotionError)(
            f"Line {number} has the columns {listed(shown)}, but lacks "
            f"{listed(missing)}{hint}."
        )
    strange = [n for n in names if n not in (*needed, *joints)]
    if strange:
        raise MotionError(
            f"Line {number} has {listed(strange)}, but not the position of that joint."
        )
    values = _numbers(rows, len(names))

    def of(needed: Sequence[str]) -> np.ndarray:
        return values[:, [names.index(name) for name in needed]]

    if base and source.options.order is not None:
        notes.append("The header names the quaternion: --order is ignored.")
    return Motion(
        np.arange(len(values)) if has_rate else values[:, names.index(TIME)],
        tuple(joints),
        of(joints),
        of(velocities) if has_velocities else None,
        of(BASE) if base else None,
        tuple(notes),
        has_times=not has_rate,
    )


def _may_be_motion(names: list[str], row: str, robot: Description) -> bool:
    """Return whether a table with this first row may be a motion."""
    header = {word.strip("\"'") for name in names for word in _SEPARATOR.split(name)}
    known = {TIME, *(joint.name for joint in robot.movable_joints)}
    words = filter(None, _SEPARATOR.split(row))
    return bool(known & header) or all(map(_is_number, words))


def write(
    motion: Motion, robot: Description, rate: float | None
) -> tuple[bytes, tuple[str, ...]]:
    """Write a motion as a table with a header, without loss of precision.

    Returns:
        The file's content, and no messages.

    Raises:
        MotionError: If a joint has the name of another column.
    """
    t = motion
    names, parts = [TIME], [t.times[:, np.newaxis]]
    if t.base_poses is not None:
        names, parts = [*names, *BASE], [*parts, t.base_poses]
    names, parts = [*names, *t.joint_names], [*parts, t.positions]
    if t.velocities is not None:
        names += [joint + VELOCITY for joint in t.joint_names]
        parts = [*parts, t.velocities]
    _check_writable(t.joint_names)
    return rows_text(np.concatenate(parts, axis=1), names).encode(), ()


def rows_text(values: np.ndarray, names: Sequence[str] = ()) -> str:
    """Write a table, each number with as few digits as set it apart.

    Args:
        values: Shape (n_rows, n_columns).
        names: Names of the columns; none: no header.
    """
    rows = [",".join(map(repr, row)) for row in values.tolist()]
    return "\n".join([*([",".join(names)] if names else ()), *rows, ""])


def _lafan1(motion: Motion, base: np.ndarray, robot: Description, fps: float) -> bytes:
    """Write joints without a header, as in the LAFAN1 retargeting set."""
    return rows_text(np.concatenate([base, motion.positions], axis=1)).encode()


def _kimodo(motion: Motion, base: np.ndarray, robot: Description, fps: float) -> bytes:
    """Write the same with quaternions w x y z, as Kimodo does."""
    values = np.concatenate([base[:, [0, 1, 2, 6, 3, 4, 5]], motion.positions], axis=1)
    stream = io.StringIO()
    np.savetxt(stream, values, delimiter=",")
    return stream.getvalue().encode()


def most_samples(joints: Sequence[str], has_base: bool, size: int) -> int:
    """Return the largest number of rows of a file, whatever the numbers are.

    Args:
        joints: Names of the joints, which have velocities.
        has_base: Whether there is a base.
        size: Largest file size in bytes.

    Raises:
        MotionError: If a joint has the name of another column.
    """
    _check_writable(joints)
    header = 100 + sum(len(2 * name.encode()) + len(VELOCITY) + 2 for name in joints)
    width = 1 + has_base * len(BASE) + 2 * len(joints)
    if width > MAX_COLUMNS or header > MAX_LINE:
        return 0
    rows = (size - header) // (width * NUMBER_LENGTH)
    return min(rows, MAX_NUMBERS // width, MAX_LINES - 1)


def _check_writable(joints: Sequence[str]) -> None:
    """Check that no joint has the name of another column."""
    for name in joints:
        is_other = name in (TIME, *BASE) or name.endswith(VELOCITY)
        if is_other or name != name.strip() or re.search(r"[,#\r\n]|^$", name):
            raise MotionError(f"A table cannot have a joint called {name!r}.")


def _rows(text: str, after: int = 0) -> Iterator[tuple[int, str]]:
    """Yield the lines after a line number, without empty lines and comments."""
    for number, line in _lines(text):
        if number > after and not line.startswith("#"):
            yield number, line


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines that are not empty, with their numbers."""
    if max(text.count("\n"), text.count("\r")) > MAX_LINES:
        raise MotionError(f"The file has more than {MAX_LINES} lines.")
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if len(line) > MAX_LINE:
            raise MotionError(
                f"Line {number} has {len(line)} characters; the limit is {MAX_LINE}."
            )
        if line:
            yield number, line


def _fields(number: int, line: str, width: int | None) -> list[str]:
    """Split a line."""
    fields = line.split(",")
    if len(fields) > MAX_COLUMNS:
        raise MotionError(
            f"Line {number} has {len(fields)} columns; the limit is {MAX_COLUMNS}."
        )
    if width is not None and len(fields) != width:
        raise MotionError(
            f"Line {number} has {len(fields)} columns; the lines before have {width}."
        )
    return fields


def _numbers(rows: Iterator[tuple[int, str]], width: int) -> np.ndarray:
    """Read rows of numbers, shape (n, width)."""
    values, numbers = array("d"), array("q")
    for number, line in rows:
        fields = _fields(number, line, width)
        try:
            values.extend(map(float, fields))
        except ValueError:
            raise _wrong(number, fields) from None
        if "_" in line:
            raise _wrong(number, fields)
        if len(values) > MAX_NUMBERS:
            raise MotionError(
                f"The file has more than {MAX_NUMBERS} numbers (line {number})."
            )
        numbers.append(number)
    if not values:
        raise MotionError("The table has no rows.")
    table = np.frombuffer(values).reshape(-1, width)
    infinite = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if infinite.size:
        raise MotionError(
            f"Line {numbers[infinite[0]]} has a number that is not finite."
        )
    return table


def _wrong(number: int, fields: Sequence[str]) -> MotionError:
    """Describe the field of a line that is not a number."""
    wrong = next(field for field in fields if not _is_number(field))
    if not fields[-1].strip() and wrong is fields[-1]:
        return MotionError(
            f"Line {number} ends in a comma; columns must be separated by commas."
        )
    return MotionError(
        f"Line {number}: expected a number (got {wrong.strip()[:40]!r})."
    )


def _is_number(field: str) -> bool:
    """Return whether a field is a number; unlike Python, without underscores."""
    try:
        float(field)
    except ValueError:
        return False
    return "_" not in field


FORMAT = Format(
    "table",
    recognise,
    read,
    (".csv",),
    order=OPEN,
    assumed_rate=DEFAULT_RATE,
    rate_of="the rate of the LAFAN1 set",
    is_text=True,
    writers={
        "csv": Writer(".csv", write, most_samples=most_samples),
        "lafan1": Writer(".csv", even_writer(_lafan1, False), DEFAULT_RATE),
        "kimodo": Writer(".csv", even_writer(_kimodo, False), DEFAULT_RATE),
    },
)

NPY_FORMAT = Format(
    "npy",
    is_npy,
    read_npy,
    (".npy",),
    order=OPEN,
    assumed_rate=120.0,
    rate_of="the usual rate of AMASS for the G1",
)
