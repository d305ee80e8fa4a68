"""Keeps links, and the objects that they carry, away from the objects of a scene."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from g1_description.collisions.contacts import Contacts
from g1_description.collisions.obstacles import FLAT, Obstacles
from g1_description.ik.limits import (
    INFLUENCE,
    BatchLimit,
    Course,
    LinkPart,
    SampledApproach,
    link_parts,
)
from g1_description.ik.tasks import LinkTask
from g1_description.robot.description import Description
from g1_description.robot.dynamics import Masses
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.rotation import conjugate, normalized, rotate
from g1_description.scenes.carried import (
    Held,
    LinkPoses,
    applying,
    held,
    holds_of,
    object_poses,
)
from g1_description.scenes.scene import Scene

DISTANCE = 0.002
"""Least distance of links from objects, in [m]. Feet and objects that are carried may
touch others: they are put on them."""

STANDING = 0.01
"""Distance up to which a link stands on an object, in [m]."""

TAKING = 0.1
"""Time in [s] for which an object that a link has taken in a trajectory may touch what
it was put on: there the link could not move, as the object would move with it."""

TOUCHING = 1e-3
"""Room in [m] below which an object is in the way."""

MAX_NAMED = 3
"""Most contacts in a message."""


class ObstacleScene:
    """The objects around a robot, and what holds them."""

    def __init__(self, description: Description, scene: Scene) -> None:
        """Prepare the shapes.

        Raises:
            UnknownNameError: If a link or object is named that does not exist.
        """
        self._description, self.scene = description, scene.copy()
        self.obstacles = Obstacles(description, scene)
        """The shapes."""

    def is_for(self, scene: Scene) -> bool:
        """Return whether the shapes are those of a scene, wherever its objects are."""
        return len(scene) == len(self.scene) and all(
            now.link is before.link
            and now.attachments == before.attachments
            and now.may_touch == before.may_touch
            for now, before in zip(scene.values(), self.scene.values())
        )

    def moved(self, scene: Scene) -> ObstacleScene:
        """Return them with the objects where they are in another scene."""
        found = copy(self)
        found.scene = scene.copy()
        return found

    def held(self, times: np.ndarray, course: Course) -> Held:
        """Find out what holds objects.

        Args:
            times: In [s], shape (n,).
            course: Where links are, as far as that is known.
        """
        objects, names = [*self.scene.values()], self.obstacles.names
        holds = holds_of(objects, self._description, _links(course, names))
        return held(holds, times, names)

    def loaded(
        self, times: np.ndarray, masses: Masses, rows: np.ndarray, course: Course
    ) -> Masses:
        """Add what links carry to the masses of the robot.

        Args:
            times: As for ``held``.
            masses: Of the robot.
            rows: Of the times at which they carry that.
            course: As for ``held``.
        """
        if not any(each.mass and each.attachments for each in self.scene.values()):
            return masses
        return self.held(times[rows], course).loaded(masses, self.scene.values())

    def frame_of(
        self, name: str, times: np.ndarray, course: Course
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find out where an object is, and what carries it.

        Args:
            name: The object.
            times: As for ``held``.
            course: Likewise.

        Returns:
            T_map_object, shape (n, 7), and names of links, empty for none, shape (n,).

        Raises:
            UnknownNameError: If there is none of the name.
        """
        links = _links(course, self.obstacles.names)
        holds = holds_of([self.scene[name]], self._description, links)
        carriers = np.array([hold.link for hold in holds[0]])
        poses = object_poses(holds, times, links)[:, 0]
        return poses, carriers[applying(holds[0], times)]

    def stood_on(
        self, tasks: Sequence[LinkTask], link_poses: np.ndarray
    ) -> dict[int, np.ndarray]:
        """Find the links that stand on flat tops of objects.

        Args:
            tasks: Poses of links.
            link_poses: Poses of all links at the start, shape (n_links, 7).

        Returns:
            Whether they do in each sample, shape (n,), by the rows of links.
        """
        rows = [task.link for task in tasks]
        count = max(len(np.atleast_2d(task.pose)) for task in tasks)
        poses = np.repeat(link_poses[np.newaxis], count, axis=0)
        for task in tasks:
            poses[:, task.link] = task.link_pose
        # Feet are at rest in most samples.
        some, which = np.unique(poses[:, rows], axis=0, return_inverse=True)
        first = np.array([int(np.argmax(which == row)) for row in range(len(some))])
        still = np.array([each.pose for each in self.scene.values()])
        near = self.obstacles.contacts_among(poses[first], still, STANDING)
        is_flat = -near.normal[:, 2] > FLAT
        links = self.obstacles.pair_rows[near.pair, 0]
        return {
            row: np.isin(which, near.sample[is_flat & (links == row)]) for row in rows
        }


