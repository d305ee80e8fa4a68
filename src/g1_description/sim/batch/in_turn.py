"""Files judged in this process, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from g1_description.core.reports.outcome import Outcome

from .judge import Judge, Reader


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
