"""The definition of a check."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Callable

import numpy as np

from g1_description.checks.intervals import intervals, time_share
from g1_description.checks.measured import CheckedRobot, Measure, Measured
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.checks.verdict import FAILED, WARNING, Finding
from g1_description.motion.motion import Motion
from g1_description.robot.description import Joint


@dataclass(frozen=True, eq=False)
class Rule:
    """One check: its thresholds, measurements, findings and markers.

    Commands, the web page, RViz, reports, the file of thresholds and the documentation
    are generated from these.
    """

    name: str
    about: str
    """Description for the documentation."""

    level: Level
    """The default thresholds."""

    limit: str
    """Meaning and unit of the thresholds, for their file."""

    find: Callable[[Rule, Measured], Iterable[Finding | None]]
    """Returns the findings, as made by ``compared``."""

    needs: tuple[str, ...] = ()
    """Required data of robot and motion, as in ``CheckedRobot.lacks``; without them the
    check is skipped."""

    requires: str = ""
    """The requirements, for the documentation."""

    measure: Measure | None = None
    """Own measurement of the check; the result is ``measured.own[name]``."""

    skip: Callable[[CheckedRobot, Motion], str] | None = None
    """Returns why the check is skipped; empty if it is not."""

    lower_is_worse: bool = False
    """Whether sizes below the thresholds are findings, as for distances."""

    unit: str = ""
    """Unit of the sizes, if it is the same for all subjects."""

    only_at_rest: bool = False
    """Whether it applies only to a robot at rest."""

    is_live: bool = True
    """Whether it applies to the current state of a robot."""

    namespace: str = ""
    """Namespace of the markers in RViz and on the page; empty: none."""

    label: str = "{subject}"
    """Label of a finding's marker, followed by its size."""

    grouping: str = ""
    """Which findings have the same cause: ``BY_LIMBS`` or ``BY_TIME``;
    empty: none."""

    reddens: bool = False
    """Whether the links of a finding are drawn in red."""

    @property
    def needs_physics(self) -> bool:
        """Whether it needs a simulated motion."""
        return "physics" in self.needs

    def level_in(self, thresholds: Thresholds) -> Level:
        """Return the thresholds of this check."""
        return thresholds.levels.get(self.name, self.level)

    def skipped(self, robot: CheckedRobot, motion: Motion) -> str:
        """Return why the check is skipped for a motion; empty if it is not."""
        reasons = (robot.lacks(need, motion) for need in self.needs)
        why = next(filter(None, reasons), "")
        if not why and not self.level_in(robot.thresholds).is_set:
            return "disabled: no threshold is set"
        return why or (self.skip(robot, motion) if self.skip else "")

    def lowest(self, thresholds: Thresholds) -> float:
        """Return the threshold at which findings begin; NaN if none is set."""
        level = self.level_in(thresholds)
        bounds = [b for b in (level.warning, level.failure) if b is not None]
        return (max if self.lower_is_worse else min)(bounds, default=np.nan)

    def exceeds(self, sizes: np.ndarray, bound: float) -> np.ndarray:
        """Compare sizes of any shape with a threshold; NaN does not exceed it."""
        with np.errstate(invalid="ignore"):
            return sizes < bound if self.lower_is_worse else sizes > bound

    def columns(self, measured: Measured, sizes: np.ndarray) -> Sequence[int]:
        """List the columns of sizes, shape (n, k), that exceed any threshold."""
        least = self.lowest(measured.robot.thresholds)
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
        spans: np.ndarray | None = None,
    ) -> Finding | None:
        """Compare sizes with the thresholds.

        Args:
            measured: The motion.
            subject: Names of the joint, of the link or of both links.
            sizes: At each time, shape (n,); NaN where it is not known.
            text: Message with ``{worst}`` and ``{when}``, which becomes " at 1.234 s",
                or nothing for a single configuration.
            unit: Unit of the sizes; empty: that of the rule.
            points: Points to mark, in the map, in [m], shape (n, 3) or (n, k, 3).
            spans: Sizes that are compared for the intervals, shape (n,); None: the
                same.

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
        is_beyond = self.exceeds(sizes if spans is None else spans, bound)
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
