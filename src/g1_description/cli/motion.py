"""The command motion, which describes motions in files, converts and edits them.

It needs neither a master nor a screen.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from g1_description.bridge.recorded_file import WRITERS
from g1_description.checks.batch import (
    Content,
    FileWorker,
    Task,
    check_files,
    mishap,
    pool_of,
)
from g1_description.checks.report import NO_MOTION, NOT_READ, FileResult
from g1_description.cli.motion_edits import (
    ANY_ORDER,
    COMMANDS,
    Edit,
    Info,
    Join,
    Reading,
)
from g1_description.cli.motion_paths import MotionFiles, motion_files, unmatched
from g1_description.cli.progress import Printer
from g1_description.cli.start import INTERRUPTED
from g1_description.command_line import (
    EXIT_ERROR,
    OneSentenceParser,
    exit_with_error,
    own_arguments,
    parse,
    program_name,
    say,
)
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    NoMotionError,
)
from g1_description.files.atomic import write_whole
from g1_description.interrupts import uninterrupted
from g1_description.motion.edit import base_speed, joint_speeds
from g1_description.motion.files.format import ONLY
from g1_description.motion.files.formats import (
    check_size,
    contents,
    format_name,
    read_source,
)
from g1_description.motion.files.source import MotionSource, ReadOptions
from g1_description.motion.motion import Motion
from g1_description.motion.paths import split
from g1_description.motion.selection import Selection
from g1_description.robot.description import Description
from g1_description.robot.load import read_description
from g1_description.text import listed

JITTER = 1e-3
"""Largest deviation of evenly spaced times, relative to their distance."""


@dataclass(frozen=True)
class Done(FileResult):
    """The result of a motion."""

    text: str = ""
    """Text to print."""

    files: Mapping[Path, bytes] = field(default_factory=dict)
    """Contents by file."""

    place: Path | None = None
    """The file or folder that is written."""

    motion: str = ""
    """Name of the motion."""

    is_smaller: bool = False
    """Whether the file has fewer joints than the robot."""


@dataclass(frozen=True, eq=False)
class MotionWorker(FileWorker):
    """Describes or edits each of many motions."""

    args: Reading
    robot: Description
    places: Mapping[str, Path]
    """Where motions are written, by name."""

    def outcome(self, name: str, content: Content) -> FileResult:
        """Describe or edit a motion; this writes nothing."""
        assert isinstance(content, Path)
        args = self.args
        try:
            source, motion = read(content, args, self.robot)
            if not isinstance(args, Edit):
                facts = {"file": name, **facts_of(motion)}
                facts["format"] = args.format or format_name(source)
                is_json = isinstance(args, Info) and args.json
                text = json.dumps(facts) if is_json else description(facts, self.robot)
                return Done(name, text=text)
            edited, about, facts, page = args.edit(motion, self.robot)
            is_json = getattr(args, "json", False)
            if is_json:
                about = json.dumps({"file": name, **(facts or {})})
            if name not in self.places:  # --dry-run
                return Done(name, text=about if is_json else f"{name}:\n{about}")
            place = self.places[name]
            if place != args.out and args.to is not None:
                place = WRITERS[args.to].place(place, edited)
            done = written(name, edited, self.robot, place, args.to)
            if page:
                html = place.with_suffix(".html")
                code = page.encode("utf-8", "backslashreplace")
                done = replace(done, files={**done.files, html: code})
            text = about if is_json else f"{done.text}\n{about}"
            return replace(done, text=text) if about else done
        except G1DescriptionError as error:
            result = NO_MOTION if isinstance(error, NoMotionError) else NOT_READ
            return FileResult(name, problem=str(error), without_verdict=result)
        except Exception as error:  # any error of a library on a damaged file
            return FileResult(name, problem=mishap(error))


def read(path: Path, args: Reading, robot: Description) -> tuple[MotionSource, Motion]:
    """Read a motion as the options say.

    Raises:
        MotionError: If it cannot be read.
    """
    options = ReadOptions(
        args.fps, args.topic, args.order, args.format, args.input_joint_order
    )
    source = MotionSource(path, options)
    return source, read_source(source, robot, not args.reads_all)


def written(
    name: str, motion: Motion, robot: Description, place: Path, to: str | None
) -> Done:
    """Make the files of a motion, and the text about it."""
    files, notes = contents(place, motion, robot, None, to, WRITERS)
    size = f"{len(motion.times)} samples, {motion.duration:.2f} s"
    lines = [f"{name} -> {place}: {size}"]
    lines += [f"  note: {note}" for note in dict.fromkeys((*motion.notes, *notes))]
    n_own = len(robot.movable_joints)
    is_smaller = any(note.startswith(ONLY) for note in notes)
    is_smaller |= to in (None, *ANY_ORDER) and len(motion.joint_names) < n_own
    text = "\n".join(lines)
    return Done(
        name,
        text=text,
        files=files,
        place=place,
        motion=motion.name,
        is_smaller=is_smaller,
    )


def facts_of(motion: Motion) -> dict[str, Any]:
    """Return the facts on a motion, as ``--json`` prints them."""
    gaps = np.diff(motion.times)
    rate = 1.0 / float(gaps.mean()) if gaps.size else None
    speeds = joint_speeds(motion)
    top = None
    if speeds.size:
        row = int(np.argmax(speeds))
        top = {"joint": motion.joint_names[row], "speed": float(speeds[row])}
    return {
        "joints": motion.joint_names,
        "samples": len(motion.times),
        "rate": rate,
        "is_even": bool(np.ptp(gaps) <= JITTER * gaps.mean()) if gaps.size else True,
        "duration": motion.duration,
        "has_times": motion.has_times,
        "has_base": motion.base_poses is not None,
        "has_velocities": motion.velocities is not None,
        "top_joint_speed": top,
        "top_base_speed": base_speed(motion),
        "notes": motion.notes,
    }


def description(facts: Mapping[str, Any], robot: Description) -> str:
    """Describe a motion in a few lines."""
    base = "base" if facts["has_base"] else "no base"
    rates = "velocities" if facts["has_velocities"] else "no velocities"
    rate = ""
    if facts["rate"] is not None:
        rate = f" at {facts['rate']:.6g} Hz"
        rate += "" if facts["is_even"] else " on average"
    joints = {joint.name: joint for joint in robot.movable_joints}
    lines = [
        f"{facts['file']}: {facts['format']}, {len(facts['joints'])} joints, {base}, "
        f"{rates}, {facts['samples']} samples{rate}, {facts['duration']:.2f} s"
    ]
    tops = []
    if facts["top_base_speed"] is not None:
        tops.append(f"base {facts['top_base_speed']:.3g} m/s")
    if facts["top_joint_speed"] is not None:
        name, speed = facts["top_joint_speed"].values()
        is_sliding = name in joints and joints[name].kind == "prismatic"
        tops.append(f"{name} {speed:.3g} {'m/s' if is_sliding else 'rad/s'}")
    lines.append(f"  top speeds: {', '.join(tops)}")
    is_whole = (*facts["joints"],) == (*joints,)
    names = f"those of {robot.name}" if is_whole else ", ".join(facts["joints"])
    lines.append(f"  joints: {names or 'none'}")
    lines += [f"  note: {note}" for note in facts["notes"]]
    return "\n".join(lines)


def notify(text: str) -> None:
    """Print a message."""
    say(f"motion: {text}", sys.stderr)


def run(args: Reading) -> int:
    """Describe or edit motions; return the exit code.

    Raises:
        G1DescriptionError: If nothing can be done.
        KeyboardInterrupt: If it is interrupted before the first outcome.
    """
    selection = Selection(args.selection) if args.selection else None
    repeats = isinstance(args, Join)
    files = motion_files(args.files, args.every, selection, repeats)
    tasks = files.tasks
    robot = read_description(args.model)
    args.check(robot)
    if isinstance(args, Join):
        return join(args, tasks, robot)
    places = args.places(tasks) if isinstance(args, Edit) else {}
    is_merged = isinstance(args, Edit) and args.is_merged(tasks)
    out = Output(args, files.named, is_merged)
    left = [task for task in tasks if not out.is_kept(places.get(task.name))]
    if not left and (len(tasks) == 1 or is_merged):
        raise InvalidValueError(_exists(places[tasks[0].name]))
    left = [replace(task, number=number) for number, task in enumerate(left)]
    worker = MotionWorker(args, robot, places)
    is_interrupted = False
    with closing(Printer(len(left), sys.stdout)) as printer:
        try:
            with closing(pool_of(worker, args.jobs, len(left))) as pool:
                for task, outcome in check_files(pool, left):
                    with uninterrupted():  # a folder is written whole, and counted
                        printer.add(task.number, out.add(task, outcome))
        except KeyboardInterrupt:
            is_interrupted = True
    if out.parts and is_interrupted:
        out.counts[DONE] = 0
    elif out.parts:
        out.write_merged(places[tasks[0].name])
    done = "written" if places else "read"
    _summarize(out, done, files, len(left), len(robot.movable_joints))
    if unmatched(selection):
        notify(unmatched(selection))
    if is_interrupted:
        return INTERRUPTED
    if out.counts[FAILED] == len(tasks):
        return EXIT_ERROR
    return 1 if out.counts[FAILED] else 0


DONE, FAILED, OTHER, KEPT = "done", "failed", NO_MOTION, "kept"


class Output:
    """Writes outcomes, and counts them."""

    def __init__(
        self, args: Reading, named: Collection[str] = (), is_merged: bool = False
    ) -> None:
        """Begin without outcomes.

        Args:
            args: Arguments of the command line.
            named: Motions that were given one by one, which must be motions.
            is_merged: Whether all motions are written to one file.
        """
        self._args, self._named, self._is_merged = args, named, is_merged
        self._made: set[Path] = set()
        self.counts: Counter[str] = Counter()
        self.parts: dict[str, bytes] = {}
        """Files of the motions of one file, by their names."""
        self.smaller: list[str] = []
        """Names of motions whose files have fewer joints than the robot."""

    def is_kept(self, place: Path | None) -> bool:
        """Return whether a file exists that is not to be replaced."""
        is_free = not isinstance(self._args, Edit) or self._args.force
        return not is_free and place is not None and place.exists()

    def add(self, task: Task, outcome: FileResult) -> str:
        """Write an outcome; return the text to print."""
        problem = outcome.problem
        if isinstance(outcome, Done) and not problem:
            try:
                return self._write(outcome)
            except InvalidValueError as error:
                problem = str(error)
        is_other = outcome.result == NO_MOTION and task.name not in self._named
        self.counts[OTHER if is_other else FAILED] += 1
        file, name = split(task.path)
        begin = f"{file.name}{'' if name is None else f'#{name}'}: "
        problem = problem[len(begin) :] if problem.startswith(begin) else problem
        if getattr(self._args, "json", False):
            return json.dumps({"file": task.name, "problem": problem})
        return f"{task.name}: {problem}"

    def _write(self, done: Done) -> str:
        """Write a motion; return the text to print."""
        if self._is_merged:
            name = done.motion
            if name in self.parts:
                name = str(Path(done.file).with_suffix("")).replace("#", "/")
            self.parts[name] = next(iter(done.files.values()))
        elif done.place in self._made:
            raise InvalidValueError(f"{done.place} has another motion already.")
        elif any(map(self.is_kept, (done.place, *done.files))):
            self.counts[KEPT] += 1
            return (
                f"{done.file}: {done.place} exists and was kept; --force replaces it."
            )
        else:
            for path, content in done.files.items():
                write_whole(path, content)
        self._made |= {done.place} if done.place and not self._is_merged else set()
        self.counts[DONE] += 1
        self.smaller += [done.file] if done.is_smaller else []
        return done.text

    def write_merged(self, place: Path) -> None:
        """Write the file of several motions.

        Raises:
            InvalidValueError: If it cannot be written.
        """
        assert isinstance(self._args, Edit) and self._args.to is not None
        merged = WRITERS[self._args.to].merged
        assert merged is not None
        content = merged(self.parts)
        check_size(place, content)
        write_whole(place, content)


def _exists(place: Path) -> str:
    return f"{place} exists; --force replaces it."


def _summarize(
    out: Output, done: str, files: MotionFiles, n_left: int, n_joints: int
) -> None:
    """Print the counts, unless there is one motion."""
    counts, n_tasks = out.counts, len(files.tasks)
    n_missing, n_kept = n_left - sum(counts.values()), n_tasks - n_left + counts[KEPT]
    if n_tasks < 2 and not n_missing and not files.n_left_out:
        return
    parts = [f"{counts[DONE]} {done}"]
    parts += [f"{counts[FAILED]} failed"] if counts[FAILED] else []
    parts += [f"{counts[OTHER]} {OTHER}"] if counts[OTHER] else []
    parts += [f"{n_missing} not done"] if n_missing else []
    if n_kept:
        parts.append(f"{n_kept} exist and were kept, --force replaces them")
    notify(f"{n_tasks} motions: {', '.join(parts)}{files.remarks}.")
    if 0 < len(out.smaller) < counts[DONE]:
        notify(
            f"{len(out.smaller)} files have fewer joints than {n_joints}: "
            f"{listed(out.smaller)}. To write all, missing ones at 0: convert --joints "
            f"{n_joints}."
        )


def join(args: Join, tasks: Sequence[Task], robot: Description) -> int:
    """Join motions to one file; return the exit code.

    Raises:
        G1DescriptionError: If it cannot be done.
    """
    if len(tasks) < 2:
        raise InvalidValueError("join needs at least two motions.")
    whole = replace(tasks[0], path=args.files[0])
    place = replace(args, files=[whole.path]).places([whole])[whole.name]
    out = Output(args)
    if out.is_kept(place):
        raise InvalidValueError(_exists(place))
    motion = args.joined([read(task.path, args, robot)[1] for task in tasks])
    done = written(f"{len(tasks)} motions", motion, robot, place, args.to)
    say(out.add(whole, done))
    return EXIT_ERROR if out.counts[FAILED] else 0


PROGRAMS = ("check", "play", "record", "snapshot", "web", "pose")
"""Commands that are taken for subcommands of this one."""


def parsed(words: Sequence[str]) -> Reading:
    """Parse the command line; exit with a message if it is wrong."""
    if words and words[0] in COMMANDS:
        return parse(COMMANDS[words[0]], f"motion {words[0]}", words[1:])
    program = program_name("motion")
    top = OneSentenceParser(
        prog=program,
        description="Describe motions in files, and write them converted or edited.",
        epilog=f"{program} COMMAND -h lists the options of a command.",
        usage=f"{program} [-h] COMMAND ...",
    )
    commands = top.add_subparsers(title="commands", metavar="COMMAND", dest="command")
    if words and words[0] in PROGRAMS:
        own = program_name(words[0])
        own = own if " " in own else f"rosrun g1_description {own}"
        top.error(f"{words[0]} is a command of its own: {own}")
    for name, options in COMMANDS.items():
        commands.add_parser(name, help=str(options.__doc__).splitlines()[0])
    top.parse_args(words)
    top.error("a command is missing")
    raise AssertionError


def main() -> None:
    """Run the command, or exit with a message."""
    args = parsed(own_arguments())
    try:
        sys.exit(run(args))
    except (G1DescriptionError, OSError) as error:
        exit_with_error("motion", error)
