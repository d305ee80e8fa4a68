"""A rule of the checks: everything that one check is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Callable

import numpy as np

from g1_description.checks.intervals import intervals, time_share
from g1_description.checks.measured import CheckedRobot, Measure, Measured
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.checks.verdict import FAILED, WARNING, Finding
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.description import Joint


@dataclass(frozen=True, eq=False)
class Rule:
    """One check: its thresholds, what it measures, finds and shows.

    Commands, pages, RViz, reports, the file of thresholds and the documentation have
    all they know of a check from here.
    """

    name: str
    about: str
    """What is found, for the page of the documentation."""

    level: Level
    """The default thresholds."""

    limit: str
    """What these numbers are, with their unit, for the file of thresholds."""

    find: Callable[[Rule, Measured], Iterable[Finding | None]]
    """Finds what exceeds the thresholds; ``compared`` makes the findings."""

    needs: tuple[str, ...] = ()
    """What must be known of robot and motion; ``CheckedRobot.lacks`` says what there
    is, and why a check is skipped."""

    requires: str = ""
    """The same, for the documentation."""

    measure: Measure | None = None
    """Measures what no other check does; the result is ``measured.own[name]``."""

    skip: Callable[[CheckedRobot, Trajectory], str] | None = None
    """Says why the check is skipped; an empty string if it is not."""

    lower_is_worse: bool = False
    """Whether sizes below the thresholds are wrong, such as distances."""

    unit: str = ""
    """Of the sizes, where it is the same for all subjects."""

    only_at_rest: bool = False
    """Whether it says nothing of a robot that moves now."""

    is_live: bool = True
    """Whether it is made of a robot as it is now."""

    namespace: str = ""
    """RViz and the page draw findings under this name; empty: they do not."""

    label: str = "{subject}"
    """What is written beside the place of a finding, before its size."""

    reddens: bool = False
    """Whether the links of a finding are drawn in red."""

    @property
    def needs_physics(self) -> bool:
        """Whether it needs a motion that was played in physics."""
        return "physics" in self.needs

    def level_in(self, thresholds: Thresholds) -> Level:
        """Return the thresholds of this check."""
        return thresholds.levels.get(self.name, self.level)

    def skipped(self, robot: CheckedRobot, trajectory: Trajectory) -> str:
        """Say why the check cannot be made of a motion; empty if it can."""
        reasons = (robot.lacks(need, trajectory) for need in self.needs)
        why = next(filter(None, reasons), "")
        if not why and not self.level_in(robot.thresholds).is_set:
            return "it has no threshold"
        return why or (self.skip(robot, trajectory) if self.skip else "")

    def exceeds(self, sizes: np.ndarray, bound: float) -> np.ndarray:
        """Tell which sizes, of any shape, exceed a threshold; NaN exceeds none."""
        with np.errstate(invalid="ignore"):
            return sizes < bound if self.lower_is_worse else sizes > bound

    def columns(self, measured: Measured, sizes: np.ndarray) -> Sequence[int]:
        """List the columns of sizes, shape (n, k), that exceed any threshold."""
        level = self.level_in(measured.robot.thresholds)
        bounds = [b for b in (level.warning, level.failure) if b is not None]
        if not bounds:
            return []
        least = max(bounds) if self.lower_is_worse else min(bounds)
        found = np.flatnonzero(self.exceeds(sizes, least).any(axis=0))
        return [*map(int, found)]

    def severity(self, thresholds: Thresholds, size: float) -> tuple[str, float]:
        """Compare a size.

        Returns:
            ``failed`` or ``warning``, and the threshold that it exceeds; an empty
            string and NaN if it exceeds none.
        """
        level = self.level_in(thresholds)
        for severity, bound in ((FAILED, level.failure), (WARNING, level.warning)):
            if bound is not None and self.exceeds(np.asarray(size), bound):
                return severity, bound
        return "", np.nan

    def compared(
        self,
        measured: Measured,
        subject: tuple[str, ...],
        sizes: np.ndarray,
        text: str,
        unit: str = "",
        points: np.ndarray | None = None,
    ) -> Finding | None:
        """Compare sizes with the thresholds.

        Args:
            measured: The motion.
            subject: Names of the joint, of the link or of both links.
            sizes: At each time, shape (n,); NaN where it is not known.
            text: A sentence on the worst of it, with ``{worst}``, and with ``{when}``,
                which becomes " at 1.234 s", or nothing for a single configuration.
            unit: Of the sizes, if it is not that of the rule.
            points: Where it is, in the map, in [m], shape (n, 3) or (n, k, 3).

        Returns:
            The finding; None if no size exceeds a threshold.
        """
        times = measured.times
        if self.lower_is_worse:
            sizes = np.where(np.isnan(sizes), np.inf, sizes)
            at = int(np.argmin(sizes))
        else:
            sizes = np.where(np.isnan(sizes), -np.inf, sizes)
            at = int(np.argmax(sizes))
        worst, worst_time = float(sizes[at]), float(times[at])
        severity, bound = self.severity(measured.robot.thresholds, worst)
        if not severity:
            return None
        is_beyond = self.exceeds(sizes, bound)
        rows = () if points is None else np.reshape(points[at], (-1, 3)).tolist()
        when = f" at {worst_time:.3f} s" if len(times) > 1 else ""
        return Finding(
            self.name,
            severity,
            subject,
            worst,
            bound,
            unit or self.unit,
            float(times[np.argmax(is_beyond)]),
            worst_time,
            time_share(times, is_beyond),
            intervals(times, is_beyond),
            text.format(worst=worst, when=when),
            tuple((x, y, z) for x, y, z in rows),
        )


def units(joint: Joint) -> tuple[str, str]:
    """Return the units of a joint's position and effort."""
    return ("m", "N") if joint.kind == "prismatic" else ("rad", "N m")
