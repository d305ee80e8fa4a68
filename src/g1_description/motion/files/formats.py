"""The table of motion formats, and reading and writing by it.

A format is a module with ``recognise(source)``, which examines a file's content,
``read(source, robot)``, and ``ENDINGS``, the extensions of its files in folders. If its
files may have several motions, it has ``names(source)``, too. Those that are written
are in ``WRITERS``; to be recorded, a module has ``most_samples``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Callable, Mapping, Union

from g1_description.errors import MotionError
from g1_description.files.atomic import write_whole
from g1_description.motion.files import (
    amp_dataset,
    amp_text,
    bag,
    beyond_mimic,
    bones_seed,
    gmr,
    hdmi,
    holomotion,
    isaac_amp,
    keyframes,
    mimickit,
    motion_library,
    npy_table,
    phuma,
    policy,
    protomotions,
    pyroki,
    qpos,
    sonic,
    sonic_deploy,
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
from g1_description.motion.files.hints import hints
from g1_description.motion.files.source import (
    MAX_FILE_SIZE,
    USUAL,
    MotionSource,
    ReadOptions,
)
from g1_description.motion.files.writing import mean_rate
from g1_description.motion.motion import Motion, fitted
from g1_description.motion.paths import rate_in, with_rate
from g1_description.robot.description import Description
from g1_description.text import listed

Content = Union[bytes, Mapping[str, bytes]]
"""Of a file, or of a folder's files by name."""

FORMATS: Mapping[str, ModuleType] = {
    "bag": bag,
    "qpos": qpos,
    "hdmi": hdmi,
    "tracking": beyond_mimic,
    "isaac_amp": isaac_amp,
    "holomotion": holomotion,
    "pyroki": pyroki,
    "npy": npy_table,
    "gmr": gmr,
    "motion_library": motion_library,
    "sonic_deploy": sonic_deploy,
    "mimickit": mimickit,
    "phuma": phuma,
    "protomotions": protomotions,
    "amp_dataset": amp_dataset,
    "amp_text": amp_text,
    "policy": policy,
    "keyframes": keyframes,
    "bones_seed": bones_seed,
    "sonic": sonic,
    "trajectory": trajectory_yaml,
    "table": table,
}
"""Formats by name. The first one that recognises a file and can read it does; a
table is any other text."""

W_FIRST = (
    *(beyond_mimic, hdmi, isaac_amp, keyframes, policy, pyroki, qpos, sonic),
    sonic_deploy,
)
W_LAST = (holomotion,)
"""Formats on whose order of quaternions all publishers agree."""

ORDER_OPEN = (
    *(table, npy_table, gmr, motion_library, phuma, amp_dataset, protomotions),
)
"""Formats of which publishers disagree on it, so that the feet decide."""

ENDINGS = tuple(
    sorted({ending for module in FORMATS.values() for ending in module.ENDINGS})
)
"""Extensions of motions in folders; files that are given may have any name."""


@dataclass(frozen=True)
class Writer:
    """How a format is written."""

    ending: str
    """Extension of its files; empty: it is a folder."""

    write: Callable[[Motion, Description, float | None], tuple[Content, Sequence[str]]]
    """Given a motion, its robot and a rate in [Hz] (None: that of the motion), returns
    the file's bytes, or those of a folder's files by name, and messages on differences
    from the motion."""

    assumed: float | None = None
    """Rate in [Hz] that readers assume; None: it is in the file."""

    fixed: float | None = None
    """Rate in [Hz] of all files; None: that of the motion."""

    merged: Callable[[Mapping[str, bytes]], bytes] | None = None
    """Makes a file of several motions of their files by name; None: it has only one."""

    def rate(self, motion: Motion, rate: float | None) -> float:
        """Return the rate of the samples that are written, in [Hz]."""
        return self.fixed or mean_rate(motion, rate)

    def place(self, path: Path, motion: Motion) -> Path:
        """Return a path whose name has no other rate than its motion."""
        is_open = self.assumed is not None
        return with_rate(path, self.rate(motion, None)) if is_open else path


