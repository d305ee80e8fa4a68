"""The table of motion formats, and reading and writing by it.

A format is a record of ``format.Format``; the tables here follow from the records.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Mapping

from g1_description.errors import MotionError
from g1_description.files.atomic import write_whole
from g1_description.motion.files import (
    array_formats,
    bag,
    beyond_mimic,
    bones_seed,
    gmr,
    holomotion,
    keyframes,
    mcap_bag,
    motion_library,
    policy,
    protomotions,
    qpos,
    sonic,
    table,
    trajectory_yaml,
)
from g1_description.motion.files.conventions import (
    ISAAC_LAB,
    breadth_first,
    check_radians,
    known_velocities,
    with_endings,
)
from g1_description.motion.files.format import OPEN, Format, Writer
from g1_description.motion.files.hints import hints
from g1_description.motion.files.source import (
    MAX_FILE_SIZE,
    USUAL,
    MotionSource,
    ReadOptions,
)
from g1_description.motion.motion import Motion, fitted
from g1_description.motion.paths import rate_in
from g1_description.robot.description import Description
from g1_description.text import listed

FORMATS: Mapping[str, Format] = {
    own.name: own
    for own in (
        bag.FORMAT,
        mcap_bag.FORMAT,
        qpos.FORMAT,
        *array_formats.FORMATS,
        beyond_mimic.FORMAT,
        holomotion.FORMAT,
        table.NPY_FORMAT,
        gmr.FORMAT,
        motion_library.FORMAT,
        array_formats.MIMICKIT,
        protomotions.FORMAT,
        array_formats.AMP_TEXT,
        policy.FORMAT,
        keyframes.FORMAT,
        bones_seed.FORMAT,
        sonic.FORMAT,
        trajectory_yaml.FORMAT,
        table.FORMAT,
    )
}
"""Formats by name. The first one that recognises a file and can read it does; a
table is any other text."""

ENDINGS = tuple(sorted({end for own in FORMATS.values() for end in own.endings}))
"""Extensions of motions in folders; files that are given may have any name."""

BINARY = {
    ending for own in FORMATS.values() if not own.is_text for ending in own.endings
}
"""Extensions of binary formats: text in such files is never a table."""

_written = {name: w for own in FORMATS.values() for name, w in own.writers.items()}
WRITERS: Mapping[str, Writer] = dict(
    sorted(_written.items(), key=lambda item: (item[1].most_samples is None, item[0]))
)
"""Formats that can be written, by name. The first one of an extension is its usual
one; those that can be recorded come first."""

WRITTEN = {w.ending: w.most_samples for w in WRITERS.values() if w.most_samples}
"""Formats that can be recorded, by extension."""

SAVED = "is not read; save the motion with numpy.savez or as CSV."

OTHERS = {
    b"\x89HDF": f"HDF5 {SAVED}",
    b"PAR1": f"Parquet {SAVED}",
    b"SQLite format 3": "A ROS 2 bag in SQLite is not read; convert it to MCAP with "
    "'ros2 bag convert'.",
}
"""Sentences on formats of others, by first bytes."""


def read_motion(path: Path, robot: Description, options: ReadOptions = USUAL) -> Motion:
    """Read a motion of a robot from a file; its format is detected by content.

    Args:
        path: The file or folder, or ``FILE#NAME`` for one of several motions in a file.
        robot: The robot; joints that it does not have are ignored, with a note.
        options: How it is read.

    Raises:
        MotionError: If the file cannot be read, or its motion does not fit the robot.
    """
    return read_source(MotionSource(path, options), robot)


def read_source(source: MotionSource, robot: Description, fits: bool = True) -> Motion:
    """Read a motion as ``read_motion`` does; a source reads its file only once.

    Of several formats that recognise the file, the first one that can read it does.

    Args:
        source: The file.
        robot: The robot.
        fits: Whether joints that the robot does not have are left out.
    """
    errors: dict[str, MotionError] = {}
    try:
        if not (source.head or source.is_folder):
            raise MotionError("The file is empty.")
        for own in _formats(source):
            try:
                motion = _read(source, own, robot, fits)
            except MotionError as error:
                errors[own.name] = error
            else:
                source.format = own.name
                notes = (f"Not read as {_reasons(errors)}",) if errors else ()
                return replace(motion, notes=(*motion.notes, *notes))
    except MotionError as error:  # on content that only other formats examine
        errors = errors or {"": error}
    first, *others = errors.items()
    also = f" Nor is it read as {_reasons(dict(others))}" if others else ""
    whole = source.path.name + (f"#{source.name}" if source.name else "")
    raise type(first[1])(f"{whole}: {first[1]}{also}") from first[1]


def _reasons(errors: Mapping[str, MotionError]) -> str:
    """List formats with faults."""
    return "; ".join(f"{name}: {error}" for name, error in errors.items())


def _read(source: MotionSource, own: Format, robot: Description, fits: bool) -> Motion:
    """Read a motion in a format."""
    if source.name is not None and not own.names(source):
        raise MotionError("The file has no motions with names.")
    options = source.options
    source.is_settled = False
    motion = own.read(source, robot)
    if not motion.has_times:
        motion = source.timed(motion, own.assumed_rate, own.rate_of)
    motion = replace(motion, velocities=known_velocities(motion))
    motion = with_endings(motion, robot)
    names, notes = motion.joint_names, [*motion.notes]
    if options.order is not None and own.order is None:
        notes.append("The file has no quaternions in an order: --order is ignored.")
    if options.joint_order == ISAAC_LAB and names != breadth_first(robot, names):
        notes.append("The file names its joints: --input-joint-order is ignored.")
    if options.rate is not None and motion.has_times:
        ignored = f"the rate of {options.rate:g} Hz is ignored"
        notes.append(f"The file has its own times: {ignored}.")
    file = source.path.name if source.is_folder else source.path.stem
    motion = replace(motion, name=source.name or file, notes=tuple(notes))
    motion = fitted(motion, robot) if fits else motion
    if not own.is_recorded:
        check_radians(motion, robot)
        is_open = options.order is None and not source.is_settled
        agreed = None if own.order == OPEN or not is_open else own.order
        found = hints(motion, robot, agreed, is_open)
        motion = replace(motion, notes=(*motion.notes, *found))
    return motion


def motion_names(path: Path) -> Sequence[str]:
    """List the motions of a file that has several, or names its one; else none.

    Raises:
        MotionError: If the file cannot be read.
    """
    source = MotionSource(path)
    return next(_formats(source)).names(source)


def has_neighbours(source: MotionSource) -> bool:
    """Return whether a motion is in several files, as of HDMI and any4hdmi."""
    if not source.is_zip:
        return source.is_folder
    return array_formats.is_hdmi(source) or qpos.manifest_of(source) is not None


def is_motion_folder(folder: Path) -> bool:
    """Return whether a folder is one motion, as of SONIC and HDMI."""
    source = MotionSource(folder)
    return any(own.recognise(source) for own in FORMATS.values())


def is_recorded(source: MotionSource) -> bool:
    """Return whether a file is a recording of ROS."""
    return any(own.is_recorded and own.recognise(source) for own in FORMATS.values())


def format_name(source: MotionSource) -> str:
    """Return the name of a file's format, one of ``FORMATS``.

    Raises:
        MotionError: If there is none.
    """
    return source.format or next(_formats(source)).name


def _formats(source: MotionSource) -> Iterator[Format]:
    """Yield the formats that recognise a file.

    Raises:
        MotionError: If there is none.
    """
    name = source.options.format
    if name is not None and name not in FORMATS:
        raise MotionError(f"There is no format {name!r}; formats: {listed(FORMATS)}.")
    if source.options.topic is not None and not is_recorded(source):
        raise MotionError(
            f"Not a rosbag or MCAP; the topic {source.options.topic} needs one."
        )
    if name is not None:
        if not _recognises(FORMATS[name], source):
            raise MotionError(f"The file is not of the format {name}.")
        yield FORMATS[name]
        return
    whole = source if source.name is None else source.whole
    known = whole.recognised
    for own in FORMATS.values():
        if own is table.FORMAT and any(known.values()):
            return
        if own.name not in known:
            known[own.name] = _recognises(own, whole)
        if known[own.name]:
            yield own
    if not any(known.values()):
        raise MotionError(_problem(whole))


def _recognises(own: Format, source: MotionSource) -> bool:
    """Return whether a file has a format.

    Raises:
        MotionError: If it is text where its name says that it is none.
    """
    if own.is_text and source.ending in BINARY and source.text is not None:
        raise MotionError(f"Not a valid {source.ending[1:]} file, but text.")
    return own.recognise(source)


def _problem(source: MotionSource) -> str:
    """Explain why no format recognises a file."""
    if source.is_folder:
        return "The folder is not of a known format."
    names = list(map(str, source.arrays))
    if names:
        found = listed(names)
        for own in FORMATS.values():
            missing = [name for name in own.arrays if name not in names]
            if len(missing) == 1:
                return f"The array {missing[0]} is missing; the file has {found}."
        return f"No known format has the arrays {found}."
    if source.is_zip:
        return "Not an npz: a zip file without arrays."
    for begin, sentence in OTHERS.items():
        if source.head.startswith(begin):
            return sentence
    known = "npz, pickle, rosbag, MCAP or UTF-8 text"
    return f"Unknown format: not an {known}{_line(source)}."


def _line(source: MotionSource) -> str:
    """Name the first line that is not text, unless it is line 1."""
    try:
        source.data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = source.data.count(b"\n", 0, error.start) + 1
        return f" (see line {line})" if line > 1 else ""
    return ""


def write_motion(
    path: Path,
    motion: Motion,
    robot: Description,
    rate: float | None = None,
    name: str | None = None,
) -> tuple[str, ...]:
    """Write a motion, so that ``read_motion`` reads the same numbers.

    Args:
        path: The file or folder; an existing file is replaced.
        motion: The motion.
        robot: The robot that moves.
        rate: Samples per second of a format with evenly spaced samples, in [Hz]; None:
            those of the motion.
        name: Name of the format, one of ``WRITERS``; None: by the extension.

    Returns:
        Messages on differences from the motion: an npz has evenly spaced times.

    Raises:
        MotionError: If the format does not support it, or it is too large.
        InvalidValueError: If the file cannot be written.
    """
    files, notes = contents(path, motion, robot, rate, name)
    for file, part in files.items():
        write_whole(file, part)
    return notes


def contents(
    path: Path,
    motion: Motion,
    robot: Description,
    rate: float | None = None,
    name: str | None = None,
    writers: Mapping[str, Writer] = WRITERS,
) -> tuple[dict[Path, bytes], tuple[str, ...]]:
    """Make the output of ``write_motion``: bytes by file, and messages."""
    writer = writer_of(path, name, writers)
    content, notes = writer.write(motion, robot, rate)
    if writer.assumed is not None:
        own, named = writer.rate(motion, rate), rate_in(path)
        assumed = named or writer.assumed
        if abs(own - assumed) > 1e-6:
            why = ", as in its name," if named else ""
            notes = (
                *notes,
                f"The file does not have its rate: read it with --fps {own:g}, as "
                f"{assumed:g} Hz{why} are assumed.",
            )
    if isinstance(content, bytes):
        files = {path: content}
    else:
        files = {path / file: part for file, part in content.items()}
    for file, part in files.items():
        check_size(file, part)
    return files, tuple(notes)


def check_size(file: Path, content: bytes) -> None:
    """Check that a file can be read again.

    Raises:
        MotionError: If it is too large.
    """
    if len(content) > MAX_FILE_SIZE:
        raise MotionError(
            f"{file.name} would have {len(content) / 1e6:.0f} MB; the limit is "
            f"{MAX_FILE_SIZE / 1e6:.0f} MB."
        )


def writer_of(
    path: Path, name: str | None = None, writers: Mapping[str, Writer] = WRITERS
) -> Writer:
    """Find how a file is written.

    Args:
        path: The file or folder.
        name: Name of the format; None: by the extension.
        writers: The formats by name.

    Raises:
        MotionError: If there is no such format.
    """
    ending = path.suffix.lower()
    if name is not None:
        if name not in writers:
            known = listed(writers)
            raise MotionError(f"The format {name!r} is not written; formats: {known}.")
        return writers[name]
    for writer in writers.values():
        if writer.ending == ending:
            return writer
    endings = dict.fromkeys(w.ending for w in writers.values() if w.ending)
    raise MotionError(
        f"Unknown format of {path.name}: it must end in {' or '.join(endings)}."
    )


def most_samples(ending: str, joints: Sequence[str], has_base: bool) -> int:
    """Return the largest number of samples of a file that can be read again.

    Args:
        ending: One of ``WRITTEN``; an npz counts evenly spaced samples.
        joints: Names of the motion's joints.
        has_base: Whether it has a base.

    Raises:
        MotionError: If the format does not support such a motion.
    """
    count = WRITTEN[ending](joints, has_base, MAX_FILE_SIZE)
    if count < 1:
        raise MotionError(f"{ending} files cannot hold {len(joints)} joints.")
    return count
