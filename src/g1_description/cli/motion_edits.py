"""Edits of motions by the subcommands of ``motion``: their options and their places."""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from g1_description.bridge.recorded_file import WRITERS
from g1_description.checks.batch import Task
from g1_description.cli import options
from g1_description.command_line import MAX_FPS, option, positive, within
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.mend.options import FINDINGS, MendOptions
from g1_description.motion.edit import highest_speed, joined, mirrored
from g1_description.motion.files.conventions import (
    ASAP_JOINTS,
    G1_JOINTS,
    ISAAC_LAB,
    JOINT_ORDERS,
    breadth_first,
)
from g1_description.motion.files.formats import writer_of
from g1_description.motion.motion import Motion, fitted
from g1_description.motion.paths import as_file, split
from g1_description.robot.description import Description
from g1_description.robot.poses import check_pose, find_pose, pose_positions, read_poses
from g1_description.text import listed, similar_first

if TYPE_CHECKING:
    from g1_description.checks.checker import Checker

JOINTS: Mapping[str, tuple[str, ...]] = {
    **{str(number): names for number, names in G1_JOINTS.items()},
    "asap": ASAP_JOINTS,
}
"""Joints of versions of the G1, by the name of the option's value."""

ANY_ORDER = ("csv", "npz", "bag", "mcap")
"""Formats that name joints in any order."""


def new_names(text: str) -> dict[str, str]:
    """Read pairs of names."""
    pairs = [pair.split("=") for pair in text.split(",")]
    if all(len(pair) == 2 and all(pair) for pair in pairs):
        return {old.strip(): new.strip() for old, new in pairs}
    raise argparse.ArgumentTypeError(f"must be OLD=NEW,... (got '{text}')")


@dataclass(frozen=True)
class Reading:
    """Options for reading motions."""

    files: list[Path] = options.motions()
    model: str = options.model()
    fps: float | None = options.fps()
    topic: str | None = options.topic()
    order: str | None = options.order()
    input_joint_order: str | None = options.input_joint_order()
    format: str | None = options.file_format()
    every: bool = option(
        "take all motions of files that have several", False, names=("--all",)
    )
    selection: Path | None = options.selection()
    jobs: int = options.jobs()

    reads_all: ClassVar[bool] = False
    """Whether joints that the robot does not have are read."""

    def check(self, robot: Description) -> None:
        """Check the options for a robot.

        Raises:
            G1DescriptionError: If they do not fit it.
        """


@dataclass(frozen=True)
class Info(Reading):
    """Describe motions: format, joints, samples, duration, top speeds."""

    json: bool = option("print a line of JSON for each motion", False)


class Edited(NamedTuple):
    """An edited motion."""

    motion: Motion
    about: str = ""
    """Text to print."""

    facts: Mapping[str, Any] | None = None
    """What ``--json`` prints."""

    page: str = ""
    """A page in HTML."""


@dataclass(frozen=True)
class Edit(Reading):
    """Options for writing motions."""

    out: Path = option(
        "the file; a folder for several motions",
        None,
        Path,
        required=True,
        metavar="FILE",
    )
    to: str | None = option(
        f"format to write: {', '.join(WRITERS)}",
        None,
        str,
        shown="by the extension",
        metavar="NAME",
        choices=tuple(WRITERS),
    )
    force: bool = option("replace existing files", False)

    def edited(self, motion: Motion, robot: Description) -> Motion:
        """Edit a motion.

        Raises:
            G1DescriptionError: If it cannot be done.
        """
        return motion

    def edit(self, motion: Motion, robot: Description) -> Edited:
        """Edit a motion; describe it if there is something to say.

        Raises:
            G1DescriptionError: If it cannot be done.
        """
        return Edited(self.edited(motion, robot))

    def is_merged(self, tasks: Sequence[Task]) -> bool:
        """Return whether all motions are written to one file."""
        is_whole = len(tasks) == 1 and tasks[0].path in self.files
        writer = None if self.to is None else WRITERS[self.to]
        if writer is None or writer.merged is None or is_whole or self.out.is_dir():
            return False
        return self.out.suffix.lower() == writer.ending

    def places(self, tasks: Sequence[Task]) -> dict[str, Path]:
        """Choose where motions are written.

        Returns:
            Files or folders by the names of the tasks.

        Raises:
            InvalidValueError: If ``--out`` is neither a file for one motion nor a
                folder.
            MotionError: If the format is unknown.
        """
        out = self.out
        endings = {writer.ending for writer in WRITERS.values()} - {""}
        is_named = out.suffix.lower() in endings
        is_single = len(tasks) == 1 and tasks[0].path in self.files
        is_folder = self.to is not None and not WRITERS[self.to].ending
        if not out.is_dir() and (is_named or (is_folder and is_single)):
            if len(tasks) > 1 and not self.is_merged(tasks):
                raise InvalidValueError(
                    f"--out must be a folder for {len(tasks)} motions (got {out})."
                )
            if self.to is not None and WRITERS[self.to].ending != out.suffix.lower():
                raise InvalidValueError(
                    f"{self.to} files end in {WRITERS[self.to].ending or 'nothing'} "
                    f"(got {out})."
                )
            return {task.name: out for task in tasks}
        if self.to is None and not out.is_dir() and out.suffix:
            writer_of(out, None, WRITERS)  # says which endings there are
        if self.to is None:
            raise InvalidValueError(
                f"--out {out} is a folder, so --to must name the format: "
                f"{', '.join(WRITERS)}."
            )
        real = Path(os.path.realpath(out))
        for path in self.files:
            if path.is_dir() and Path(os.path.realpath(path)) in (real, *real.parents):
                raise InvalidValueError(
                    f"--out {out} must not be in {path}, a folder read."
                )
        return _in_folder(out, tasks, WRITERS[self.to].ending)