WRITERS: Mapping[str, Writer] = {
    "csv": Writer(".csv", table.write),
    "npz": Writer(".npz", beyond_mimic.write),
    "lafan1": Writer(".csv", table.write_lafan1, table.DEFAULT_RATE),
    "kimodo": Writer(".csv", table.write_kimodo, table.DEFAULT_RATE),
    "bones_seed": Writer(".csv", bones_seed.write, bones_seed.USUAL_RATE),
    "sonic": Writer("", sonic.write, sonic.RATE, sonic.RATE),
    "mjlab": Writer(".npz", beyond_mimic.write_mjlab),
    "whole_body_tracking": Writer(".npz", beyond_mimic.write_whole_body_tracking),
    "qpos": Writer(".npz", qpos.write),
    "holomotion": Writer(".npz", holomotion.write),
    "gmr": Writer(".pkl", gmr.write),
    "motion_library": Writer(
        ".pkl", motion_library.write, merged=motion_library.merged
    ),
}
"""Formats that can be written, by name. The first one of an extension is its usual
one."""

WRITTEN: Mapping[str, ModuleType] = {".csv": table, ".npz": beyond_mimic}
"""Formats that can be recorded, by extension."""


OTHERS = {b"\x89HDF": "HDF5", b"PAR1": "Parquet"}
"""Formats of data sets that need large libraries, by first bytes."""


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
        for own, module in _formats(source):
            try:
                motion = _read(source, module, robot, fits)
            except MotionError as error:
                errors[own] = error
            else:
                source.format = own
                notes = (f"Not read as {_reasons(errors)}",) if errors else ()
                return replace(motion, notes=(*motion.notes, *notes))
    except MotionError as error:  # on content that only other formats examine
        errors = errors or {"": error}
    first, *others = errors.items()
    also = f" Nor is it read as {_reasons(dict(others))}" if others else ""
    whole = source.path.name + (f"#{source.name}" if source.name else "")
    raise type(first[1])(f"{whole}: {first[1]}{also}") from first[1]


def _reasons(errors: Mapping[str, MotionError]) -> str:
    """List formats with what is wrong."""
    return "; ".join(f"{name}: {error}" for name, error in errors.items())


def _read(
    source: MotionSource, module: ModuleType, robot: Description, fits: bool
) -> Motion:
    """Read a motion in a format."""
    if source.name is not None and not _names(module, source):
        raise MotionError("The file has no motions with names.")
    file = source.path.name if source.is_folder else source.path.stem
    source.is_settled = False
    motion = module.read(source, robot)
    motion = replace(
        motion, name=source.name or file, velocities=known_velocities(motion)
    )
    motion = with_endings(motion, robot)
    motion = replace(
        motion, notes=(*motion.notes, *_ignored(source, module, motion, robot))
    )
    if source.options.rate is not None and motion.has_times:
        ignored = f"the rate of {source.options.rate:g} Hz is ignored"
        notes = (*motion.notes, f"The file has its own times: {ignored}.")
        motion = replace(motion, notes=notes)
    motion = fitted(motion, robot) if fits else motion
    if module is not bag:  # ROS uses radians
        check_radians(motion, robot)
        order = "wxyz" if module in W_FIRST else "xyzw"
        is_open = source.options.order is None and not source.is_settled
        is_fixed = is_open and module in (*W_FIRST, *W_LAST)
        found = hints(motion, robot, order if is_fixed else None, is_open)
        motion = replace(motion, notes=(*motion.notes, *found))
    return motion


