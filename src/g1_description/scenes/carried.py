"""Where objects are in the course of a motion, and which links carry them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Callable, NamedTuple

import numpy as np

from g1_description.errors import UnknownNameError
from g1_description.motion.motion import Motion, configuration, sample
from g1_description.robot.assembly import SCOPE, Assembly, root_in_base
from g1_description.robot.description import Description
from g1_description.robot.dynamics import Masses
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.state import RobotState
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.scenes.objects import SceneObject
from g1_description.scenes.scene import Scene
from g1_description.text import listed, similar_first

LinkPoses = Callable[[str, np.ndarray], np.ndarray]
"""Returns T_map_link, shape (n, 7), of a link's name and times in [s], shape (n,).
Times before the first and after the last count as these."""


class Hold(NamedTuple):
    """A time in which an object does not move in the frame of a link, or the map."""

    begin: float
    """When it begins, in [s]; it ends when the next one begins."""

    link: str
    """The link that carries the object; empty: none, it stays in the map."""

    pose: np.ndarray
    """T_link_object, or T_map_object, shape (7,)."""


def applying(holds: Sequence[Hold], times: np.ndarray) -> np.ndarray:
    """Find the rows of the holds of one object that apply at times, shape (n,)."""
    begins = [hold.begin for hold in holds]
    return np.asarray(np.searchsorted(begins, times, "right") - 1)


class Held(NamedTuple):
    """What holds objects at some times."""

    carriers: np.ndarray
    """Rows of links, -1 where none carries the object, shape (n, n_objects)."""

    poses: np.ndarray
    """Poses in the frames of these links or else the map, shape (n, n_objects, 7)."""

    begins: np.ndarray
    """When that began, in [s], shape (n, n_objects)."""

    def placed(self, link_poses: np.ndarray) -> np.ndarray:
        """Return T_map_object, shape (n, n_objects, 7), for T_map_link."""
        samples, objects = np.nonzero(self.carriers >= 0)
        found = self.poses.copy()
        links = link_poses[samples, self.carriers[samples, objects]]
        found[samples, objects] = compose(links, found[samples, objects])
        return found

    def loaded(self, masses: Masses, objects: Iterable[SceneObject]) -> Masses:
        """Add the objects that links carry to the masses of these."""
        inertials = [each.link.inertial for each in objects]
        return masses.carrying(inertials, self.carriers, self.poses)


def held(
    holds: Sequence[Sequence[Hold]], times: np.ndarray, links: Sequence[str]
) -> Held:
    """Find out what holds objects at times.

    Args:
        holds: Those of each object, see ``holds_of``.
        times: In [s], shape (n,).
        links: Names of the links by row.
    """
    carriers = np.full((len(times), len(holds)), -1)
    poses = np.empty((len(times), len(holds), 7))
    begins = np.empty(carriers.shape)
    for column, some in enumerate(holds):
        numbers = applying(some, times)
        rows = np.array([links.index(h.link) if h.link else -1 for h in some])
        carriers[:, column] = rows[numbers]
        poses[:, column] = np.array([hold.pose for hold in some])[numbers]
        begins[:, column] = np.array([hold.begin for hold in some])[numbers]
    return Held(carriers, poses, begins)


class RobotLinks:
    """The links of a robot, for poses along its motions."""

    def __init__(self, robot: Description) -> None:
        self.robot = robot
        self._kinematics = Kinematics(robot)
        self._T_base_root = root_in_base(robot)
        self._rows = {name: row for row, name in enumerate(Assembly(robot).link_names)}
        self._joints = [joint.name for joint in robot.movable_joints]

    def along(self, motion: Motion, base: np.ndarray = IDENTITY) -> LinkPoses:
        """Find the links of the robot that follows a motion.

        Args:
            motion: The motion; other joints are at zero.
            base: T_map_base of a motion without poses of the base, shape (7,).
        """
        known = {name: column for column, name in enumerate(self._joints)}
        used = [name in known for name in motion.joint_names]
        columns = [known[name] for name in motion.joint_names if name in known]

        def link_poses(link: str, times: np.ndarray) -> np.ndarray:
            found = sample(motion, np.clip(times, motion.begin, motion.end))
            positions = np.zeros((len(times), len(known)))
            positions[:, columns] = found.positions[:, used]
            bases = found.base_poses
            bases = np.tile(base, (len(times), 1)) if bases is None else bases
            roots = compose(bases, self._T_base_root)
            poses = self._kinematics.link_poses(roots, positions)
            return np.asarray(poses[:, self._rows[link]])

        return link_poses


def motion_links(
    robot: Description, motion: Motion, base: np.ndarray = IDENTITY
) -> LinkPoses:
    """Find the links of a robot that follows a motion; see ``RobotLinks.along``."""
    return RobotLinks(robot).along(motion, base)


def holds_of(
    objects: Iterable[SceneObject], robot: Description, link_poses: LinkPoses
) -> list[list[Hold]]:
    """Find out what holds objects, and where in its frame they are.

    From the begin of an attachment on, the object stays in the link's frame as it is
    then; from its end on, in the map as it is then.

    Args:
        objects: The objects, such as the values of a scene.
        robot: The robot whose links carry them.
        link_poses: Poses of its links.

    Returns:
        For each object its holds, which begin in the order of time, the first at
        -inf; one that is never attached has a single one.

    Raises:
        UnknownNameError: If the robot has neither a link nor a role of a name.
    """
    return [_holds(each, robot, link_poses) for each in objects]


def _holds(each: SceneObject, robot: Description, link_poses: LinkPoses) -> list[Hold]:
    """Find out what holds one object."""
    holds, pose = [Hold(-np.inf, "", each.pose)], each.pose
    for one in each.attachments:
        link = named_link(robot, one.link, each.name)
        begin, end = link_poses(link, np.array([one.begin, one.end]))
        grip = compose(inverse(begin), pose)
        pose = compose(end, grip)
        holds = [hold for hold in holds if hold.begin < one.begin]  # the rest is empty
        holds.append(Hold(one.begin, link, grip))
        if one.end < np.inf:
            holds.append(Hold(one.end, "", pose))
    return holds


def named_link(robot: Description, name: str, owner: str) -> str:
    """Return the link of a name or role.

    Args:
        robot: The robot.
        name: Name of the link, or of a role in the robot's profile.
        owner: Name of the object that names it.

    Raises:
        UnknownNameError: If there is none.
    """
    found = _link(robot, name)
    if not found:
        names = [*robot.profile.links, *robot.link_names]
        known = listed(similar_first(name, names))
        raise UnknownNameError(
            f"The object {owner} names the link {name}, but {robot.name} has no such "
            f"link. Its roles and links: {known}."
        )
    return found


def _link(robot: Description, name: str) -> str:
    """Return the link of a name or role; empty if there is none."""
    found = name if name in robot.link_names else robot.profile.links.get(name, "")
    return found if found in robot.link_names else ""


def carrying_links(robot: Description) -> tuple[str, ...]:
    """List what people let carry objects: hands by their roles, or else all links."""
    roles = tuple(role for role in robot.profile.links if role.endswith("hand"))
    return roles or robot.link_names


def scene_around(
    objects: Iterable[SceneObject], robot: Description, model: str = ""
) -> Scene:
    """Return objects of a simulator, without the attachments of other robots.

    Args:
        objects: The objects; links are ``model::link`` where there are several robots.
        robot: The robot.
        model: Its name in the simulator; empty: it is not known.
    """
    found = Scene()
    for each in objects:
        parts = [(one, *one.link.rpartition(SCOPE)) for one in each.attachments]
        own = tuple(
            replace(one, link=link)
            for one, owner, _, link in parts
            if _link(robot, link) and owner in ("", model or owner)
        )
        found.add(replace(each, attachments=own))
    return found


def carried_to(
    objects: Collection[SceneObject],
    poses: np.ndarray | None,
    links: RobotLinks,
    now: RobotState | None,
    start: Motion,
) -> np.ndarray | None:
    """Move objects that links carry now to where these are at the start of a motion.

    Args:
        objects: The objects.
        poses: T_map_object now, shape (n_objects, 7); None: unknown.
        links: The links of the robot.
        now: Its state; if it or its base is unknown, nothing is moved.
        start: The motion, or a configuration.

    Returns:
        As ``poses``.
    """
    if now is None or now.base_pose is None:
        return poses
    if poses is None or start.base_poses is None:
        return poses
    present = configuration(now.positions_by_name, now.base_pose)
    found, begin = poses.copy(), np.array([start.begin])
    for row, each in enumerate(objects):
        for one in each.attachments:
            link = named_link(links.robot, one.link, each.name)
            before, after = (links.along(m)(link, begin) for m in (present, start))
            found[row] = compose(after[0], compose(inverse(before[0]), poses[row]))
    return found


def object_poses(
    holds: Sequence[Sequence[Hold]], times: np.ndarray, link_poses: LinkPoses
) -> np.ndarray:
    """Compute where objects are.

    Args:
        holds: Those of each object, see ``holds_of``.
        times: In [s], shape (n,).
        link_poses: Poses of the links.

    Returns:
        T_map_object, shape (n, n_objects, 7).
    """
    poses = np.empty((len(times), len(holds), 7))
    names = {hold.link for some in holds for hold in some if hold.link}
    links = {name: link_poses(name, times) for name in names}
    for column, some in enumerate(holds):
        number = applying(some, times)
        for row, hold in enumerate(some):
            now = number == row
            if hold.link:
                poses[now, column] = compose(links[hold.link][now], hold.pose)
            else:
                poses[now, column] = hold.pose
    return poses