def _in_folder(out: Path, tasks: Sequence[Task], ending: str) -> dict[str, Path]:
    """Name a file for each motion, as the files lie in their common folder."""
    sources = [(task, *split(task.path)) for task in tasks]
    absolute = [Path(os.path.abspath(file)) for _, file, _ in sources]
    common = os.path.commonpath([path.parent for path in absolute])
    relative = [path.relative_to(common) for path in absolute]
    short = {  # a folder has no extension
        file: file if path.is_dir() else file.with_suffix("")
        for file, path in zip(relative, absolute)
    }
    stems = Counter(short.values())
    places = {}
    for (task, _, name), file in zip(sources, relative):
        # Two files may differ in their extensions only.
        stem = file if stems[short[file]] > 1 else short[file]
        if name:
            stem = stem / as_file(name)
        places[task.name] = out / stem.with_name(stem.name + ending)
    twice = [str(place) for place, n in Counter(places.values()).items() if n > 1]
    if twice:
        raise InvalidValueError(
            f"Several motions would be written to {listed(twice)}; convert them one by "
            "one."
        )
    return places


@dataclass(frozen=True)
class Convert(Edit):
    """Write motions in another format."""

    joints: str | None = option(
        "joints to write: 29, 27 or 23 of Unitree's G1, or asap, the 23 of ASAP, PBHC "
        "and GMT; others are ignored, missing ones at 0",
        None,
        str,
        shown="those of the motion",
        choices=tuple(JOINTS),
    )
    joint_order: str | None = option(
        "order of the joints: mujoco, that of the robot's file, or isaaclab, breadth "
        "first",
        None,
        str,
        shown="that of the motion",
        choices=JOINT_ORDERS,
    )

    def check(self, robot: Description) -> None:
        """Check that the robot has the joints, and the format an order of them."""
        endings = {WRITERS[name].ending: name for name in reversed([*WRITERS])}
        to = self.to or endings.get(self.out.suffix.lower())
        if self.joint_order is not None and to not in (None, *ANY_ORDER):
            raise InvalidValueError(
                f"--joint-order is for {', '.join(ANY_ORDER)}: the format {to} has one "
                "order of joints."
            )
        own = {joint.name for joint in robot.movable_joints}
        missing = [n for n in JOINTS.get(self.joints or "", ()) if n not in own]
        if missing:
            raise UnknownNameError(
                f"--joints {self.joints} needs joints that {robot.name} does not have: "
                f"{listed(missing)}. Choose another --model."
            )

    def edited(self, motion: Motion, robot: Description) -> Motion:
        """Choose and order the joints."""
        if self.joints is not None:
            motion = motion.arranged(JOINTS[self.joints])
        if self.joint_order is None:
            return motion
        if self.joint_order == ISAAC_LAB:
            return motion.arranged(breadth_first(robot, motion.joint_names))
        own = [joint.name for joint in robot.movable_joints]
        return motion.arranged([n for n in own if n in motion.joint_names])