def _ignored(
    source: MotionSource, module: ModuleType, motion: Motion, robot: Description
) -> Sequence[str]:
    """Tell which options the file leaves no choice for."""
    found = []
    if source.options.order is not None and module not in (
        *W_FIRST,
        *W_LAST,
        *ORDER_OPEN,
    ):
        found.append("The file has no quaternions in an order: --order is ignored.")
    names = motion.joint_names
    if source.options.joint_order == ISAAC_LAB and names != breadth_first(robot, names):
        found.append("The file names its joints: --input-joint-order is ignored.")
    return found


def motion_names(path: Path) -> Sequence[str]:
    """List the motions of a file that has several, or names its one; else none.

    Raises:
        MotionError: If the file cannot be read.
    """
    source = MotionSource(path)
    return _names(next(_formats(source))[1], source)


def _names(module: ModuleType, source: MotionSource) -> Sequence[str]:
    """List the names of the motions in a file; empty if they have none."""
    names: Sequence[str] = module.names(source) if hasattr(module, "names") else ()
    return names


def has_neighbours(source: MotionSource) -> bool:
    """Return whether a motion is in several files, as of HDMI and any4hdmi."""
    if not source.is_zip:
        return source.is_folder
    return hdmi.recognise(source) or qpos.manifest_of(source) is not None


def is_motion_folder(folder: Path) -> bool:
    """Return whether a folder is one motion, as of SONIC and HDMI."""
    source = MotionSource(folder)
    return any(module.recognise(source) for module in FORMATS.values())


def format_name(source: MotionSource) -> str:
    """Return the name of a file's format, one of ``FORMATS``.

    Raises:
        MotionError: If there is none.
    """
    return source.format or next(_formats(source))[0]


def _formats(source: MotionSource) -> Iterator[tuple[str, ModuleType]]:
    """Yield the formats that recognise a file, with their names.

    Raises:
        MotionError: If there is none.
    """
    name = source.options.format
    if name is not None and name not in FORMATS:
        raise MotionError(f"There is no format {name!r}; formats: {listed(FORMATS)}.")
    if source.options.topic is not None and not bag.recognise(source):
        raise MotionError(f"Not a rosbag; the topic {source.options.topic} needs one.")
    if name is not None:
        if not FORMATS[name].recognise(source):
            raise MotionError(f"The file is not of the format {name}.")
        yield name, FORMATS[name]
        return
    whole = source if source.name is None else source.whole
    known = whole.recognised
    for own, module in FORMATS.items():
        if module is table and any(known.values()):
            return
        if own not in known:
            known[own] = module.recognise(whole)
        if known[own]:
            yield own, module
    if not any(known.values()):
        raise MotionError(_problem(whole))


def _problem(source: MotionSource) -> str:
    """Explain why no format recognises a file."""
    if source.is_folder:
        return "The folder is not of a known format."
    names = list(map(str, source.arrays))
    if names:
        found = listed(names)
        for module in FORMATS.values():
            arrays = getattr(module, "ARRAYS", ())
            missing = [name for name in arrays if name not in names]
            if len(missing) == 1:
                return f"The array {missing[0]} is missing; the file has {found}."
        return f"No known format has the arrays {found}."
    if source.is_zip:
        return "Not an npz: a zip file without arrays."
    for begin, name in OTHERS.items():
        if source.head.startswith(begin):
            return f"{name} is not read; save the motion with numpy.savez or as CSV."
    return f"Unknown format: not an npz, pickle, rosbag or UTF-8 text{_line(source)}."


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
        robot: Whose motion it is.
        rate: Samples per second of a format with evenly spaced samples, in [Hz]; None:
            those of the motion.
        name: Of the format, one of ``WRITERS``; None: by the extension.

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
    """Make what ``write_motion`` writes: bytes by file, and its messages."""
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
        name: Of the format; None: by the extension.
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
    count: int = WRITTEN[ending].most_samples(joints, has_base, MAX_FILE_SIZE)
    if count < 1:
        raise MotionError(f"{ending} files cannot hold {len(joints)} joints.")
    return count
