"""The command motion: what motions in files are, and writing them edited.

It needs neither a master nor a screen.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from g1_description.api import MODEL, Robot
from g1_description.checks.batch import (
    Content,
    FileWorker,
    Here,
    Processes,
    Task,
    check_files,
    mishap,
)
from g1_description.checks.report import NO_MOTION, NOT_READ, FileResult
from g1_description.cli.motion_edits import COMMANDS, Edit, Info, Join, Reading
from g1_description.cli.motion_paths import motion_files
from g1_description.cli.progress import Printer
from g1_description.cli.recorded_file import WRITERS
from g1_description.cli.start import INTERRUPTED
from g1_description.command_line import OneSentenceParser, parse, say
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    NoMotionError,
)
from g1_description.files.atomic import write_whole
from g1_description.interrupts import uninterrupted
from g1_description.motion.edit import base_speed, joint_speeds
from g1_description.motion.files.formats import (
    contents,
    format_name,
    read_source,
    writer_of,
)
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.motion.paths import split
from g1_description.motion.selection import Selection
from g1_description.robot.description import Description
from g1_description.ros.lifecycle import own_arguments
from g1_description.text import listed

JITTER = 1e-3
"""Largest deviation of evenly spaced times, relative to their distance."""


@dataclass(frozen=True)
class Done(FileResult):
    """What became of a motion."""

    text: str = ""
    """What is printed."""

    files: Mapping[Path, bytes] = field(default_factory=dict)
    """What is written."""


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
        try:
            return self._outcome(name, content)
        except G1DescriptionError as error:
            result = NO_MOTION if isinstance(error, NoMotionError) else NOT_READ
            return FileResult(name, problem=str(error), without_verdict=result)
        except Exception as error:  # any error of a library on a damaged file
            return FileResult(name, problem=mishap(error))

    def _outcome(self, name: str, path: Path) -> Done:
        source, motion = read(path, self.args, self.robot)
        if not isinstance(self.args, Edit):
            facts = {"file": name, **facts_of(motion)}
            facts["format"] = self.args.format or format_name(source)
            if isinstance(self.args, Info) and self.args.json:
                return Done(name, text=json.dumps(facts))
            return Done(name, text=description(facts, self.robot))
        edited = self.args.edited(motion, self.robot)
        return written(name, edited, self.robot, self.places[name], self.args.to)


def read(path: Path, args: Reading, robot: Description) -> tuple[MotionSource, Motion]:
    """Read a motion as the options say.

    Raises:
        MotionError: If it cannot be read.
    """
    source = MotionSource(
        path, args.fps, args.topic, args.order, args.input_joint_order
    )
    return source, read_source(source, robot, args.format, not args.reads_all)


def written(
    name: str, motion: Motion, robot: Description, place: Path, to: str | None
) -> Done:
    """Make the files of a motion, and what is printed about it."""
    files, notes = contents(place, motion, robot, None, to, WRITERS)
    size = f"{len(motion.times)} samples, {motion.duration:.2f} s"
    lines = [f"{name} -> {place}: {size}"]
    lines += [f"  note: {note}" for note in dict.fromkeys((*motion.notes, *notes))]
    return Done(name, text="\n".join(lines), files=files)


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


def places_of(args: Edit, tasks: Sequence[Task]) -> dict[str, Path]:
    """Choose where motions are written.

    Returns:
        Files or folders by the names of the tasks.

    Raises:
        InvalidValueError: If ``--out`` is neither a file for one motion nor a folder.
        MotionError: If the format is unknown.
    """
    out = args.out
    endings = {writer.ending for writer in WRITERS.values()} - {""}
    is_named = out.suffix.lower() in endings
    is_single = len(tasks) == 1 and tasks[0].path in args.files
    is_folder = args.to is not None and not WRITERS[args.to].ending
    if not out.is_dir() and (is_named or (is_folder and is_single)):
        if len(tasks) > 1:
            raise InvalidValueError(
                f"--out must be a folder for {len(tasks)} motions (got {out})."
            )
        if args.to is not None and WRITERS[args.to].ending != out.suffix.lower():
            raise InvalidValueError(
                f"{args.to} files end in {WRITERS[args.to].ending or 'nothing'} (got "
                f"{out})."
            )
        return {tasks[0].name: out}
    if args.to is None and not out.is_dir() and out.suffix:
        writer_of(out, None, WRITERS)  # says which endings there are
    if args.to is None:
        raise InvalidValueError(
            f"--out {out} is a folder, so --to must name the format: "
            f"{', '.join(WRITERS)}."
        )
    for path in args.files:
        if path.is_dir() and _is_inside(out, path):
            raise InvalidValueError(
                f"--out {out} must not be in {path}, a folder read."
            )
    return _in_folder(out, tasks, WRITERS[args.to].ending)


def _is_inside(path: Path, folder: Path) -> bool:
    """Return whether a path is a folder, or in it."""
    real = Path(os.path.realpath(path))
    outer = Path(os.path.realpath(folder))
    return real == outer or outer in real.parents


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
            stem = stem / re.sub(r"[^\w.+-]+", "_", name).strip(".")
        places[task.name] = out / stem.with_name(stem.name + ending)
    twice = [str(place) for place, n in Counter(places.values()).items() if n > 1]
    if twice:
        raise InvalidValueError(
            f"Several motions would be written to {listed(twice)}; convert them one by "
            "one."
        )
    return places


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
    robot = Robot(args.model or MODEL).description
    args.check(robot)
    if isinstance(args, Join):
        return join(args, tasks, robot)
    places = places_of(args, tasks) if isinstance(args, Edit) else {}
    left = [task for task in tasks if not _is_kept(args, places.get(task.name))]
    if len(tasks) == 1 and not left:
        raise InvalidValueError(_exists(places[tasks[0].name]))
    left = [replace(task, number=number) for number, task in enumerate(left)]
    worker = MotionWorker(args, robot, places)
    counts: Counter[str] = Counter()
    is_interrupted = False
    with closing(Printer(len(left), sys.stdout)) as printer:
        try:
            with closing(_pool(args, worker, len(left))) as pool:
                for task, outcome in check_files(pool, left):
                    with uninterrupted():  # a folder is written whole, and counted
                        text, problem = _write(task, outcome, args)
                        is_other = outcome.result == NO_MOTION
                        is_other &= task.name not in files.named
                        result = OTHER if is_other else FAILED
                        counts[result if problem else DONE] += 1
                    printer.add(task.number, text)
        except KeyboardInterrupt:
            is_interrupted = True
    done = "read" if isinstance(args, Info) else "written"
    _summarize(counts, done, len(tasks), len(left))
    if is_interrupted:
        return INTERRUPTED
    return 1 if counts[FAILED] else 0


DONE, FAILED, OTHER = "done", "failed", NO_MOTION


def _is_kept(args: Reading, place: Path | None) -> bool:
    """Return whether a file exists that is not to be replaced."""
    return isinstance(args, Edit) and not args.force and bool(place and place.exists())


def _exists(place: Path) -> str:
    return f"{place} exists; --force replaces it."


def _pool(args: Reading, worker: MotionWorker, n_files: int) -> Here:
    """Choose where motions are read."""
    n_processes = min(args.jobs, n_files)
    return Processes(worker, n_processes) if n_processes > 1 else Here(worker)


def _write(task: Task, outcome: FileResult, args: Reading) -> tuple[str, str]:
    """Write a motion; return what is printed, and the problem if there is one."""
    problem = outcome.problem
    if isinstance(outcome, Done):
        try:
            for path, content in outcome.files.items():
                write_whole(path, content)
            return outcome.text, ""
        except InvalidValueError as error:
            problem = str(error)
    file, name = split(task.path)
    begin = f"{file.name}{'' if name is None else f'#{name}'}: "
    problem = problem[len(begin) :] if problem.startswith(begin) else problem
    if isinstance(args, Info) and args.json:
        return json.dumps({"file": task.name, "problem": problem}), problem
    return f"{task.name}: {problem}", problem


def _summarize(counts: Mapping[str, int], done: str, n_tasks: int, n_left: int) -> None:
    """Print the counts, unless there is one motion."""
    n_missing, n_kept = n_left - sum(counts.values()), n_tasks - n_left
    if n_tasks < 2 and not n_missing:
        return
    parts = [f"{counts[DONE]} {done}"]
    parts += [f"{counts[FAILED]} failed"] if counts[FAILED] else []
    parts += [f"{counts[OTHER]} {OTHER}"] if counts[OTHER] else []
    parts += [f"{n_missing} not done"] if n_missing else []
    if n_kept:
        parts.append(f"{n_kept} exist and were kept, --force replaces them")
    notify(f"{n_tasks} motions: {', '.join(parts)}.")


def join(args: Join, tasks: Sequence[Task], robot: Description) -> int:
    """Join motions to one file; return the exit code.

    Raises:
        G1DescriptionError: If it cannot be done.
    """
    if len(tasks) < 2:
        raise InvalidValueError("join needs at least two motions.")
    whole = replace(tasks[0], path=args.files[0])
    place = places_of(replace(args, files=[whole.path]), [whole])[whole.name]
    if _is_kept(args, place):
        raise InvalidValueError(_exists(place))
    motion = args.joined([read(task.path, args, robot)[1] for task in tasks])
    done = written(f"{len(tasks)} motions", motion, robot, place, args.to)
    text, problem = _write(whole, done, args)
    say(text)
    return 1 if problem else 0


def parsed(words: Sequence[str]) -> Reading:
    """Parse the command line; exit with a message if it is wrong."""
    if words and words[0] in COMMANDS:
        return parse(COMMANDS[words[0]], f"motion {words[0]}", words[1:])
    top = OneSentenceParser(
        prog="motion",
        description="Describe motions in files, and write them converted or edited.",
        epilog="motion COMMAND -h lists the options of a command.",
        usage="motion [-h] COMMAND ...",
    )
    commands = top.add_subparsers(title="commands", metavar="COMMAND", dest="command")
    for name, options in COMMANDS.items():
        commands.add_parser(name, help=str(options.__doc__).splitlines()[0])
    top.parse_args(words)
    top.error("a command is missing")
    raise AssertionError


def main() -> None:
    """Run the command, or exit with a message."""
    args = parsed(own_arguments())
    try:
        code = run(args)
    except (G1DescriptionError, OSError) as error:
        notify(str(error))
        code = 1
    sys.exit(code)
