"""The objects around a robot in the course of a motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.checks.ground_samples import GroundSamples
from g1_description.checks.intervals import GAP
from g1_description.checks.surfaces import Surfaces
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.collisions.contacts import Contacts
from g1_description.collisions.obstacles import Obstacles
from g1_description.robot.description import Description
from g1_description.robot.dynamics import Masses
from g1_description.scenes.carried import (
    Held,
    LinkPoses,
    held,
    holds_of,
    object_poses,
)

DEEP = 0.005
"""Links that collide with an object and are this deep in it, in [m], before or after do
not stand on it then."""

MARGIN = 0.05
"""Distances from objects are known up to this, in [m], or to thresholds above it."""

CLEARANCE, LEAST_CLEARANCE = "clearance", "least_clearance"
"""Names of the check of distances, and of their figure."""


def margin_of(thresholds: Thresholds) -> float:
    """Return up to which distance objects are found, in [m]."""
    level = thresholds.levels.get(CLEARANCE, Level())
    bounds = [level.warning, level.failure]
    bounds += [r.bound for r in thresholds.exclusions if r.figure == LEAST_CLEARANCE]
    return max([MARGIN, *(bound for bound in bounds if bound is not None)])


class Surroundings:
    """Where the objects of a scene are during one motion, and what is near them."""

    def __init__(
        self,
        obstacles: Obstacles,
        thresholds: Thresholds,
        robot: Description,
        link_poses: LinkPoses,
        is_fixed: bool,
        present: np.ndarray | None = None,
    ) -> None:
        """Find out which links carry objects.

        Args:
            obstacles: The robot among the objects.
            thresholds: Height of the floor, and distances.
            robot: The robot.
            link_poses: Poses of its links during the motion.
            is_fixed: Whether its base is fixed, so that there is no floor.
            present: Poses of the objects in the map if they are not those of the scene,
                shape (n_objects, 7).
        """
        objects = [*obstacles.scene.values()]
        if present is not None:
            pairs = zip(objects, present)
            objects = [replace(x, pose=pose) for x, pose in pairs]
        self.obstacles, self.objects = obstacles, objects
        self.holds = holds_of(objects, robot, link_poses)
        starts = np.array([each.pose for each in objects]).reshape(-1, 7)
        self.surfaces = Surfaces(obstacles, starts, thresholds.floor_height)
        self._margin = margin_of(thresholds)
        has_floor = not is_fixed and present is None
        self.floor = thresholds.floor_height if has_floor else -MAX_VALUE
        """Height of the floor in [m]; far below where objects do not hit any."""
        n_links = obstacles.n_links
        self._links = {n: row for row, n in enumerate(obstacles.names[:n_links])}
        first, second = obstacles.pair_rows.T
        # Rows of links, -1 for objects.
        self._first = np.where(first < n_links, first, -1)
        carried = np.where(first < n_links, -1, first - n_links)
        onto = np.where(second == len(obstacles.names) - 1, carried, second - n_links)
        self._carried = np.stack([carried, onto])

    def contacts(self, times: np.ndarray, link_poses: np.ndarray) -> Contacts:
        """Find links, and objects while they are carried, that are near objects.

        Args:
            times: Successive ones, in [s], shape (n,).
            link_poses: Poses of all links in the map, shape (n, n_links, 7).

        Returns:
            With the rows of ``Obstacles.pairs``.
        """

        def of_link(link: str, some: np.ndarray) -> np.ndarray:
            return link_poses[np.searchsorted(times, some), self._links[link]]

        poses = object_poses(self.holds, times, of_link)
        if all(len(some) == 1 for some in self.holds):
            poses = poses[0]
        margin, floor = self._margin, self.floor
        found = self.obstacles.contacts_among(link_poses, poses, margin, floor)
        first, second = self._carried[:, found.pair]
        is_carried = self.held(times).carriers >= 0
        is_held = is_carried[found.sample, first] | is_carried[found.sample, second]
        return found[np.flatnonzero((first < 0) | is_held)]

    def held(self, times: np.ndarray) -> Held:
        """Find out what holds objects at times in [s], shape (n,)."""
        return held(self.holds, times, [*self._links])

    def loaded(self, masses: Masses, times: np.ndarray) -> Masses:
        """Add what links carry at times in [s], shape (n,), to masses of the robot."""
        return self.held(times).loaded(masses, self.objects)

    def without_supports(
        self,
        times: np.ndarray,
        contacts: Contacts,
        ground: GroundSamples | None,
        rows: np.ndarray,
    ) -> Contacts:
        """Leave out links on what they stand on, and above what the robot stands on.

        That counts as floor, but for links that go through an object.

        Args:
            times: In [s], shape (n,).
            contacts: All contacts with objects.
            ground: How the robot stands, whose ``collides`` is changed; None: it is not
                known.
            rows: Rows of the links of ``ground``, shape (k,).
        """
        if ground is None or ground.below is None:
            return contacts
        tops = self.surfaces.holds(contacts)
        stood = np.unique(ground.below[ground.in_contact])
        column = np.full(len(self._links) + 1, -1)
        column[rows] = np.arange(len(rows))
        column = column[self._first[contacts.pair]]
        is_on = ground.below[contacts.sample, column] == tops
        is_on &= ground.in_contact[contacts.sample, column] & (column >= 0)
        is_in = (contacts.distance < -DEEP) & (column >= 0)
        for run in _runs_of_pairs(contacts, is_in):
            if not is_on[run].all():
                is_on[run] = False
                begin, end = times[contacts.sample[run[[0, -1]]]] + [-GAP, GAP]
                now = (times >= begin) & (times <= end)
                row = self.obstacles.pair_rows[contacts.pair[run[0]], 1]
                now &= ground.below[:, column[run[0]]] == row - self.obstacles.n_links
                ground.collides[now, column[run[0]]] = True
        is_above = (contacts.distance >= 0.0) & np.isin(tops, stood)
        is_above &= self._first[contacts.pair] >= 0
        return contacts[np.flatnonzero((tops < 0) | ~(is_on | is_above))]


def _runs_of_pairs(contacts: Contacts, mask: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the rows of contacts of each pair in successive samples."""
    for pair in np.unique(contacts.pair[mask]):
        rows = np.flatnonzero((contacts.pair == pair) & mask)
        ends = np.flatnonzero(np.diff(contacts.sample[rows]) > 1) + 1
        yield from np.split(rows, ends)
