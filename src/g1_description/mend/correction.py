"""Corrections of base and joints: feet, limits, collisions, speed and balance."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from g1_description.checks.intervals import intervals, near
from g1_description.checks.measured import Measured
from g1_description.checks.support import nearest_point, support_margin, support_polygon
from g1_description.mend.body import N_BASE, Change, changed
from g1_description.mend.contacts import LOW, placed_points, stances
from g1_description.motion.motion import Motion
from g1_description.robot.description import limits_of
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.transform import compose, inverse

ROUNDS = 12
"""Rounds of Gauss and Newton's method."""

FURTHEST, ENOUGH = 0.2, 2e-4
"""Largest change in a round, and one with which it ends, in [rad] or [m]."""

STALLED, KNOWN = 0.7, 5
"""It also ends if a change is larger than this multiple of the one before, from a round
on when most of what is wrong is known."""

PIECE, OVERLAP = 800, 200
"""Samples that are solved for together, and those of them that the next piece solves
for, too, but for the first half."""

JOINT, PLACE, TURN = 0.1, 0.3, 0.1
"""Tolerances of changes: of joints in [rad] or [m], of the base in [m] and [rad]."""

SMOOTH = (1.0, 0.3, 1.0, 6.0)
"""Tolerances of accelerations of the change: of the base along the floor and upwards in
[m/s^2], of its rotation in [rad/s^2], and of joints in [rad/s^2] or [m/s^2]."""

KEPT, KEPT_SMOOTH = 0.03, 0.3
"""Tolerances of the base's place in [m], and of accelerations of its change along the
floor in [m/s^2], if it keeps near its path."""

SHORTEST = 1e-3
"""Least distance of samples for accelerations of the change, in [s]."""

START = 1e-3
"""Tolerance of the place of feet at the first sample, or else of that and the heading
of the base, in [m] and [rad]."""

LOCK, MOVE = 1e-4, 1e-3
"""Tolerances of a foot's steps between samples: where it stands, and where it moves
near the floor, in [m]."""

HEIGHT, DEPTH, CENTER = 2e-4, 3e-4, 1e-3
"""Tolerances of heights, distances of links and the centre of mass, in [m]."""

PALM, HAND = 0.1 * np.eye(4, 3, -1), (3e-3, 2e-2, 2e-2, 2e-2)
"""Points of hands that keep their paths, in the frame of the link, and their tolerances
in [m]: places are kept better than rotations."""

BOUND, RATE = 1e-4, 1e-4
"""Tolerances of limits of joints, and of their steps, in [rad] or [m]."""

ALONE = 5e-3
"""Tolerance of heights where nothing is corrected, in [m]."""

LIFTED = 0.012
"""Height of a foot that was dragged, in [m]."""

APART, MARGIN = 5e-4, 0.005
"""Distance of links that were pushed apart, and up to which it is measured, in [m]."""

WITHIN = 0.02
"""Distance of the centre of mass from the edge of the support polygon, in [m]."""

FAR = 0.05
"""A centre of mass farther out, in [m], is not moved inwards: it is no standstill."""

AROUND = 0.5
"""The centre of mass is moved inwards up to this time from a standstill, in [s]: the
robot would move through it else."""

SPEED, STRONG = 0.98, 1e-2
"""Fraction of the limit that joints reach which were too fast, and tolerance of their
accelerations in bounds."""