@dataclass(frozen=True)
class Cut(Edit):
    """Cut a part out of motions; it begins at 0 s."""

    begin: float | None = option(
        "start of the part [s]", None, within(0.0), names=("--from",), metavar="TIME"
    )
    end: float | None = option(
        "end of the part [s]", None, within(0.0), names=("--until",), metavar="TIME"
    )

    def __post_init__(self) -> None:
        """Check that there is something to do."""
        if self.begin is None and self.end is None:
            raise InvalidValueError("give --from, --until or both")

    def edited(self, motion: Motion, robot: Description) -> Motion:
        """Cut it."""
        part = motion.cut(self.begin, self.end)
        return part.at_speed(1.0, part.begin)


@dataclass(frozen=True)
class Join(Edit):
    """Join motions to one, in the order given."""

    blend: float = option(
        "time in which one motion becomes the next [s]; 0: one sample", 0.0, within(0.0)
    )
    stay: bool = option(
        "leave each motion at its place; otherwise it begins at the place and heading "
        "at which the one before ends",
        False,
    )

    def joined(self, motions: Sequence[Motion]) -> Motion:
        """Join them."""
        return joined(motions, self.blend, not self.stay)


@dataclass(frozen=True)
class Mirror(Edit):
    """Exchange left and right, at the plane y = 0."""

    def edited(self, motion: Motion, robot: Description) -> Motion:
        """Mirror it."""
        return mirrored(motion, robot)


@dataclass(frozen=True)
class Retime(Edit):
    """Play motions faster or slower."""

    speed: float | None = option(
        "playback speed, such as 0.5 for half as fast", None, positive(1e6)
    )
    duration: float | None = option("new duration [s]", None, positive(1e6))
    fastest: bool = option("as fast as the velocity limits of the joints allow", False)

    def __post_init__(self) -> None:
        """Check that there is one thing to do."""
        if (self.speed, self.duration, self.fastest or None).count(None) != 2:
            raise InvalidValueError("give one of --speed, --duration and --fastest")

    def edited(self, motion: Motion, robot: Description) -> Motion:
        """Change its speed."""
        speed = self.speed
        if self.fastest:
            speed = highest_speed(motion, robot)
        elif speed is None and self.duration is not None:
            speed = motion.duration / self.duration
        if not speed:
            raise InvalidValueError("A motion of a single sample has no duration.")
        return motion.at_speed(speed)


@dataclass(frozen=True)
class Resample(Edit):
    """Give motions evenly spaced samples."""

    rate: float = option(
        "samples per second", None, positive(MAX_FPS), required=True, metavar="HZ"
    )

    def edited(self, motion: Motion, robot: Description) -> Motion:
        """Resample it."""
        return motion.resampled(self.rate)


@dataclass(frozen=True)
class Pad(Edit):
    """Let motions come from a named pose and end in one, standing on the floor."""

    begin: str | None = option("pose before the motion", None, str, metavar="POSE")
    end: str | None = option("pose after it", None, str, metavar="POSE")
    seconds: float = option(
        "shortest time from and to a pose [s]; longer where a joint would be too fast",
        1.0,
        positive(1e3),
    )

    def __post_init__(self) -> None:
        """Check that there is something to do."""
        if self.begin is None and self.end is None:
            raise InvalidValueError("give --begin, --end or both")

    def check(self, robot: Description) -> None:
        """Check that the poses exist and fit."""
        self._poses(robot)

    def edited(self, motion: Motion, robot: Description) -> Motion:
        """Pad it."""
        from g1_description.sim.padding import padded  # few need meshes

        return padded(robot, motion, *self._poses(robot), self.seconds)

    def _poses(self, robot: Description) -> list[dict[str, float] | None]:
        """Return the positions by joint of both poses."""
        known = read_poses(robot)
        found: list[dict[str, float] | None] = []
        joints = [joint.name for joint in robot.movable_joints]
        for name in (self.begin, self.end):
            if name is None:
                found.append(None)
                continue
            pose = find_pose(name, known)
            check_pose(pose, robot)
            found.append(dict(zip(joints, pose_positions(pose, robot).tolist())))
        return found


@dataclass(frozen=True)
class Floor(Edit):
    """Lift or lower whole motions so that their lowest point is at height 0."""

    def edited(self, motion: Motion, robot: Description) -> Motion:
        """Set it on the floor."""
        from g1_description.sim.standing import on_floor

        return on_floor(robot, motion)


