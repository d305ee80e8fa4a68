"""Contact forces: what the floor would have to do for a motion.

Inverse dynamics has the wrench that a motion needs. Forces at the points of contact
stay in pyramids of friction (Caron, Pham and Nakamura, ICRA 2015) and are found by
nonnegative least squares (Lawson and Hanson, Solving Least Squares Problems, 1974):
what is missing is as small as possible, then the efforts of the joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Callable

import numpy as np
from scipy.optimize import nnls

from g1_description.checks.ground_samples import GroundSamples
from g1_description.checks.measured import CheckedRobot, Measured
from g1_description.checks.support import LEAST_FORCE, support_polygon
from g1_description.robot.description import Description
from g1_description.robot.dynamics import GRAVITY, Masses
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import cross
from g1_description.robot.transform import IDENTITY

FRICTION, MOST_FRICTION = 0.6, 10.0
"""Coefficient of friction of links whose file has none, and the largest one: files may
have an infinite one."""

FLAT, UNEVEN = 0.01, 0.015
"""Points of contact are at most this far above the lowest one of their link, and of the
robot, in [m]."""

MOST_POINTS = 8
"""Of more points of a link, the corners of their convex hull are used."""

PRIORITY = 1e4
"""Weight of the missing wrench in comparison with efforts."""

DETERMINED = 0.1
"""Efforts are known where less than this part of the weight is missing."""

ROUNDS = 6
"""Rounds in which efforts beyond limits are reduced."""


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Forces of the floor during a motion, as far as friction and contacts allow them.

    Forces, moments and points are along the map's axes. Values are NaN where
    accelerations are not known: at the ends of a motion, and near jumps.
    """

    times: np.ndarray
    """In [s], shape (n,)."""

    links: tuple[str, ...]
    """Links that are near the floor at any time."""

    forces: np.ndarray
    """Forces of the floor on these links in [N], shape (n, n_links, 3)."""

    points: np.ndarray
    """Their centres of pressure in [m], shape (n, n_links, 3); NaN without a force."""

    needed: np.ndarray
    """Force, and moment about the centre of mass, that the motion needs, in [N] and
    [N m], shape (n, 6)."""

    missing: np.ndarray
    """The part of ``needed`` that no contact can give, shape (n, 6)."""

    weight: np.ndarray
    """Weight of the robot and of what it carries, in [N], shape (n,)."""

    missing_share: np.ndarray
    """Size of ``missing`` in weights, shape (n,). Moments count as forces at the
    robot's radius of gyration."""

    center_of_mass: np.ndarray
    """In [m], shape (n, 3)."""

    in_contact: np.ndarray
    """Whether a link touches the floor in the window of accelerations, shape (n,)."""

    available_friction: np.ndarray
    """Least coefficient of friction of the links in contact, shape (n,); infinite
    without one."""

    joint_names: tuple[str, ...]
    """The movable joints."""

    efforts: np.ndarray
    """Their efforts with these forces in [N m] or [N], shape (n, n_joints); NaN also
    where more than 10 % of the weight is missing."""

    contacts: Callable[[int], np.ndarray]
    """Returns the points at which the floor can push at a sample, in [m], shape
    (k, 3)."""

    @property
    def friction(self) -> np.ndarray:
        """Coefficient of friction that is needed at least, shape (n,).

        NaN where the motion needs next to no force upwards.
        """
        least, up = LEAST_FORCE * self.weight, self.needed[:, 2]
        up = np.where(up > least, up, np.nan)
        return np.asarray(np.hypot(self.needed[:, 0], self.needed[:, 1]) / up)