class Correction:
    """Finds the change of a motion that removes what is wrong with it."""

    def __init__(
        self,
        measured: Measured,
        parts: Collection[str],
        keeps_hands: bool = False,
        keeps_base: bool = False,
    ) -> None:
        """Find what has to be corrected.

        Args:
            measured: The motion, with ground and balance.
            parts: What is corrected, of ``feet``, ``limits``, ``collisions``, ``speed``
                and ``balance``.
            keeps_hands: Whether the ends of arms keep their paths.
            keeps_base: Whether the base keeps near its path.
        """
        self._place, self._smoothness = PLACE, [*SMOOTH]
        if keeps_base:
            self._place, self._smoothness[0] = KEPT, KEPT_SMOOTH
        self._measured, self._parts = measured, parts
        self._robot = measured.robot
        motion = measured.motion
        self._times = motion.times
        self._bases, self._positions = measured.at(motion.times)[:2]
        self._poses = self._robot.kinematics.link_poses(self._bases, self._positions)
        self._has_base = motion.base_poses is not None
        self._moved = np.isin(
            [joint.name for joint in self._robot.joints], motion.joint_names
        )
        on_floor = self._has_base and measured.ground is not None
        self._stances = stances(measured) if on_floor else []
        self._hands = self._ends() if keeps_hands else []
        self._tips = self._unbalanced()
        self._total: np.ndarray | None = None
        self.excluded = np.zeros(len(self._times), dtype=bool)
        """Samples at which nothing is corrected."""

    def _ends(self) -> list[int]:
        """List the rows of the ends of limbs that never stand."""
        used = {stance.link for stance in self._stances}
        rows = self._robot.kinematics.limb_ends().tolist()
        return [row for row in rows if row not in used]

    def _unbalanced(self) -> np.ndarray:
        """Mark samples out of balance at a standstill, and just before and after it."""
        balance, times = self._measured.balance, self._times
        if balance is None:
            return np.zeros(len(times), dtype=bool)
        at = np.searchsorted(self._measured.times, times)
        margin = balance.center_margin[at]
        with np.errstate(invalid="ignore"):
            is_out = (margin < WITHIN) & (margin > -FAR)
        still = intervals(times, is_out & balance.is_still[at])
        return is_out & near(times, still, AROUND)

    def find(self) -> Motion:
        """Return the corrected motion."""
        self._wrong: dict[object, np.ndarray] = {}
        count, size = len(self._times), N_BASE + len(self._moved)
        total = np.zeros((count, size)) if self._total is None else self._total
        first = 0
        while True:
            last = min(first + PIECE, count)
            total[first:last] = self._piece(first, last, total[first:last])
            if last == count:
                break
            first = last - OVERLAP
        self._total = total
        bases, positions = changed(self._bases, self._positions, total)
        positions = np.clip(positions, *self._limits(slice(0, count)))
        return self._motion(bases, positions)

    def _limits(self, rows: slice) -> tuple[np.ndarray, np.ndarray]:
        """Return the limits of joints, shapes (n, n_joints).

        What is not corrected may stay as far beyond them as it was.
        """
        (lower, upper), was = limits_of(self._robot.joints), self._positions[rows]
        alone = self.excluded[rows, np.newaxis] | ~self._moved
        alone |= "limits" not in self._parts
        return (
            np.where(alone, np.minimum(lower, was), lower),
            np.where(alone, np.maximum(upper, was), upper),
        )

    def _motion(self, bases: np.ndarray, positions: np.ndarray) -> Motion:
        """Return a motion with the joints and base that the given one has."""
        motion, names = self._measured.motion, [j.name for j in self._robot.joints]
        columns = [names.index(name) for name in motion.joint_names]
        roots = None
        if self._has_base:
            roots = compose(bases, inverse(self._robot.T_base_root))
        return replace(
            motion, positions=positions[:, columns], velocities=None, base_poses=roots
        )

    def _piece(self, first: int, last: int, before: np.ndarray) -> np.ndarray:
        """Solve for some samples; the first ones may be solved already."""
        rows = slice(first, last)
        done, fixed = before.copy(), OVERLAP // 2 if first else 0
        kept, largest = before.copy(), np.inf
        known = KNOWN if self._total is None else 1
        kept[fixed:] = 0.0
        for number in range(ROUNDS):
            at = changed(self._bases[rows], self._positions[rows], done)
            placed = Jacobians(self._robot.kinematics, *at)
            change = Change(len(done), len(self._moved))
            change.keep_small(self._small(last - first, fixed, first), done - kept)
            change.keep_smooth(self._smooth(rows), done)
            self._add_feet(change, placed, rows)
            self._add_bounds(change, at[1], rows)
            self._add_contacts(change, placed, rows)
            self._add_centers(change, placed, rows)
            self._add_hands(change, placed, rows)
            step = change.solve()
            previous, largest = largest, float(np.abs(step).max())
            done = done + min(1.0, FURTHEST / max(largest, FURTHEST)) * step
            if largest < ENOUGH or (number > known and largest > STALLED * previous):
                break
        return done

    def _small(self, count: int, fixed: int, first: int) -> np.ndarray:
        """Weigh the sizes of changes, shape (count, size)."""
        own = np.concatenate(
            [[self._place] * 3, [TURN] * 3, [JOINT] * len(self._moved)]
        )
        weights = np.tile(1.0 / own, (count, 1))
        weights[:, N_BASE:][:, ~self._moved] = 1e6
        if first == 0 and not any(one.stands[0].any() for one in self._stances):
            weights[0, [0, 1, 5]] = 1.0 / START
        if not self._has_base:
            weights[:, :N_BASE] = 1e6
        weights[:fixed] = 1e6
        return weights

    def _smooth(self, rows: slice) -> np.ndarray:
        """Weigh the curvature of changes, shape (size,)."""
        gaps = np.diff(self._times[rows])
        step = max(float(np.median(gaps)), SHORTEST) if gaps.size else 1.0
        own = np.repeat(self._smoothness, [2, 1, 3, len(self._moved)])
        return np.asarray(1.0 / (own * step**2))

    def _add_feet(self, change: Change, placed: Jacobians, rows: slice) -> None:
        """Keep feet where they stand, at the height of the floor."""
        floor = self._robot.thresholds.floor_height
        for one in self._stances:
            points = placed_points(placed.link_poses[:, one.link], one.points)
            heights = points[..., 2] - one.radii - floor
            before = placed_points(self._poses[rows, one.link], one.points)
            was = before[..., 2] - one.radii - floor
            alone = self.excluded[rows] | ("feet" not in self._parts)
            alone = alone[:, np.newaxis] & (was < LOW)
            stands = one.stands[rows] & ~alone
            # A foot that arrives or leaves is still for a sample more.
            still = stands.copy()
            still[1:] |= stands[:-1]
            still[:-1] |= stands[1:]
            still &= ~alone
            moves = (one.moves[rows] | alone) & ~still
            # What does not stand stays as high above where it stood.
            lifted = (was - one.level[rows, np.newaxis]).clip(0.0, LIFTED)
            least = np.where(one.drags[rows, np.newaxis], LIFTED, lifted)
            goal = np.where(stands, one.offsets[rows], np.where(alone, was, least))
            low = self._ever(("low", one.link), rows, heights < least)
            due = stands | alone | low
            for number, point in enumerate(np.swapaxes(points, 0, 1)):
                at = np.flatnonzero(due[:, number])
                tolerance = np.where(alone[at, number], ALONE, HEIGHT)
                away = (heights - goal)[at, number] / tolerance
                links = np.full(len(at), one.link)
                up = placed.of_each(at, links, point[at])[:, 2:]
                up = up / tolerance[:, np.newaxis, np.newaxis]
                change.add(at, up, away[:, np.newaxis])
                at = np.flatnonzero(still[:, number])
                self._add_steps(change, placed, one.link, at, point, LOCK)
                if rows.start == 0 and stands[0, number]:
                    first = np.zeros(1, dtype=int)
                    flat = placed.of_each(first, first + one.link, point[:1])[:, :2]
                    away = (point[:1] - before[:1, number])[:, :2]
                    change.add(first, flat / START, away / START)
                at = np.flatnonzero(moves[:, number])
                given = one.link, at, point, MOVE, before[:, number]
                self._add_steps(change, placed, *given)

    def _add_steps(
        self,
        change: Change,
        placed: Jacobians,
        link: int,
        at: np.ndarray,
        points: np.ndarray,
        tolerance: float,
        before: np.ndarray | None = None,
    ) -> None:
        """Keep a point of a link where it is, or let it move as before."""
        first = np.flatnonzero(np.diff(at) == 1)
        jacobian = placed.of_each(at, np.full(len(at), link), points[at])
        flat = jacobian[:, :2] / tolerance
        steps = (points[at[first] + 1] - points[at[first]])[:, :2]
        if before is not None:
            steps = steps - (before[at[first] + 1] - before[at[first]])[:, :2]
        given = -flat[first], flat[first + 1], steps / tolerance
        change.add_steps(at[first], *given)

    def _add_bounds(self, change: Change, now: np.ndarray, rows: slice) -> None:
        """Bring joints into their limits, and below largest rates."""
        joints, (lower, upper) = self._robot.joints, self._limits(rows)
        unit = np.eye(change.size)[N_BASE:]
        free = ~self.excluded[rows][:, np.newaxis]
        bounded = np.clip(now, lower, upper)
        at, column = np.nonzero(self._ever("bound", rows, now != bounded))
        nearest = np.where(now - lower < upper - now, lower, upper)
        away = (now - nearest)[at, column]
        own = unit[column][:, np.newaxis] / BOUND
        change.add(at, own, away[:, np.newaxis] / BOUND)
        if "speed" in self._parts:
            fastest = np.array([joint.velocity or np.inf for joint in joints])
            steps = np.diff(now, axis=0)
            most = SPEED * fastest * np.diff(self._times[rows])[:, np.newaxis]
            fast = np.zeros(now.shape, dtype=bool)
            fast[:-1] = (np.abs(steps) > most) & free[1:]
            at, column = np.nonzero(self._ever("fast", rows, fast)[:-1])
            away = (steps - np.sign(steps) * most)[at, column]
            own = unit[column][:, np.newaxis] / RATE
            change.add_steps(at, -own, own, away[:, np.newaxis] / RATE)
            self._add_accelerations(change, now, rows)

    def _add_accelerations(self, change: Change, now: np.ndarray, rows: slice) -> None:
        """Bring joints below their largest accelerations."""
        names = tuple(joint.name for joint in self._robot.joints)
        most = SPEED * self._robot.thresholds.acceleration_bounds.of(names)
        gaps = np.diff(self._times[rows])[:, np.newaxis]
        before, after = gaps[:-1], gaps[1:]
        middle = (before + after) / 2.0
        found = np.diff(np.diff(now, axis=0) / gaps, axis=0) / middle
        quick = np.zeros(now.shape, dtype=bool)
        quick[:-2] = (np.abs(found) > most) & ~self.excluded[rows][1:-1, np.newaxis]
        at, column = np.nonzero(self._ever("quick", rows, quick)[:-2])
        sides = [1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after]
        slopes = np.concatenate(sides, axis=1)[at] / middle[at]
        tolerance = STRONG * most[column]
        away = (np.abs(found) - most)[at, column] * np.sign(found)[at, column]
        weights = slopes / tolerance[:, np.newaxis]
        change.add_bends(at, N_BASE + column, weights, away / tolerance)

    def _ever(self, name: object, rows: slice, mask: np.ndarray) -> np.ndarray:
        """Keep what was wrong in a round for the next ones; the result may be set."""
        shape = (len(self._times), *mask.shape[1:])
        known = self._wrong.setdefault(name, np.zeros(shape, dtype=bool))
        known[rows] |= mask
        return np.asarray(known[rows])

    def _add_contacts(self, change: Change, placed: Jacobians, rows: slice) -> None:
        """Push links apart that overlap."""
        if "collisions" not in self._parts:
            return
        collisions = self._robot.collisions
        found = collisions.contacts(placed.link_poses, MARGIN)
        is_free = ~self.excluded[rows][found.sample]
        deep = np.zeros((len(placed.link_poses), len(collisions.pairs)), dtype=bool)
        deep[found.sample, found.pair] = (found.distance < 0.0) & is_free
        deep = self._ever("contacts", rows, deep)
        found = found[deep[found.sample, found.pair] & is_free]
        if not len(found.sample):
            return
        row = {name: number for number, name in enumerate(self._robot.links)}
        pairs = np.array([[row[a], row[b]] for a, b in collisions.pairs])[found.pair]
        along = [
            placed.of_each(found.sample, pairs[:, side], points)
            for side, points in enumerate((found.points_a, found.points_b))
        ]
        apart = np.einsum("mk,mkj->mj", found.normal, along[1] - along[0])
        change.add(
            found.sample,
            apart[:, np.newaxis] / DEPTH,
            (found.distance - APART)[:, np.newaxis] / DEPTH,
        )

    def _add_centers(self, change: Change, placed: Jacobians, rows: slice) -> None:
        """Move the centre of mass over the feet where the robot stands still."""
        at = np.flatnonzero(self._tips[rows] & ~self.excluded[rows])
        if "balance" not in self._parts or not len(at):
            return
        masses = self._robot.masses
        center = masses.shares @ masses.centers(placed.link_poses)
        jacobian = placed.of_center_of_mass(masses)
        feet = [
            (
                one.link,
                placed_points(placed.link_poses[:, one.link], one.points),
                one.stands[rows],
            )
            for one in self._stances
        ]
        used, residuals, along = [], [], []
        out = self._ever("out", rows, np.zeros(len(center), dtype=bool))
        for row in at.tolist():
            standing = [(link, p[row, s[row]]) for link, p, s in feet if s[row].any()]
            if not standing:
                continue
            points = np.concatenate([points for _, points in standing])
            polygon = support_polygon(points[:, :2])
            place = center[row, :2]
            if out[row] or support_margin(polygon, *place.tolist()) < WITHIN:
                edge = nearest_point(polygon, *place.tolist())
                inwards = np.mean(polygon, axis=0) - edge
                far = max(float(np.linalg.norm(inwards)), WITHIN)
                out[row] = True  # also in the next rounds
                used.append(row)
                residuals.append(place - edge - inwards * WITHIN / far)
                counts = [len(some) for _, some in standing]
                links = np.repeat([link for link, _ in standing], counts)
                moved = placed.of_each(np.full(len(points), row), links, points)
                along.append((jacobian[row] - moved.mean(axis=0))[:2])
        if used:
            residual, apart = np.array(residuals) / CENTER, np.array(along) / CENTER
            change.add(np.array(used), apart, residual)

    def _add_hands(self, change: Change, placed: Jacobians, rows: slice) -> None:
        """Keep hands on their paths, with their rotations."""
        at = np.arange(len(placed.link_poses))
        for link in self._hands:
            now = placed_points(placed.link_poses[:, link], PALM)
            before = placed_points(self._poses[rows, link], PALM)
            for number, tolerance in enumerate(HAND):
                points = now[:, number]
                jacobian = placed.of_each(at, np.full(len(at), link), points)
                away = points - before[:, number]
                change.add(at, jacobian / tolerance, away / tolerance)
