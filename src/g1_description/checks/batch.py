"""Motions judged, one after the other."""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Callable, Optional

from g1_description.checks.checker import NAMES, Checker
from g1_description.checks.physics import CHECKS, PhysicsCheck
from g1_description.checks.report import NO_MOTION, NOT_READ, Outcome
from g1_description.checks.thresholds import Thresholds, read_thresholds
from g1_description.checks.timeline import Timeline
from g1_description.checks.verdict import Verdict
from g1_description.errors import G1DescriptionError, MotionError, NoMotionError, cause
from g1_description.motion.motion import Motion
from g1_description.motion.motors import Motors
from g1_description.robot.description import Description
from g1_description.robot.urdf import parse_urdf


@dataclass(frozen=True, eq=False)
class Setup:
    """A robot, and how its motions are judged."""

    urdf: str
    """Text of its description, with absolute names of its meshes."""

    thresholds: Thresholds = field(default_factory=read_thresholds)

    only: tuple[str, ...] = ()
    """Names of the checks to make; none: all."""

    pairs: Path | None = None
    """File of the pairs of links that may touch; None: that of the package."""

    visual_hulls: bool = True
    """Whether links without collision shapes have the hulls of their visual ones."""

    fixed_base: bool = False
    """Whether something holds the base."""

    physics: bool = False
    """Whether motions are played in physics, too."""

    motors: Motors | None = None
    """What drives the joints in physics."""

    plot: bool = False
    """Whether a picture of each motion is drawn."""

    rate: float | None = None
    """Samples per second of files without times."""

    topic: str | None = None
    """Topic of bags with the joints."""


Reader = Callable[[Path, Description, Optional[float], Optional[str]], Motion]
"""Reads a motion of a robot from a file, at a rate, from a topic."""


class Judge:
    """Judges motions of one robot."""

    def __init__(self, setup: Setup) -> None:
        """Prepare all that does not depend on a motion.

        Args:
            setup: The robot, and what is judged.

        Raises:
            G1DescriptionError: If that robot cannot be judged so.
        """
        self._setup = setup
        self.description = parse_urdf(setup.urdf)
        self._checker = Checker.of(
            self.description,
            setup.thresholds,
            setup.pairs,
            setup.visual_hulls,
            setup.fixed_base,
        )
        self._physics = PhysicsCheck(
            self.description, setup.thresholds, setup.motors, setup.fixed_base
        )

    def outcome(self, name: str, read: Callable[[], Motion]) -> Outcome:
        """Read a motion and judge it.

        Args:
            name: Of its file.
            read: Reads the motion of the robot; may raise MotionError.

        Returns:
            The verdict, or why there is none; one motion never ends the work on others.
        """
        motion = self.read(name, read)
        if isinstance(motion, Outcome):
            return motion
        try:
            verdict, timeline = self._judged(motion)
            if verdict.nothing_made:
                return Outcome(name, problem=verdict.nothing_made)
            plot = self._plot(name, verdict, timeline) if self._setup.plot else b""
        except G1DescriptionError as error:
            return Outcome(name, problem=str(error))
        except Exception as error:
            return Outcome(name, problem=_mishap(error))
        return Outcome(name, verdict, plot=plot)

    def read(self, name: str, read: Callable[[], Motion]) -> Motion | Outcome:
        """Read a motion, or tell why there is none."""
        try:
            return read()
        except MotionError as error:
            problem = _without_name(str(error), name)
            is_other = isinstance(error, NoMotionError)
            result = NO_MOTION if is_other else NOT_READ
            return Outcome(name, problem=problem, without_verdict=result)
        except Exception as error:  # whatever a library finds in a file
            return Outcome(name, problem=_mishap(error))

    def read_file(self, path: Path, read: Reader) -> Motion:
        """Read a motion of the robot.

        Raises:
            MotionError: If the file holds none.
        """
        return read(path, self.description, self._setup.rate, self._setup.topic)

    def _judged(self, motion: Motion) -> tuple[Verdict, Timeline]:
        """Judge a motion, and return what was measured, too."""
        only = self._setup.only
        kinematic = [name for name in only if name not in CHECKS]
        # Something has to be measured, for figures and pictures.
        judged = self._checker.check_motion(motion, kinematic or (only and NAMES[:1]))
        verdict = judged.verdict
        if only and not kinematic:
            verdict = replace(verdict, findings=(), checked=(), skipped={})
        if self._setup.physics:
            wanted = [name for name in only if name in CHECKS]
            if wanted or not only:
                verdict = self._physics.added(verdict, motion, wanted)
        return verdict, judged.timeline

    def _plot(self, name: str, verdict: Verdict, timeline: Timeline) -> bytes:
        """Draw what was measured."""
        # Only now: matplotlib takes most of a second.
        from g1_description.checks.plot import motion_plot

        joints = self.description.movable_joints
        return motion_plot(name, verdict, timeline, joints)


def _without_name(problem: str, name: str) -> str:
    """Leave out the name of a file at the beginning of a sentence on it."""
    begin = f"{Path(name).name}: "
    return problem[len(begin) :] if problem.startswith(begin) else problem


def _mishap(error: Exception) -> str:
    """Describe an error that nobody expected, with its place."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(frame.filename).name}:{frame.lineno}"
    return f"internal error {type(error).__name__}: {cause(error)} ({place})"


@dataclass(frozen=True)
class Task:
    """A file that is to be judged."""

    number: int
    """Its place among all files."""

    name: str
    """What it is called in reports."""

    path: Path


def judged_here(
    judge: Judge, tasks: Sequence[Task], read: Reader
) -> Iterator[tuple[Task, Outcome]]:
    """Judge files.

    Args:
        judge: Judges their motions.
        tasks: The files.
        read: Reads a motion.
    """
    for task in tasks:
        yield task, judge.outcome(task.name, partial(judge.read_file, task.path, read))