def contact_forces(measured: Measured, is_known: np.ndarray) -> ContactForces:
    """Find the forces that a motion needs.

    Args:
        measured: A motion of a robot on a floor, with its contacts and dynamics.
        is_known: Where accelerations are known, shape (n,).
    """
    robot, ground, balance = measured.robot, measured.ground, measured.balance
    assert ground is not None
    assert balance is not None
    assert measured.wrench is not None
    assert measured.efforts is not None
    assert measured.weight is not None
    center, needed = balance.center, measured.wrench.copy()
    needed[:, 3:] -= cross(center, needed[:, :3])
    pushes = ground.in_contact | robot.ground.lonely(ground, measured.times)
    shape = pushes.shape
    forces, moments = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    found, efforts = np.zeros(needed.shape), measured.efforts.copy()
    points, floor = _Points(ground, pushes), _Floor(robot, ground)
    window = robot.thresholds.window
    sources = _sources(pushes, measured.times, window)
    sources[~is_known] = -1
    for piece in measured.chunks():
        base, positions = measured.at(measured.times[piece])[:2]
        _, origin, axis = robot.kinematics.place(base, positions)
        screws = robot.kinematics.joint_screws(origin, axis)
        for rows, index in points.grouped(sources[piece]):
            at = rows + piece.start
            place, column = points.places[index], points.columns[index]
            each, efforts[at] = floor.forces(
                screws[rows], place, column, center[at], needed[at], efforts[at]
            )
            sample = np.broadcast_to(at[:, np.newaxis], column.shape)
            np.add.at(forces, (sample, column), each)
            np.add.at(moments, (sample, column), place * each[..., 2:])
            lever = place - center[at, np.newaxis]
            found[at] = np.concatenate([each, cross(lever, each)], axis=-1).sum(axis=1)
    missing = needed - found
    share = floor.size(missing) / measured.weight
    unknown = ~is_known
    for array in (forces, needed, missing, share):
        array[unknown] = np.nan
    efforts[~(np.nan_to_num(share, nan=np.inf) < DETERMINED)] = np.nan
    up = np.where(forces[..., 2:] > 0.0, forces[..., 2:], np.nan)
    names = tuple(joint.name for joint in robot.joints)
    return ContactForces(
        measured.times,
        measured.ground_links,
        forces,
        moments / up,
        needed,
        missing,
        measured.weight,
        share,
        center,
        (sources >= 0).any(axis=1),
        np.where(sources >= 0, floor.friction, np.inf).min(axis=1),
        names,
        efforts,
        lambda at: points.at(sources[at]),
    )


def reach(lowest: np.ndarray) -> np.ndarray:
    """Return up to which height points are in contact, for that of the lowest, in [m].

    A point in the floor counts as at most half of ``FLAT`` deep.
    """
    return np.asarray(np.maximum(lowest, -FLAT / 2.0) + UNEVEN)


def _sources(in_contact: np.ndarray, times: np.ndarray, window: float) -> np.ndarray:
    """Find when links are in contact nearest to each time.

    Accelerations are means over a window: they have forces of contacts that begin or
    end within.

    Returns:
        Rows of samples, -1 without contact within the window, shape (n, n_links).
    """
    count = len(times)
    rows = np.arange(count)[:, np.newaxis]
    last = np.maximum.accumulate(np.where(in_contact, rows, -1))
    after = np.where(in_contact, rows, count)[::-1]
    following = np.minimum.accumulate(after)[::-1]
    ends = np.append(times, [np.inf, -np.inf])
    before, ahead = times[:, np.newaxis] - ends[last], ends[following]
    ahead = ahead - times[:, np.newaxis]
    nearest = np.where(before <= ahead, last, following)
    return np.where(np.minimum(before, ahead) < window, nearest, -1)


