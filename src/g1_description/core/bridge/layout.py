"""Where the links of each robot are in a message, and what they let us measure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.core.robot.assembly import SCOPE, base_of
from g1_description.core.robot.description import Description
from g1_description.core.robot.rigid import reference_links

from .joints import MeasuredJoints, measured_joints

MAX_CACHED = 64
"""Largest number of sets of links, per robot, whose joints are cached. Links may come
and go with every message, and finding the joints of a humanoid takes milliseconds."""


@dataclass(frozen=True)
class RobotLayout:
    """One robot's share of the links and joints of all robots."""

    joints: MeasuredJoints
    """Its joints; they index its own valid links."""

    links: tuple[str, ...]
    """Names of its valid links."""

    invalid: tuple[str, ...]
    """Names of its links without usable numbers, which count as missing."""

    first_link: int
    """Row of its first link among the valid links of all robots."""

    span: slice
    """Rows of its joints among those of all robots."""

    base: tuple[int, np.ndarray] | None
    """Row of the reference link of its root, or of what floats in the world, among the
    valid links of all robots, and the root's pose in the frame of that link, shape
    (7,). None if it is unknown."""

    is_present: bool
    """Whether the message has any link of the robot."""


class LinkLayout:
    """Finds the links of robots by their scoped names."""

    def __init__(self, robots: Mapping[str, Description]) -> None:
        """Begin without a message.

        Args:
            robots: The robots as in their files, by the names of their models in the
                simulated world. The name of a model inside another begins with the
                other's name and ``::``.
        """
        self._robots = list(robots.items())
        self._cache: dict = {}
        self._available: list[list[str]] = [[] for _ in robots]
        self.rows: slice | np.ndarray = slice(0, 0)
        """Rows of the robots' links in the message, one robot after the other."""
        self.duplicates: tuple[str, ...] = ()
        """Scoped names of the robots' links that the message has more than once."""

    def find(self, names: Sequence[str]) -> None:
        """Find the robots' links among the scoped names of a message.

        Args:
            names: The names. Of equal names the first counts.
        """
        index: dict[str, int] = {}
        for row, name in enumerate(names):
            index.setdefault(name, row)
        self._available = [
            [link for link in robot.link_names if f"{model}{SCOPE}{link}" in index]
            for model, robot in self._robots
        ]
        scoped = [
            f"{model}{SCOPE}{link}"
            for (model, _), links in zip(self._robots, self._available)
            for link in links
        ]
        self.rows = _as_slice(np.array([index[name] for name in scoped], dtype=int))
        counts = Counter(names) if len(index) < len(names) else {}
        self.duplicates = tuple(name for name in scoped if counts.get(name, 1) > 1)

    def arrange(self, valid: np.ndarray | None) -> list[RobotLayout]:
        """Lay out the valid links and the joints between them.

        Args:
            valid: True for each link found that has usable numbers, shape (n_found,);
                None where all have.

        Returns:
            A layout per robot.
        """
        layouts = []
        row = first_link = first_joint = 0
        for (_, robot), available in zip(self._robots, self._available):
            end = row + len(available)
            mask = [True] * len(available) if valid is None else valid[row:end].tolist()
            row = end
            links = tuple(link for link, good in zip(available, mask) if good)
            invalid = tuple(link for link, good in zip(available, mask) if not good)
            joints, base = self._structure(robot, links)
            span = slice(first_joint, first_joint + len(joints.names))
            base = base and (first_link + base[0], base[1])
            layouts.append(
                RobotLayout(
                    joints, links, invalid, first_link, span, base, bool(available)
                )
            )
            first_link += len(links)
            first_joint = span.stop
        return layouts

    def _structure(
        self, robot: Description, links: tuple[str, ...]
    ) -> tuple[MeasuredJoints, tuple[int, np.ndarray] | None]:
        """Find a robot's joints, and its base as index and pose; both are cached."""
        key = (id(robot), links)
        if key not in self._cache:
            if len(self._cache) >= MAX_CACHED * len(self._robots):
                self._cache.clear()
            base = None
            root, _ = base_of(robot)
            if root in (references := reference_links(robot, links)):
                link, T_link_root = references[root]
                base = (links.index(link), T_link_root)
            self._cache[key] = (measured_joints(robot, links), base)
        return self._cache[key]


def _as_slice(rows: np.ndarray) -> slice | np.ndarray:
    """Replace rows that follow one another by a slice, which numpy takes faster."""
    first = int(rows[0]) if len(rows) else 0
    block = slice(first, first + len(rows))
    return block if np.array_equal(rows, np.arange(block.start, block.stop)) else rows