def parts(text: str) -> tuple[str, ...]:
    """Read what is to be fixed."""
    return tuple(part.strip() for part in text.split(","))


@dataclass(frozen=True)
class Mend(Edit):
    """Remove what checks find by small changes, and say what was changed."""

    out: Path = option(
        "the file; a folder for several motions", None, Path, metavar="FILE"
    )
    only: tuple[str, ...] = option(
        f"what is fixed: {', '.join(FINDINGS)}",
        (),
        parts,
        shown="all",
        metavar="PART,...",
    )
    max_change: float = option(
        "largest change of a joint [rad or m]", inf, positive(inf), shown="any"
    )
    max_base: float = option(
        "largest change of the base's place [m]", inf, positive(inf), shown="any"
    )
    keep_hands: bool = option("keep the paths of hands in the map", False)
    thresholds: Path | None = options.thresholds()
    dry_run: bool = option("write no motion, only say what would be changed", False)
    json: bool = option("print a line of JSON for each motion", False)
    physics: bool = option(
        "simulate motions before and after; keep no change that falls earlier", False
    )
    html: bool = option(
        "write also a page with both robots, FILE.html, next to each motion", False
    )

    def __post_init__(self) -> None:
        """Check what is to be fixed."""
        self._mend_options()
        if self.out is None and not self.dry_run:
            raise InvalidValueError("give --out, or --dry-run to write nothing")
        if self.html and self.dry_run:
            raise InvalidValueError("--html is not for --dry-run, which writes nothing")

    def _mend_options(self) -> MendOptions:
        return MendOptions(self.only, self.max_change, self.max_base, self.keep_hands)

    def is_merged(self, tasks: Sequence[Task]) -> bool:
        """Return whether all motions are written to one file."""
        return not self.dry_run and super().is_merged(tasks)

    def places(self, tasks: Sequence[Task]) -> dict[str, Path]:
        """Choose where motions are written; nowhere with ``--dry-run``."""
        return {} if self.dry_run else super().places(tasks)

    def edit(self, motion: Motion, robot: Description) -> Edited:
        """Fix it."""
        from g1_description.mend.mending import mended  # few need checks

        checker = _checker(robot, self.physics, self.thresholds)
        found = mended(checker, motion, self._mend_options())
        certificate, text, page = found.certificate, str(found.certificate), ""
        if self.html:
            from g1_description.render.page import motion_page

            name = f"{motion.name or robot.name}, fixed"
            given = robot, found.motion, found.after, name
            page = motion_page(*given, before=motion, about=text)
        return Edited(found.motion, text, certificate.as_dict(), page)


_CHECKERS: dict[int, Checker] = {}
"""The checks of the robot of this process, by its id."""


def _checker(robot: Description, physics: bool, file: Path | None) -> Checker:
    """Prepare the checks of a robot once in each process."""
    from g1_description.checks.checker import Checker
    from g1_description.checks.thresholds_file import read_thresholds

    if id(robot) not in _CHECKERS:
        conditions = None
        if physics:
            from g1_description.sim.engines import fastest_engine
            from g1_description.sim.rollout import Conditions

            conditions = Conditions(engine=fastest_engine())
        _CHECKERS[id(robot)] = Checker(robot, read_thresholds(file), physics=conditions)
    return _CHECKERS[id(robot)]


@dataclass(frozen=True)
class Rename(Edit):
    """Rename joints."""

    names: Mapping[str, str] = option(
        "new names of joints, such as left_toe=left_ankle",
        None,
        new_names,
        required=True,
        metavar="OLD=NEW,...",
    )

    reads_all = True

    def check(self, robot: Description) -> None:
        """Check that the robot has joints of the new names."""
        own = [joint.name for joint in robot.movable_joints]
        for name in self.names.values():
            if name not in own:
                raise UnknownNameError(
                    f"{robot.name} has no joint '{name}'. Its joints: "
                    f"{listed(similar_first(name, own))}."
                )

    def edited(self, motion: Motion, robot: Description) -> Motion:
        """Rename them, and leave out joints that the robot lacks."""
        return fitted(motion.renamed(self.names), robot)


COMMANDS: Mapping[str, type[Reading]] = {
    "info": Info,
    "convert": Convert,
    "cut": Cut,
    "join": Join,
    "mirror": Mirror,
    "retime": Retime,
    "resample": Resample,
    "pad": Pad,
    "floor": Floor,
    "mend": Mend,
    "rename": Rename,
}
"""Options by subcommand."""
