"""Whole-body inverse kinematics of a robot: targets by name."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from itertools import islice
from typing import Any

import numpy as np

from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.ik.limits import (
    BalanceLimit,
    Course,
    DistanceLimit,
    FloorLimit,
    Limit,
    LinkPart,
    link_parts,
)
from g1_description.ik.obstacle_limit import ObstacleLimit, ObstacleScene
from g1_description.ik.options import (
    BALANCE_MARGIN,
    BALANCE_SHARE,
    BASES,
    BELOW,
    MAX_WEIGHT,
    ZMP,
    IkOptions,
    floor_height,
    has_carried,
    link_names,
    target_weight,
)
from g1_description.ik.results import IkResult, TargetError, error_text
from g1_description.ik.solver import (
    HARD,
    STARTS,
    TOLERANCE,
    Configuration,
    IkConstraints,
    IkSolver,
    Linearization,
    last,
    search,
)
from g1_description.ik.supports import found_supports
from g1_description.ik.targets import (
    POSE_WEIGHTS,
    Target,
    as_target,
    check_mapping,
    check_places,
    is_number,
    read_task,
)
from g1_description.ik.tasks import LinkTask
from g1_description.robot.assembly import WORLD, root_in_base
from g1_description.robot.description import Description, limits_of
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.launch_arguments import FEET
from g1_description.robot.transform import compose, inverse
from g1_description.scenes.scene import Scene
from g1_description.text import listed, similar_first

DISTANCE = 0.002
"""Least distance of links from each other, in [m]."""

DRAGGED_STEP = 0.05
"""Largest change in a step of a search that begins elsewhere, as in drags, in [rad] or
[m]: larger ones jump through objects."""

SOON = 1e-9
"""Time in [s] that is after a start at 0 s."""

ROUNDS = 3
"""Searches for targets relative to objects that are carried, each of which goes where
the one before has carried these."""


class InverseKinematics:
    """Inverse kinematics of one robot."""

    def __init__(
        self,
        description: Description,
        make_collisions: Callable[[], SelfCollisions] | None = None,
    ) -> None:
        """Prepare a robot.

        Args:
            description: The robot.
            make_collisions: Prepares its self-collisions, which may take seconds, when
                they are to be avoided for the first time; None: they never are.
        """
        self._description, self._make_collisions = description, make_collisions
        self._solver = IkSolver(description)
        joints = description.movable_joints
        self._names = tuple(joint.name for joint in joints)
        self._lower, self._upper = limits_of(joints)
        speed = np.array([joint.velocity for joint in joints], dtype=float)
        self._stays = speed == 0.0
        self._speed = np.where(self._stays, np.inf, speed)
        self._shapes = [link for link in description.links if link.name != WORLD]
        self.links = [link.name for link in self._shapes]
        self._T_base_root = root_in_base(description)
        profile = description.profile
        self._roles = {r: n for r, n in profile.links.items() if n in self.links}
        feet = [self._roles[role] for role in FEET if role in self._roles]
        self._points = {
            n: at for n, at in profile.points.items() if at.link in self.links
        }
        self._feet = {self.links.index(link) for link in feet}
        self._last: ObstacleScene | None = None

    def solve(
        self,
        targets: Mapping[str, Any],
        positions: np.ndarray,
        base: np.ndarray,
        options: IkOptions,
        starts: int = STARTS,
        begin: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> IkResult:
        """Search a configuration.

        Args:
            targets: A ``Target``, pose, shape (7,), or position, shape (3,), in the
                world, by name or role of a link, or name of a point.
            positions: Positions of the joints at the start, shape (n_joints,).
            base: Pose of the base link at the start, shape (7,).
            options: Conditions on the configuration.
            starts: Most starts; 1: only the given one.
            begin: Positions and base at which the search begins; None: the start, which
                is where links are fixed, and the posture to prefer, in any case.

        Raises:
            UnknownNameError: If a link is unknown.
            InvalidValueError: If a target is not a pose, or balance has no support.
        """
        return last(self.pieces(targets, positions, base, options, starts, begin))

    def pieces(
        self,
        targets: Mapping[str, Any],
        positions: np.ndarray,
        base: np.ndarray,
        options: IkOptions,
        starts: int = STARTS,
        begin: tuple[np.ndarray, np.ndarray] | None = None,
        most: int | None = None,
    ) -> Iterator[IkResult]:
        """Search a configuration in pieces; the arguments are those of ``solve``.

        Args:
            targets: Where links are brought.
            positions: Positions of the joints at the start.
            base: Pose of the base link at the start.
            options: Conditions on the configuration.
            starts: Most starts.
            begin: Where the search begins.
            most: Most steps of a piece; None: there is only one.

        Yields:
            The best configuration after each piece; at last that of ``solve``.
        """
        start = self._configuration(positions, base)
        first = start if begin is None else self._configuration(*begin)
        at_start = course = self._course(np.zeros(1), start)
        for _ in range(ROUNDS if has_carried(targets, options.scene) else 1):
            moved = self._tasks(targets, options, start, course=course)
            tasks, bounds = self._problem(moved, start, options)
            bounds = bounds.at(0, at_start)
            if options.scene and begin is not None:
                bounds = replace(bounds, largest_step=DRAGGED_STEP)
            given = tuple(tasks.values()), bounds, start.position
            steps = search(self._solver, first, *given, starts)
            while piece := deque(islice(steps, most), maxlen=1):
                view, count = piece.pop()
                yield self._result(tasks, view, count)
            first, poses = view.configuration, view.jacobians.link_poses
            both = np.stack([at_start.link_poses[0], poses])
            course = Course(np.array([0.0, SOON]), both)

    def _problem(
        self,
        moved: Mapping[str, LinkTask],
        start: Configuration,
        options: IkOptions,
        times: np.ndarray | None = None,
        is_smooth: bool = False,
    ) -> tuple[dict[str, LinkTask], IkConstraints]:
        """Find all tasks by name, of targets and of fixed links, and the bounds."""
        poses = self._solver.kinematics.link_poses(*start)
        fixed = self._fixed(options.fixed_links, moved)
        stands = fixed or any(task.link in self._feet for task in moved.values())
        stays = {
            name: LinkTask(row, poses[row], HARD * POSE_WEIGHTS)
            for name, row in fixed.items()
        }
        base_motion = options.base_motion
        if base_motion is None:
            base_motion = "free" if stands else "fixed"
        if base_motion not in [*BASES]:
            raise UnknownNameError(
                f"base_motion must be one of {listed(BASES)} (got '{base_motion}')."
            )
        if self._description.root == WORLD:
            base_motion = "fixed"
        around = self.surroundings(options.scene) if options.scene else None
        given = np.zeros(1) if times is None else times
        limits: list[Limit] = []
        if options.balance:
            is_of_zmp = options.balance == ZMP
            if is_of_zmp and not is_smooth:
                raise InvalidValueError(
                    f"balance='{ZMP}' is for smooth trajectories, as only these have "
                    "accelerations."
                )
            feet = [task for task in moved.values() if task.link in self._feet]
            standing = [*stays.values(), *(foot for foot in feet if foot.is_posed)]
            raised = around.stood_on(standing, poses) if around and standing else {}
            supports, floors = found_supports(standing, self._shapes, times, raised)
            margin, share = BALANCE_MARGIN, BALANCE_SHARE
            if is_number(options.balance):
                margin, share = float(options.balance), np.inf
            loaded = partial(around.loaded, given) if around else None
            above = supports, margin, share, floors, is_of_zmp
            limits.append(BalanceLimit(self._solver.masses, *above, loaded))
        floor = floor_height(options.floor, start)
        if floor is not None:
            limits.append(self._floor_limit(floor, start, {*fixed.values()}))
        if options.avoid_collisions:
            limits.append(self._distance_limit)
        if around:
            limits.append(ObstacleLimit(around, given, fixed.values(), self._feet))
        stays_put = self._stays & (times is not None)
        lower = np.where(stays_put, start.position, self._lower)
        upper = np.where(stays_put, start.position, self._upper)
        bounds = IkConstraints(
            lower, upper, BASES[base_motion], [*limits, *options.limits]
        )
        return {**stays, **moved}, bounds

    @cached_property
    def _parts(self) -> list[LinkPart]:
        return link_parts(self._shapes)

    def _floor_limit(
        self, floor: float, start: Configuration, fixed: set[int]
    ) -> FloorLimit:
        """Keep links above a floor, but for those that are fixed on it."""
        moving = {*range(len(self.links))} - fixed
        jacobians = Jacobians(self._solver.kinematics, *start)
        _, (_, heights) = FloorLimit(self._parts, floor, moving).approaches(
            jacobians.batched()
        )
        depth = -heights.min(initial=0.0)
        if depth > BELOW:
            raise InvalidValueError(
                f"floor is {1e3 * depth:.0f} mm above the lowest point of the fixed "
                "links: give the height on which the robot stands."
            )
        return FloorLimit(self._parts, floor, fixed)

    @cached_property
    def _distance_limit(self) -> DistanceLimit:
        assert self._make_collisions is not None
        return DistanceLimit(self._description, self._make_collisions(), DISTANCE)

    def surroundings(self, scene: Scene) -> ObstacleScene:
        """Prepare the shapes of objects, unless they are those of the last call."""
        if self._last is None or not self._last.is_for(scene):
            self._last = ObstacleScene(self._description, scene)
        return self._last.moved(scene)

    def _course(self, times: np.ndarray, start: Configuration) -> Course:
        """Return the course of a motion that does not move."""
        poses = self._solver.kinematics.link_poses(*start)
        return Course(times, poses[np.newaxis])

    def _configuration(self, positions: np.ndarray, base: np.ndarray) -> Configuration:
        """Place the root, and joints within their limits."""
        within = np.clip(positions, self._lower, self._upper)
        return Configuration(compose(base, self._T_base_root), within)

    def _row(self, name: str) -> int:
        """Return the row of a link, given by its name or role, or that of a point."""
        link = name if name in self.links else self._roles.get(name, name)
        if link in self._points:
            link = self._points[link].link
        if link not in self.links:
            names = [*self._roles, *self._points, *self.links]
            known = listed(similar_first(name, names))
            raise UnknownNameError(f"Unknown link '{name}'. Known links: {known}.")
        return self.links.index(link)

    def _fixed(
        self, given: Collection[str] | None, moved: Mapping[str, LinkTask]
    ) -> dict[str, int]:
        """Find the fixed links, which have no target."""
        feet = [role for role in FEET if role in self._roles]
        names = feet if given is None else link_names(given)
        targets = {task.link for task in moved.values()}
        rows = {name: self._row(name) for name in names}
        both = [name for name, row in rows.items() if row in targets]
        if both and given is not None:
            raise InvalidValueError(
                f"{both[0]} is a fixed link, so it cannot have a target."
            )
        return {name: row for name, row in rows.items() if row not in targets}

    def _tasks(
        self,
        targets: Mapping[str, Any],
        options: IkOptions,
        start: Configuration,
        times: np.ndarray | None = None,
        course: Course | None = None,
    ) -> dict[str, LinkTask]:
        """Read targets, with the axis of the samples of a path if there are times."""
        course = course or self._course(np.zeros(1), start)
        check_mapping("targets", targets)
        weights, points = options.weights or {}, options.points or {}
        for option, given in (("weight", weights), ("point", points)):
            check_mapping(f"{option}s", given)
            unknown = [name for name in given if name not in targets]
            if unknown:
                raise UnknownNameError(
                    f"There is a {option} but no target of {listed(unknown)}."
                )
        poses = self._solver.kinematics.link_poses(*start)
        tasks: dict[str, LinkTask] = {}
        names: dict[int, str] = {}
        for name, given in targets.items():
            row = self._row(name)
            other = names.setdefault(row, name)
            if other != name:
                raise InvalidValueError(f"{other} and {name} are the same link.")
            target = self._completed(name, as_target(name, given), points.get(name))
            task = read_task(name, target, row, times)
            if target.relative_to is not None:
                of = self._frame(name, row, target.relative_to, options, times, course)
                task = task.in_frame(of)
            check_places(name, task, start.root[:3], poses[row], times)
            weight = target_weight(name, weights.get(name, 1.0))
            weight = min(weight, HARD if times is None else MAX_WEIGHT)
            tasks[name] = task._replace(weights=weight * task.weights)
        # Fixed links and limits prevail, even over an infinite weight.
        largest = max((task.weights.max() for task in tasks.values()), default=0.0)
        scale = min(1.0, MAX_WEIGHT / max(largest, MAX_WEIGHT))
        return {
            name: task._replace(weights=scale * task.weights)
            for name, task in tasks.items()
        }

    def _frame(
        self,
        name: str,
        row: int,
        of: str,
        options: IkOptions,
        times: np.ndarray | None,
        course: Course,
    ) -> np.ndarray:
        """Find the pose of the object to which a target is relative, in each sample."""
        if options.scene is None:
            raise InvalidValueError(
                f"The target of {name} is relative to {of}: give a scene that has it."
            )
        around = self.surroundings(options.scene)
        at = np.array([SOON]) if times is None else times
        poses, carriers = around.frame_of(of, at, course)
        own = carriers == self.links[row]
        if own.any():
            when = "" if times is None else f" at {times[int(np.argmax(own))]:.2f} s"
            raise InvalidValueError(
                f"The target of {name} is relative to {of}, which it carries{when}: "
                "give its place in the map."
            )
        return poses[0] if times is None else poses

    def _completed(self, name: str, target: Target, point: Any) -> Target:
        """Give a target the point of an option, or a named point with its axis."""
        own = self._points.get(name)
        points = [target.point, point, None if own is None else own.point]
        given = [each for each in points if each is not None]
        if len(given) > 1:
            raise InvalidValueError(f"The target of {name} has more than one point.")
        axis = target.axis
        is_aimed = target.direction is not None or target.look_at is not None
        if axis is None and own is not None and is_aimed:
            axis = own.axis
        return replace(target, point=given[0] if given else None, axis=axis)

    def _excess(self, view: Linearization, number: int) -> str:
        """Describe that a limit is exceeded; empty if it is not."""
        limit, excess = view.bounds.limits[number], view.excesses[number]
        if excess <= TOLERANCE[0]:
            return ""
        return next(self._at_objects(limit, view), limit.excess_message(excess))

    def _at_objects(self, limit: Limit, view: Linearization) -> Iterator[str]:
        """Describe what is at objects, the deepest first."""
        if isinstance(limit, ObstacleLimit):
            poses = self._solver.kinematics.link_poses(*view.configuration)
            yield from limit.contacts_at(poses)

    def _result(
        self,
        names: Iterable[str],
        view: Linearization,
        steps: int,
        is_alone: bool = True,
    ) -> IkResult:
        """Describe the result for tasks with names; one of many leaves out reasons."""
        errors = {}
        for name, task, (position, rotation) in zip(
            names, view.tasks, view.errors.tolist()
        ):
            is_placed, is_turned = task.weights.reshape(2, 3).any(axis=1)
            errors[name] = TargetError(
                position if is_placed else None, rotation if is_turned else None
            )
        far = [
            f"{name} is {error_text(error)} from its target"
            for name, error in errors.items()
            if error.normalized > 1.0
        ]
        numbers = range(len(view.bounds.limits))
        far += filter(None, (self._excess(view, number) for number in numbers))
        if far and is_alone:
            near = [self._at_objects(limit, view) for limit in view.bounds.limits]
            far += [text for texts in near for text in texts if text not in far]
        if far and view.is_stuck:
            far.append("the search ended early, as the solver found no further step")
        margins = [
            float(limit.margins[0] + room.min())
            for limit, (_, room) in zip(view.bounds.limits, view.approaches)
            if isinstance(limit, BalanceLimit)
        ]
        margin = min(margins, default=None)
        message = f"Not reached: {'; '.join(far)}." if far else ""
        return IkResult(
            view.configuration.position,
            compose(view.configuration.root, inverse(self._T_base_root)),
            errors,
            not far,
            margin,
            steps,
            message,
        )