class _Points:
    """The points at which links touch the floor."""

    def __init__(self, ground: GroundSamples, pushes: np.ndarray) -> None:
        """Sort those of links that push by sample and link, without higher ones."""
        count, self._n_links = pushes.shape
        is_used = pushes[ground.low[0], ground.low[1]]
        sample, column = ground.low[:, is_used]
        heights, points = ground.low_heights[is_used], ground.low_points[is_used]
        key = sample * self._n_links + column
        of_link, of_all = np.full(count * self._n_links, np.inf), np.full(count, np.inf)
        np.minimum.at(of_link, key, heights)
        np.minimum.at(of_all, sample, heights)
        low = heights <= np.minimum(of_link[key] + FLAT, reach(of_all[sample]))
        key = key[low]
        order = np.argsort(key, kind="stable")
        key, places = key[order], points[low][order]
        keys = np.arange(count * self._n_links + 1)
        starts = np.searchsorted(key, keys)
        is_kept = np.ones(len(key), dtype=bool)
        for group in np.flatnonzero(np.diff(starts) > MOST_POINTS):
            rows = slice(starts[group], starts[group + 1])
            corners = set(support_polygon(places[rows, :2]))
            is_kept[rows] = [(x, y) in corners for x, y in places[rows, :2].tolist()]
        key, places = key[is_kept], places[is_kept]
        self._starts = np.searchsorted(key, keys)
        self.places = places
        """In the map, in [m], shape (m, 3)."""
        self.columns = key % self._n_links
        """Columns of their links, shape (m,)."""

    def at(self, sources: np.ndarray) -> np.ndarray:
        """Return the points of one sample, shape (k, 3); sources as for ``grouped``."""
        found = [index for _, index in self.grouped(sources[np.newaxis])]
        return self.places[found[0][0]] if found else np.zeros((0, 3))

    def grouped(self, sources: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Group samples by their numbers of points.

        Args:
            sources: Samples of the contacts of each link, shape (n, n_links).

        Yields:
            Rows of samples, shape (g,), and their points, shape (g, k), k > 0.
        """
        row, column = np.nonzero(sources >= 0)
        group = sources[row, column] * self._n_links + column
        first, size = self._starts[group], np.diff(self._starts)[group]
        inside = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
        index = np.repeat(first, size) + inside
        counts = np.bincount(np.repeat(row, size), minlength=len(sources))
        starts = np.cumsum(counts) - counts
        for count in np.unique(counts[counts > 0]):
            rows = np.flatnonzero(counts == count)
            yield rows, index[starts[rows, np.newaxis] + np.arange(count)]


class _Floor:
    """What the floor can do for a robot."""

    def __init__(self, robot: CheckedRobot, ground: GroundSamples) -> None:
        links = robot.ground.rows[ground.columns]
        self._above = robot.kinematics.joints_above[links]
        limits = np.array([joint.effort for joint in robot.joints])
        is_limited = np.isfinite(limits) & (limits > 0.0)
        self._joints = np.flatnonzero(self._above.any(axis=0) & is_limited)
        self._limits = limits[self._joints]
        names = [robot.links[row] for row in links]
        self.friction = _frictions(robot.description, names)
        weight = float(robot.masses.total) * GRAVITY
        lever = max(_radius_of_gyration(robot.kinematics, robot.masses), 0.01)
        self._scale = np.array([weight] * 3 + [weight * lever] * 3)
        self._weight = weight

    def size(self, wrench: np.ndarray) -> np.ndarray:
        """Compute the size of wrenches in [N], shape (n,)."""
        return np.asarray(self._weight * np.linalg.norm(wrench / self._scale, axis=-1))

    def forces(
        self,
        screws: np.ndarray,
        place: np.ndarray,
        column: np.ndarray,
        center: np.ndarray,
        needed: np.ndarray,
        efforts: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the forces at points of contact.

        Args:
            screws: Screws of the joints, shape (n, n_joints, 6).
            place: Points in the map in [m], shape (n, k, 3).
            column: Columns of their links, shape (n, k).
            center: Centres of mass in [m], shape (n, 3).
            needed: Force, and moment about the centre of mass, shape (n, 6).
            efforts: Efforts of the joints without contacts, shape (n, n_joints).

        Returns:
            Forces in [N], shape (n, k, 3), and efforts with these.
        """
        count, n_points = column.shape
        edges = np.reshape(self._edges(needed, column), (count, 4 * n_points, 3))
        at = np.repeat(place, 4, axis=1)
        moments = np.concatenate([edges, cross(at - center[:, np.newaxis], edges)], 2)
        balance = np.swapaxes(moments * self._weight / self._scale, 1, 2)
        wrench = np.concatenate([edges, cross(at, edges)], axis=2) * self._weight
        mask = self._above[np.repeat(column, 4, axis=1)]
        moved = screws @ np.swapaxes(wrench, 1, 2) * np.swapaxes(mask, 1, 2)
        own, limits = self._joints, self._limits
        left = [PRIORITY * balance, moved[:, own] / limits[:, np.newaxis]]
        right = [PRIORITY * needed / self._scale, efforts[:, own] / limits]
        problems = zip(np.concatenate(left, axis=1), np.concatenate(right, axis=1))
        sizes = np.array([_least_efforts(a, b) for a, b in problems])[..., np.newaxis]
        each = np.reshape(sizes * edges * self._weight, (count, n_points, 4, 3))
        return each.sum(axis=2), efforts - (moved @ sizes)[..., 0]

    def _edges(self, needed: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Find the edges of pyramids of friction, shape (n, k, 4, 3).

        One is along the horizontal force that is needed: a pyramid inside of the cone
        has all of its friction there.
        """
        turns = np.arctan2(needed[:, 1], needed[:, 0])[:, np.newaxis]
        turns = turns + np.arange(4) * np.pi / 2.0
        along = np.stack([np.cos(turns), np.sin(turns)], axis=-1)[:, np.newaxis]
        edges = np.ones((*column.shape, 4, 3))
        edges[..., :2] = self.friction[column][..., np.newaxis, np.newaxis] * along
        return edges


def _least_efforts(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve one sample; reduce the largest effort where it is beyond its limit.

    Lawson's method, 1961: residuals that are large weigh more in each round.

    Args:
        left: Wrench and efforts per size of each generator, shape (6 + m, k).
        right: Wrench and efforts that are needed, shape (6 + m,).

    Returns:
        Sizes of the generators, shape (k,).
    """
    best = _nonnegative(left, right)
    efforts = np.abs(left[6:] @ best - right[6:])
    least = efforts.max(initial=0.0)
    weights = np.ones(len(right))
    for _ in range(ROUNDS if least > 1.0 else 0):
        weights[6:] *= efforts
        weights[6:] /= max(weights[6:].max(), 1e-12)
        sizes = _nonnegative(left * weights[:, np.newaxis], right * weights)
        if np.isnan(sizes).any():
            break
        efforts = np.abs(left[6:] @ sizes - right[6:])
        if efforts.max() < least:
            best, least = sizes, efforts.max()
    return best


def _nonnegative(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve a nonnegative least squares problem; NaN if its rounds are used up."""
    try:
        return np.asarray(nnls(left, right)[0])
    except RuntimeError:
        return np.full(left.shape[1], np.nan)


def _frictions(description: Description, links: list[str]) -> np.ndarray:
    """List the coefficients of friction of links, shape (n,)."""
    given = {
        link.name: [c.friction for c in link.collisions] for link in description.links
    }
    found = [
        min((mu for mu in given[name] if mu is not None), default=FRICTION)
        for name in links
    ]
    return np.minimum(np.array(found, dtype=float), MOST_FRICTION)


def _radius_of_gyration(kinematics: Kinematics, masses: Masses) -> float:
    """Compute the radius of gyration of a robot with its joints at zero, in [m]."""
    poses = kinematics.link_poses(IDENTITY, np.zeros(kinematics.joints_above.shape[1]))
    away = masses.centers(poses) - masses.robot_center(poses)
    own = np.trace(masses.inertia, axis1=1, axis2=2) / 2.0
    square = masses.mass @ (away**2).sum(axis=1) + own.sum()
    return float(np.sqrt(square / masses.total))
