"""What was measured: figures, their targets, and what had to be left out."""

from __future__ import annotations

import operator
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.client import HTTPException
from pathlib import Path
from xmlrpc.client import Error

import numpy as np
from rosgraph import MasterException

from .nodes import MeasurementError

_COMPARISONS = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "=": operator.eq,
}

OWN_MODEL = Path(__file__).resolve().parents[2] / "urdf" / "g1_29dof.urdf"
# A node that ends while it is asked something breaks the connection it is asked on.
FAILURES = (MeasurementError, OSError, Error, HTTPException, MasterException)


@dataclass(frozen=True)
class Figure:
    """One number."""

    part: str
    name: str
    value: float
    unit: str = ""
    target: str = ""
    """A comparison and a number, such as ``<= 1.6``; empty where there is none."""

    @property
    def reached(self):
        """Whether the target is reached; None where there is none."""
        if not self.target:
            return None
        comparison, bound = self.target.split()
        return bool(_COMPARISONS[comparison](self.value, float(bound)))

    @property
    def words(self):
        """The value as it is shown: whole numbers whole, others to three digits."""
        if abs(self.value) >= 100.0 or self.value == int(self.value):
            return f"{self.value:.0f}"
        return f"{self.value:.3g}"


@dataclass
class Bench:
    """One run: what is measured, how long, and what came out."""

    model: Path = OWN_MODEL
    quick: bool = False
    soak: float | None = None
    seed: int = 1
    figures: list = field(default_factory=list)
    left_out: list = field(default_factory=list)
    """Part and sentence for each thing that could not be measured."""
    part: str = ""
    start: float = field(default_factory=time.monotonic)

    def seconds(self, usual, quick=2.0):
        """Give the length of a window in [s]."""
        return min(usual, quick) if self.quick else usual

    def count(self, usual, quick=20):
        """Give a number of trials."""
        return min(usual, quick) if self.quick else usual

    def say(self, text):
        """Print a line of progress."""
        passed = int(time.monotonic() - self.start)
        clock = f"{passed // 60:2d}:{passed % 60:02d}"
        print(f"[{clock}] {self.part}: {text}", flush=True)

    def add(self, name, value, unit="", target=""):
        """Keep a figure of the part that runs."""
        self.figures.append(Figure(self.part, name, float(value), unit, target))

    def add_latencies(self, name, times, targets=("", "")):
        """Keep median and 99th percentile of times in [s], as [ms]."""
        median, late = 1e3 * np.percentile(times, (50, 99))
        self.add(f"{name}, median", median, "ms", targets[0])
        self.add(f"{name}, 99th percentile", late, "ms", targets[1])

    def leave_out(self, text):
        """Keep and print why something is not measured."""
        self.left_out.append((self.part, text))
        self.say(f"left out: {text}")

    @contextmanager
    def attempt(self, what):
        """Go on where something can't be measured, and say so."""
        self.say(what)
        try:
            yield
        except FAILURES as error:
            self.leave_out(f"{what}: {error}")
