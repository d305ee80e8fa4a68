"""The record of a format of motion files: how it is recognised, read and written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable, Union

from g1_description.motion.files.source import MotionSource
from g1_description.motion.files.writing import mean_rate
from g1_description.motion.motion import Motion
from g1_description.motion.paths import with_rate
from g1_description.robot.description import Description

Content = Union[bytes, Mapping[str, bytes]]
"""Content of a file, or of a folder's files by name."""

OPEN = "open"
"""Order of quaternions on which publishers of a format disagree."""


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

    most_samples: Callable[[Sequence[str], bool, int], int] | None = None
    """Given the names of joints, whether there is a base, and a size in bytes, returns
    the largest number of samples of a file; None: the format is not recorded."""

    def rate(self, motion: Motion, rate: float | None) -> float:
        """Return the rate of the samples that are written, in [Hz]."""
        return self.fixed or mean_rate(motion, rate)

    def place(self, path: Path, motion: Motion) -> Path:
        """Return a path whose name has no other rate than its motion."""
        is_open = self.assumed is not None
        return with_rate(path, self.rate(motion, None)) if is_open else path


@dataclass(frozen=True)
class Format:
    """A format of motion files."""

    name: str

    recognise: Callable[[MotionSource], bool]
    """Returns whether a file has this format, by its content."""

    read: Callable[[MotionSource, Description], Motion]
    """Reads a motion, with ``has_times=False`` if the file does not say its rate."""

    endings: tuple[str, ...] = ()
    """Extensions of its files in folders; files that are given may have any name."""

    order: str | None = None
    """Order of base quaternions: xyzw, wxyz or ``OPEN``; None: there are none."""

    assumed_rate: float | None = None
    """Rate of files without one, in [Hz]; None: it has to be given."""

    rate_of: str = ""
    """Which rate that is, for the message."""

    names: Callable[[MotionSource], Sequence[str]] = lambda _: ()
    """Lists the motions of a file that has several."""

    arrays: tuple[str, ...] = ()
    """Arrays that its files have."""

    is_text: bool = False

    writers: Mapping[str, Writer] = field(default_factory=dict)
    """By the names of the formats that they write."""