class ObstacleLimit(BatchLimit):
    """Keeps links, and what they carry, away from objects."""

    reached = "a link is at an object"

    def __init__(
        self,
        surroundings: ObstacleScene,
        times: np.ndarray,
        but_for: Collection[int] = (),
        feet: Collection[int] = (),
    ) -> None:
        """Prepare the pairs.

        Args:
            surroundings: The objects.
            times: Of the configurations in [s], shape (n,).
            but_for: Rows of links that stay where they are.
            feet: Rows of links that may touch objects.
        """
        self._surroundings, self._times = surroundings, times
        self._obstacles = surroundings.obstacles
        self._pairs = surroundings.obstacles.pair_rows
        n_links = self._obstacles.n_links
        self._movers = np.arange(n_links)
        self._movers[[*but_for]] = -1
        first = self._pairs[:, 0]
        may_touch = np.isin(first, [*feet]) | (first >= n_links)
        self._least = np.where(may_touch, 0.0, DISTANCE)
        self._held: Held | None = None
        self._is_taken = np.zeros((0, 0), dtype=bool)
        self._parts: dict[int, list[LinkPart]] = {}
        for part in link_parts(each.link for each in surroundings.scene.values()):
            self._parts.setdefault(part.row, []).append(part)

    def at(self, rows: np.ndarray, course: Course) -> ObstacleLimit:
        """Return the limit of some configurations."""
        found = copy(self)
        times = self._times[rows]
        now = found._held = self._surroundings.held(times, course)
        begins = np.maximum(now.begins, course.times[0])
        found._is_taken = (now.carriers >= 0) & (times[:, np.newaxis] < begins + TAKING)
        return found

    def approaches(self, jacobians: Jacobians) -> SampledApproach:
        """Linearize the distances of what is near objects."""
        found, first, second = self._near(jacobians.link_poses)
        rates = np.zeros((len(first), 3, jacobians.n_columns))
        for sign, rows, points in (
            (1.0, first, found.points_a),
            (-1.0, second, found.points_b),
        ):
            moves = np.flatnonzero(rows >= 0)
            given = found.sample[moves], rows[moves], points[moves]
            rates[moves] += sign * jacobians.of_each(*given)
        rates = (found.normal[:, np.newaxis] @ rates)[:, 0]
        return found.sample, (rates, found.distance - self._least[found.pair])

    def _near(self, link_poses: np.ndarray) -> tuple[Contacts, np.ndarray, np.ndarray]:
        """Find contacts, and the rows of links that move each side, -1: none."""
        assert self._held is not None
        objects = self._held.placed(link_poses)
        reach = DISTANCE + INFLUENCE
        found = self._obstacles.contacts_among(link_poses, objects, reach)
        links = np.tile(self._movers, (len(link_poses), 1))
        movers = np.concatenate([links, self._held.carriers], axis=1)
        first, second = movers[found.sample[:, np.newaxis], self._pairs[found.pair]].T
        is_near = first != second
        if len(link_poses) > 1:
            is_taken = np.pad(self._is_taken, ((0, 0), (links.shape[1], 0)))
            both = is_taken[found.sample[:, np.newaxis], self._pairs[found.pair]]
            is_near &= ~both.any(axis=1)
        moves = np.flatnonzero(is_near)
        found, first, second = found[moves], first[moves], second[moves]
        others = [*self._corners(found, objects)]
        rows = np.array([row for row, _ in others], dtype=int)
        all_ = Contacts.joined([found, *(corners for _, corners in others)])
        rows = np.concatenate([np.arange(len(first)), rows])
        order = np.argsort(all_.sample, kind="stable")
        return all_[order], first[rows][order], second[rows][order]

    def _corners(
        self, found: Contacts, objects: np.ndarray
    ) -> Iterator[tuple[int, Contacts]]:
        """Find other corners of carried objects near the planes of their contacts.

        With only the deepest one, steps would rock a box that is put down.

        Yields:
            Numbers of contacts, and one that has the same plane.
        """
        carried = self._pairs[found.pair, 0] - len(self._movers)
        for row in np.flatnonzero(carried >= 0):
            pose, normal = objects[found.sample[row], carried[row]], found.normal[row]
            inward = rotate(conjugate(pose[3:]), normal)
            plane = found.points_b[row] @ normal
            for part in self._parts[carried[row]]:
                ends = part.points @ inward + part.radii
                farthest = int(np.argmax(ends))
                distance = plane - normal @ pose[:3] - ends[farthest]
                if distance < DISTANCE + INFLUENCE:
                    point = pose[:3] + rotate(pose[3:], part.points[farthest])
                    point += part.radii[farthest] * normal
                    one = found[np.array([row])]
                    yield (
                        int(row),
                        replace(
                            one,
                            distance=np.array([distance]),
                            points_a=point[np.newaxis],
                            points_b=(point + distance * normal)[np.newaxis],
                        ),
                    )

    def excess_message(self, excess: float) -> str:
        """Describe by how much something is too near, in [m]."""
        return f"a link is {1e3 * excess:.0f} mm too near to an object"

    def contacts_at(self, link_poses: np.ndarray) -> Iterator[str]:
        """Describe what is at objects in a configuration, the deepest first.

        Args:
            link_poses: Poses of links, shape (n_links, 7).
        """
        found, _, _ = self._near(link_poses[np.newaxis])
        room = found.distance - self._least[found.pair]
        for row in np.argsort(room)[:MAX_NAMED]:
            if room[row] < TOUCHING:
                one, other = self._obstacles.pairs[found.pair[row]]
                depth = -1e3 * found.distance[row]
                is_deep = room[row] < -TOUCHING and depth >= 0.5
                yield f"{one} is {f'{depth:.0f} mm in' if is_deep else 'at'} {other}"


def _links(course: Course, names: Sequence[str]) -> LinkPoses:
    """Interpolate the poses of links."""

    def link_poses(link: str, times: np.ndarray) -> np.ndarray:
        at = np.interp(times, course.times, np.arange(len(course.times)))
        before = np.floor(at).astype(int)
        after = np.minimum(before + 1, len(course.times) - 1)
        poses = course.link_poses[:, names.index(link)]
        first, second, share = poses[before], poses[after], (at - before)[:, np.newaxis]
        same = np.where((first * second)[:, 3:].sum(axis=1) < 0.0, -1.0, 1.0)
        second = second * np.where(np.arange(7) < 3, 1.0, same[:, np.newaxis])
        found = (1.0 - share) * first + share * second
        return np.concatenate([found[:, :3], normalized(found[:, 3:])], axis=1)

    return link_poses
