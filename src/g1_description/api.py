"""Robot: the package's interface for Python programs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import inf
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from g1_description.checks.thresholds import Thresholds
from g1_description.choices import DEFAULT, ZERO
from g1_description.errors import (
    DescriptionError,
    InvalidValueError,
    MotionError,
    UnknownNameError,
)
from g1_description.files.atomic import write_whole
from g1_description.former import former, former_arguments, warn_of_former
from g1_description.motion.edit import mirrored
from g1_description.motion.files.conventions import JOINT_ORDERS
from g1_description.motion.files.formats import read_motion, write_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.motion import Motion, MotionLike, as_motion, fitted
from g1_description.motion.motors import motors_of, named_motors
from g1_description.motion.paths import motion_path
from g1_description.robot.arrays import (
    JointValues,
    as_array,
    as_numbers,
    as_poses,
    check_names,
    named_positions,
    one_pose,
)
from g1_description.robot.assembly import WORLD, base_of, root_in_base
from g1_description.robot.description import Description, Joint
from g1_description.robot.dynamics import (
    Masses,
    RobotMotion,
    inverse_dynamics,
)
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.load import read_description
from g1_description.robot.poses import (
    Pose,
    check_pose,
    find_pose,
    fits,
    pose_positions,
    read_poses,
)
from g1_description.robot.profile import is_name
from g1_description.robot.rotation import cross
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.robot.urdf import parse_urdf
from g1_description.scenes.scene import Scene, as_scene
from g1_description.sim.padding import padded
from g1_description.sim.standing import on_floor
from g1_description.text import listed, similar_first

if TYPE_CHECKING:
    from g1_description.checks.checker import Checker
    from g1_description.checks.comparison import Comparison
    from g1_description.checks.contact_forces import ContactForces
    from g1_description.checks.verdict import Verdict
    from g1_description.collisions.contacts import Contacts
    from g1_description.collisions.self_collisions import SelfCollisions
    from g1_description.ik.keyframe_poses import Keyframe, Keyframes
    from g1_description.ik.limits import Limit, TrajectoryBounds
    from g1_description.ik.paths import IkPath, PathKinematics
    from g1_description.ik.results import IkResult
    from g1_description.mend.mending import Mended
    from g1_description.msg import RobotTrajectory

_IK_ARGUMENTS = {"hold": "fixed_links", "collisions": "avoid_collisions"}
"""New names of arguments by former ones."""

Seed = Union[int, np.random.Generator, None]

ThresholdValues = Union[Thresholds, "Mapping[str, Any]", str, "PathLike[str]", None]
"""A YAML file or its content; None: the defaults."""

SceneOrFile = Union[Scene, str, "PathLike[str]", None]
"""The objects around a robot, or their file; None: there are none."""


class Robot:
    """A robot: its kinematics, dynamics, motions and checks.

    Joints are the movable ones. Joints and links have the order of the file. Positions
    are in [rad] or [m], poses are rows of x y z and quaternion x y z w.

    Everywhere, ``positions`` may be arrays or dictionaries by joint (see the method
    ``positions``), with any number of leading axes for many configurations at once.
    ``base`` is the pose of the base link in the world, shape (..., 7); by default the
    world's origin. Positions of poses are in [m]. ``motion`` may be a result that has
    one, such as an ``IkPath`` or ``Keyframes``.
    """

    @former_arguments(collisions="allowed_collisions")
    def __init__(
        self,
        model: str | PathLike[str] | Description = DEFAULT,
        motors: str | PathLike[str] | None = None,
        allowed_collisions: str | PathLike[str] | None = None,
    ) -> None:
        """Read a robot.

        Args:
            model: A profile, by its name or folder; a URDF or xacro file, as a path,
                ``package://PACKAGE/PATH`` or ``file://``, optionally followed by
                arguments for xacro, as in ``robot.xacro hand=true``; or the text of a
                URDF, such as the parameter robot_description; or a ``Description``.
            motors: File of its motors, or the name of others of its profile, such as
                ``pd``; None: the usual ones of its profile.
            allowed_collisions: File of pairs of links that may touch; None: that of its
                profile.

        Raises:
            DescriptionError: If the file cannot be read, or is not a robot.
        """
        if isinstance(model, Description):
            found = model
        elif fspath(model).lstrip().startswith("<"):
            found = parse_urdf(fspath(model))
        else:
            found = read_description(fspath(model))
        self.profile = found.profile
        """Names of its feet, hands and head, and its further files."""
        if motors is not None:
            given = fspath(motors)
            is_named = is_name(given) and not Path(given).is_file()
            file = named_motors(self.profile, given) if is_named else Path(given)
            self.profile = replace(self.profile, motors=file.expanduser())
        # Given, so that processes on other machines need not find it.
        self.description = replace(found, given_profile=self.profile)
        """Links and joints, as read from the file."""
        pairs = allowed_collisions
        self._allowed = None if pairs is None else Path(pairs).expanduser()
        joints = self.description.movable_joints
        self.name = self.description.name
        self.joint_names = tuple(joint.name for joint in joints)
        self.link_names = tuple(n for n in self.description.link_names if n != WORLD)
        self.base_link = base_of(self.description)[0]
        """The link whose pose is that of the robot."""
        self.lower = _each(joints, lambda joint: joint.lower)
        """Lower limits in [rad] or [m], -inf without one, shape (n_joints,)."""
        self.upper = _each(joints, lambda joint: joint.upper)
        """Upper limits in [rad] or [m], inf without one, shape (n_joints,)."""
        self.velocity_limits = _each(joints, lambda joint: joint.velocity)
        """In [rad/s] or [m/s], inf without a limit, shape (n_joints,)."""
        self.effort_limits = _each(joints, lambda joint: joint.effort)
        """In [N m] or [N], inf without a limit, shape (n_joints,)."""
        self.mass = self.description.mass
        """In [kg]; None if the file has no masses."""

    def __repr__(self) -> str:
        """Show its name and size."""
        n_joints, n_links = len(self.joint_names), len(self.link_names)
        return f"<Robot {self.name}: {n_joints} joints, {n_links} links>"

    @cached_property
    def neutral(self) -> np.ndarray:
        """All joints at 0, or at the nearest limit, in [rad] or [m], (n_joints,)."""
        return _frozen(pose_positions(Pose(ZERO), self.description))

    @property
    def pose_names(self) -> tuple[str, ...]:
        """Names of the poses that fit this robot, the user's own included."""
        poses = read_poses(self.description)
        return tuple(n for n, pose in poses.items() if fits(pose, self.description))

    def named_configuration(self, name: str) -> np.ndarray:
        """Return the positions of a named pose.

        In ``named_configuration(profile.standing_pose)`` the robot stands.

        Args:
            name: One of ``pose_names``.

        Returns:
            Positions in [rad] or [m], shape (n_joints,).

        Raises:
            UnknownNameError: If there is no such pose, or it has unknown joints.
            InvalidValueError: If a position is outside the limits.
        """
        pose = find_pose(name, read_poses(self.description))
        check_pose(pose, self.description)
        return pose_positions(pose, self.description)

    pose = former("Robot.pose", "named_configuration")

    def random_configuration(
        self, rng: Seed = None, size: int | tuple[int, ...] = ()
    ) -> np.ndarray:
        """Draw uniformly distributed positions between the limits.

        Args:
            rng: Generator or seed; None: a different result each time.
            size: Number of configurations, or leading axes.

        Returns:
            Positions in [rad] or [m], shape (*size, n_joints); a joint that turns
            without limits is within half a turn of 0, or within a turn of its only
            limit.

        Raises:
            InvalidValueError: If a prismatic joint has no limits, or a size is
                negative.
        """
        lower, upper = self._ranges
        lead = (size,) if isinstance(size, int) else tuple(size)
        if any(length < 0 for length in lead):
            raise InvalidValueError(f"size must not be negative (got {size}).")
        generator = np.random.default_rng(rng)
        return generator.uniform(lower, upper, (*lead, len(lower)))

    def positions(self, given: JointValues) -> np.ndarray:
        """Arrange positions in the order of the joints.

        Args:
            given: In [rad] or [m]: an array of shape (..., n_joints), or a dictionary
                by joint of numbers or arrays of shape (...); other joints are neutral.

        Returns:
            A new array in [rad] or [m], shape (..., n_joints).

        Raises:
            UnknownNameError: If a joint is unknown.
            InvalidValueError: If shapes do not fit, or a number is not finite.
        """
        return as_array(given, self.joint_names, self.neutral)

    def link_row(self, link: str) -> int:
        """Return the index of a link in ``link_names``.

        Raises:
            UnknownNameError: If it is unknown.
        """
        return _row("link", link, self.link_names)

    def joint_row(self, joint: str) -> int:
        """Return the index of a joint in ``joint_names``.

        Raises:
            UnknownNameError: If it is unknown.
        """
        return _row("movable joint", joint, self.joint_names)

    def forward_kinematics(
        self, positions: JointValues, base: Any = None
    ) -> np.ndarray:
        """Place all links.

        Args:
            positions: Positions of the joints, shape (..., n_joints), or by joint.
            base: Pose of the base link in the world, shape (..., 7).

        Returns:
            Poses of the link frames in the world in the order of ``link_names``, shape
            (..., n_links, 7).

        Raises:
            G1DescriptionError: If positions or base are invalid.
        """
        return self._kinematics.link_poses(*self._placed(positions, base))

    def link_poses(
        self, positions: JointValues, base: Any = None
    ) -> dict[str, np.ndarray]:
        """Place all links, by name.

        Args:
            positions: As for ``forward_kinematics``.
            base: As for ``forward_kinematics``.

        Returns:
            Poses of the link frames in the world, shapes (..., 7), by link.

        Raises:
            G1DescriptionError: If positions or base are invalid.
        """
        poses = self.forward_kinematics(positions, base)
        return {link: poses[..., row, :] for row, link in enumerate(self.link_names)}

    def jacobian(
        self, link: str, positions: JointValues, base: Any = None
    ) -> np.ndarray:
        """Compute the geometric Jacobian of the origin of a link.

        Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 2.10.

        Args:
            link: The link.
            positions: As for ``forward_kinematics``.
            base: As for ``forward_kinematics``.

        Returns:
            J such that J @ (base's linear velocity, base's angular velocity, joint
            velocities) is the link's linear, then angular velocity, all along the
            world's axes, shape (..., 6, 6 + n_joints).

        Raises:
            G1DescriptionError: If the link is unknown, or positions or base are
                invalid.
        """
        row = self.link_row(link)
        roots, placed = self._placed(positions, base)
        jacobians = Jacobians(self._kinematics, roots, placed)
        found = jacobians.of_links([row])[..., 0, :, :]
        # Convert the columns of the root to those of the base.
        bases = compose(roots, inverse(self._root_in_base))
        lever = (roots - bases)[..., np.newaxis, :3]
        shift = cross(np.eye(3), lever)
        found[..., :3, 3:6] += np.swapaxes(shift, -1, -2)
        return found

    def center_of_mass(self, positions: JointValues, base: Any = None) -> np.ndarray:
        """Compute the centre of mass: the mean of the links', weighted by their mass.

        Args:
            positions: As for ``forward_kinematics``.
            base: As for ``forward_kinematics``.

        Returns:
            In the world, in [m], shape (..., 3).

        Raises:
            DescriptionError: If the robot has no masses.
            G1DescriptionError: If positions or base are invalid.
        """
        return self._masses.robot_center(self.forward_kinematics(positions, base))

    @former_arguments(**_IK_ARGUMENTS)
    def ik(  # noqa: PLR0913  (its keywords are its documentation)
        self,
        targets: Mapping[str, Any],
        start: str | JointValues | None = None,
        base: Any = None,
        *,
        fixed_links: Collection[str] | None = None,
        balance: float | None = False,
        avoid_collisions: bool = False,
        floor: float | None = None,
        base_motion: str | None = None,
        weights: Mapping[str, float] | None = None,
        points: Mapping[str, Any] | None = None,
        limits: Sequence[Limit] = (),
        scene: SceneOrFile = None,
    ) -> IkResult:
        """Search a configuration in which links are where they should be.

        Damped steps, each a quadratic program with the limits as bounds. Sources:
        Nakamura and Hanafusa, J. Dyn. Sys. Meas. Control, 1986; Sugihara, IEEE Trans.
        Robotics, 2011; Kanoun et al., IEEE Trans. Robotics, 2011.

        Args:
            targets: Poses x y z and quaternion x y z w, shape (7,), only positions
                x y z, shape (3,), in the world, in [m], or a ``Target``, of links by
                their names, or by the names of roles and points in the profile, such
                as ``left_hand`` and ``left_palm``.
            start: Positions at which the search begins, shape (n_joints,) or by joint,
                clipped to the limits, or the name of a pose; the result is near them
                where targets leave a choice. None: neutral ones.
            base: Pose of the base link in the world at the start, shape (7,).
            fixed_links: Names or roles of links that stay where they are at the start;
                None: the profile's feet without targets.
            balance: Least distance in [m] of the centre of mass from the edges of the
                fixed links that stand on the floor; True: 0.03, or half the distance
                of their middle from the edges where that is less; None, False or 0:
                it may be anywhere.
            avoid_collisions: Whether links that are checked for collisions keep 2 mm
                apart.
            floor: Height in [m] below which no link gets, but for fixed ones; None:
                there is no floor.
            base_motion: How the base moves: ``free``, ``planar`` (along and about the
                floor) or ``fixed``; None: free if a link is fixed or a foot has a
                target, else fixed.
            weights: Those of targets by name, by default 1; infinite: the others must
                not disturb it, as with fixed links.
            points: Points of links that are brought to their targets, such as
                fingertips, x y z in the frame of the link in [m]; by default its
                origin.
            limits: Limits of your own; see ``ik.limits.Limit``.
            scene: Objects, or their file: links that move keep 2 mm apart, but what may
                touch them; feet and objects that are carried at 0 s only stay outside.

        Returns:
            The configuration. If not all can be reached it is the nearest one found,
            ``reached`` is False and ``message`` has the distances, and whether the
            search ended early because the solver found no further step.

        Raises:
            UnknownNameError: If a link or role is unknown.
            InvalidValueError: If an argument is invalid.
        """
        from g1_description.ik.options import IkOptions

        options = IkOptions(
            fixed_links=fixed_links,
            balance=balance,
            avoid_collisions=avoid_collisions,
            floor=floor,
            base_motion=base_motion,
            weights=weights,
            points=points,
            limits=limits,
            scene=as_scene(scene),
        )
        begin, pose = self._start(start, base)
        return self._inverse.solve(targets, begin, pose, options)

    def ik_trajectory(  # noqa: PLR0913
        self,
        times: Any,
        targets: Mapping[str, Any],
        start: str | JointValues | None = None,
        base: Any = None,
        *,
        fixed_links: Collection[str] | None = None,
        balance: float | str | None = False,
        avoid_collisions: bool = False,
        floor: float | None = None,
        base_motion: str | None = None,
        weights: Mapping[str, float] | None = None,
        points: Mapping[str, Any] | None = None,
        limits: Sequence[Limit] = (),
        scene: SceneOrFile = None,
        bounds: TrajectoryBounds | None = None,
        smooth: bool = True,
    ) -> IkPath:
        """Make a smooth motion in which links follow targets.

        Base and joints are cubic splines with a knot each 0.1 s, found as a whole by a
        sequence of quadratic programs. Sources: de Boor, A Practical Guide to Splines,
        2001; Nocedal and Wright, Numerical Optimization, 2006, chapters 16 and 18.

        Args:
            times: Times of the samples in [s], increasing, shape (n_samples,).
            targets: As for ``ik``, of each sample: shapes (n_samples, 7), (n_samples,
                3), or a ``Target`` of such arrays; one for all samples; or a function
                that returns a pose, position or ``Target`` at a time in [s].
            start: As for ``ik``: where the search for the first sample begins.
            base: As for ``ik``.
            fixed_links: As for ``ik``; they stay where they are at the start.
            balance: As for ``ik``; or ``"zmp"``: the zero-moment point, which counts
                in fast motions, keeps the default margin.
            avoid_collisions: As for ``ik``, like the next five.
            floor: Likewise.
            base_motion: Likewise.
            weights: Likewise.
            points: Likewise.
            limits: Likewise.
            scene: As for ``ik``; objects are carried while they are attached.
            bounds: Largest velocities and accelerations; None: the defaults of
                ``TrajectoryBounds``.
            smooth: False: each sample is as near to its targets as it gets from the one
                before within the velocity limits of joints. Nothing bounds the base and
                accelerations then.

        Returns:
            The motion, within the bounds, and a result for each sample. Where targets
            cannot be followed it is as near as it can be, and ``message`` says when, by
            how much, and which limits are reached there.

        Raises:
            UnknownNameError: If a link or role is unknown.
            InvalidValueError: If an argument is invalid.
        """
        from g1_description.ik.limits import TrajectoryBounds
        from g1_description.ik.options import IkOptions

        options = IkOptions(
            fixed_links=fixed_links,
            balance=balance,
            avoid_collisions=avoid_collisions,
            floor=floor,
            base_motion=base_motion,
            weights=weights,
            points=points,
            limits=limits,
            scene=as_scene(scene),
        )
        begin, pose = self._start(start, base)
        given = as_numbers(times, "time"), targets, begin, pose, options
        if not isinstance(smooth, (bool, np.bool_)):
            raise InvalidValueError(
                f"smooth must be True or False (got {str(smooth)[:80]})."
            )
        if not smooth:
            return self._inverse.path(*given)
        limited = TrajectoryBounds() if bounds is None else bounds
        return self._inverse.trajectory(*given, limited)

    @former_arguments(**_IK_ARGUMENTS)
    def ik_path(
        self,
        times: Any,
        targets: Mapping[str, Any],
        start: str | JointValues | None = None,
        base: Any = None,
        **options: Any,
    ) -> IkPath:
        """Return ``ik_trajectory(smooth=False)``, whose former name this is."""
        warn_of_former("Robot.ik_path", "ik_trajectory")
        return self.ik_trajectory(times, targets, start, base, smooth=False, **options)

    def keyframes(
        self,
        entries: Sequence[Any],
        times: Any,
        fixed_links: Collection[str] | None = None,
        through: str = "stop",
    ) -> Keyframes:
        """Make a smooth motion through keyframes, as in the web UI.

        It keeps to the velocity limits of joints, and the base to 1 m/s, 3 m/s^2 and
        2 rad/s: times are lengthened for these, and ``message`` names the first one.

        Args:
            entries: Positions of shape (n_joints,) or by joint, names of poses,
                results of ``ik``, or pairs of one of these and a pose of the base in
                the map, shape (7,). Positions are clipped to the limits. Without a
                base, a robot with feet stands upright on the floor, z = 0, its first
                fixed link at the place and heading of the keyframe before.
            times: In [s], increasing, shape (n_keyframes,); rounded to multiples of
                0.02 s after the first one.
            fixed_links: Names or roles of the links that stay in between if they are in
                one place in two successive keyframes, within 1 mm and 0.5 degrees;
                None: the profile's feet.
            through: ``stop``: at rest in each keyframe, with minimum jerk in between;
                ``pass``: a cubic spline without overshoot, at rest where a link
                begins or ends to stay.

        Returns:
            The keyframes, with the ``motion`` through them.

        Raises:
            UnknownNameError: If a pose, joint or link is unknown.
            InvalidValueError: If an argument is invalid, there are fewer than two
                keyframes, or times do not increase.
        """
        from g1_description.ik.keyframe_poses import keyframes_at

        frames = keyframes_at(self.description, entries, times, fixed_links)
        return self._through(frames, fixed_links, through)

    def read_keyframes(
        self, path: str | PathLike[str] | None = None, name: str | None = None
    ) -> Keyframes:
        """Read keyframes that ``Keyframes.save`` or the web UI saved.

        Args:
            path: The file of poses; None: your own, in which the web UI saves.
            name: The name under which they were saved; None: there is only one.

        Returns:
            The keyframes, with the motion through them.

        Raises:
            G1DescriptionError: If the file cannot be read, does not have them, or they
                do not fit the robot.
        """
        from g1_description.ik.keyframe_poses import saved_keyframes

        return self._through(*saved_keyframes(self.description, path, name))

    def _through(
        self, frames: Sequence[Keyframe], links: Collection[str] | None, through: str
    ) -> Keyframes:
        from g1_description.ik.keyframes import keyframe_pieces

        robot, inverse = self.description, self._inverse
        *_, made = keyframe_pieces(robot, inverse, links, frames, through)
        assert made is not None
        return made

    def _start(
        self, start: str | JointValues | None, base: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the configuration at which inverse kinematics begins."""
        begin = self._configuration(self.neutral if start is None else start)
        return begin, IDENTITY if base is None else one_pose(base)

    def _configuration(self, given: str | JointValues) -> np.ndarray:
        """Return a single configuration, given as positions or by its name."""
        if isinstance(given, str):
            return self.named_configuration(given)
        found = self.positions(given)
        if found.ndim != 1:
            raise InvalidValueError(
                f"Positions must be a single configuration (got shape {found.shape})."
            )
        return found

    @cached_property
    def _inverse(self) -> PathKinematics:
        from g1_description.ik.paths import PathKinematics

        return PathKinematics(self.description, lambda: self._usual_checker.collisions)

    def inverse_dynamics(
        self,
        positions: JointValues,
        velocities: JointValues | None = None,
        accelerations: JointValues | None = None,
        base: Any = None,
    ) -> np.ndarray:
        """Compute joint efforts of a configuration or motion with a fixed base.

        Newton's and Euler's equations of all links. Source: Featherstone, Rigid Body
        Dynamics Algorithms, 2008, chapter 5.

        Args:
            positions: Positions of the joints, shape (..., n_joints), or by joint.
            velocities: In [rad/s] or [m/s], like positions; by default 0.
            accelerations: In [rad/s^2] or [m/s^2], like positions; by default 0.
            base: Pose of the base link in the world, whose z is up, shape (..., 7).

        Returns:
            Efforts about or along the axes of the joints, in [N m] or [N], under
            gravity of 9.8 m/s^2 along -z of the world, shape (..., n_joints).

        Raises:
            DescriptionError: If the robot has no masses.
            G1DescriptionError: If an argument is invalid.
        """
        if not self._masses.total > 0.0:
            raise DescriptionError(
                f"{self.name} has no masses, so efforts cannot be computed."
            )
        root, placed = self._placed(positions, base)
        rates = [
            self._rates(velocities, placed.shape, "velocity"),
            self._rates(accelerations, placed.shape, "acceleration"),
        ]
        still = np.zeros((*placed.shape[:-1], 6))
        motion = RobotMotion(root, placed, still, rates[0], still, rates[1])
        return inverse_dynamics(self._kinematics, self._masses, motion).efforts

    def read_motion(
        self,
        path: str | PathLike[str],
        rate: float | None = None,
        order: str | None = None,
        format: str | None = None,
        joint_order: str | None = None,
    ) -> Motion:
        """Read a motion from a file.

        Args:
            path: The file or folder, ``FILE#NAME`` for one of several motions in a
                file, ``package://PACKAGE/PATH``, or the name of a motion of this
                package such as ``squat.csv``.
            rate: Samples per second of a file without times, in [Hz].
            order: Order of base quaternions in the file, ``xyzw`` or ``wxyz``;
                None: that of the format, or the one in which the robot stands.
            format: Name of the format, as documented; None: found by content.
            joint_order: Order of joints without names, ``mujoco`` or ``isaaclab``;
                None: that of the format.

        Returns:
            The motion with the joints that the robot has, in the order of the file;
            ``notes`` are messages on assumptions and on joints that do not fit.

        Raises:
            MotionError: If the file cannot be read, or its motion does not fit the
                robot.
        """
        if rate is not None and not (
            isinstance(rate, (int, float, np.number)) and 0.0 < rate < np.inf
        ):
            raise MotionError(
                f"The rate must be a number greater than 0 (got {rate!r})."
            )
        if order not in (None, "xyzw", "wxyz"):
            raise MotionError(f"The order must be xyzw or wxyz (got {order!r}).")
        if joint_order not in (None, *JOINT_ORDERS):
            raise MotionError(
                f"joint_order must be one of {', '.join(JOINT_ORDERS)} (got "
                f"{joint_order!r})."
            )
        file = motion_path(path)
        options = ReadOptions(rate, None, order, format, joint_order)
        return read_motion(file, self.description, options)

    @former_arguments(trajectory="motion")
    def write_motion(
        self,
        path: str | PathLike[str],
        motion: MotionLike,
        rate: float | None = None,
        format: str | None = None,
    ) -> tuple[str, ...]:
        """Write a motion to a file.

        Args:
            path: The file, or the folder of a format that is one; an existing file is
                replaced.
            motion: The motion.
            rate: Samples per second of a format with evenly spaced samples, in [Hz];
                None: the average rate of the motion.
            format: Name of the format, as documented; None: csv or npz, by the ending.

        Returns:
            Messages on differences from the motion.

        Raises:
            MotionError: If the format does not support it.
            InvalidValueError: If the file cannot be written.
        """
        file = Path(path).expanduser()
        return write_motion(file, as_motion(motion), self.description, rate, format)

    @former_arguments(base_poses="base")
    def trajectory(
        self,
        times: Any,
        positions: JointValues,
        velocities: JointValues | None = None,
        base: Any = None,
    ) -> Motion:
        """Make a motion of all joints.

        Args:
            times: In [s], increasing, shape (n_samples,).
            positions: Positions of the joints in [rad] or [m], shape (n_samples,
                n_joints), or by joint.
            velocities: In [rad/s] or [m/s], like positions; None: unknown, positions
                are interpolated linearly.
            base: Poses of the base link in the map, shape (n_samples, 7); None: the
                motion has no base.

        Returns:
            The motion, its joints in the order of the robot.

        Raises:
            G1DescriptionError: If an argument is invalid.
        """
        placed = self.positions(positions)
        rates = (
            None
            if velocities is None
            else self._rates(velocities, placed.shape, "velocity")
        )
        poses = None if base is None else as_poses(base)
        own_times = np.array(times, dtype=float)
        return Motion(own_times, self.joint_names, placed, rates, poses)

    def to_message(
        self, positions: JointValues | None, base: Any = None, stamp: Any = None
    ) -> RobotTrajectory:
        """Write a configuration as a message for the topic ``motion``; needs ROS.

        Args:
            positions: Positions of all joints as an array, or of some as a
                dictionary, in [rad] or [m]; None: no joint moves.
            base: Pose of the base link in the map, shape (7,); None: it stays.
            stamp: When the configuration is shown, a rospy.Time; None: at once.

        Returns:
            The message.

        Raises:
            G1DescriptionError: If positions or base are invalid.
            ImportError: If this Python has no ROS.
        """
        names, numbers = named_positions(positions, self.joint_names)
        poses = None if base is None else one_pose(base)[np.newaxis]
        motion = Motion(np.zeros(1), names, np.array([numbers]), base_poses=poses)
        return self.trajectory_message(motion, stamp)

    def trajectory_message(
        self, motion: MotionLike, stamp: Any = None
    ) -> RobotTrajectory:
        """Write a motion as a message for the topic ``motion``; needs ROS.

        Args:
            motion: The motion. Its part ``joint_trajectory`` is what the topic
                ``joint_trajectory`` and the action take.
            stamp: When the motion starts, a rospy.Time; None: at once.

        Returns:
            The message.

        Raises:
            UnknownNameError: If it has unknown joints.
            ImportError: If this Python has no ROS.
        """
        motion = as_motion(motion)
        check_names(motion.joint_names, self.joint_names)
        return _messages().whole_body_message(motion, stamp)

    def from_message(self, message: Any) -> Motion:
        """Read a motion from a message; needs ROS.

        Args:
            message: A RobotTrajectory, its base in the map, or a JointTrajectory.

        Returns:
            The motion; a configuration is a motion of one sample at 0 s.

        Raises:
            G1DescriptionError: If the message is no motion of this robot.
            ImportError: If this Python has no ROS.
        """
        return _messages().motion_from_message(message, self.joint_names)

    @former_arguments(trajectory="motion")
    def positions_of(self, motion: MotionLike) -> np.ndarray:
        """Arrange the positions of a motion in the order of the robot's joints.

        Args:
            motion: The motion.

        Returns:
            Positions in [rad] or [m], shape (n_samples, n_joints); joints missing from
            it are neutral.

        Raises:
            UnknownNameError: If it has unknown joints.
        """
        motion = as_motion(motion)
        if not motion.joint_names:
            return np.tile(self.neutral, (len(motion.times), 1))
        return self.positions(dict(zip(motion.joint_names, motion.positions.T)))

    def mirrored(self, motion: MotionLike) -> Motion:
        """Exchange left and right of a motion, at the plane y = 0 of the map.

        Args:
            motion: The motion. Joints belong together by their names, such as
                ``left_knee`` and ``right_knee``.

        Returns:
            The mirrored motion.

        Raises:
            MotionError: If it has unknown joints, or the robot is not symmetric.
        """
        return mirrored(as_motion(motion), self.description)

    def padded(
        self,
        motion: MotionLike,
        begin: str | JointValues | None = None,
        end: str | JointValues | None = None,
        seconds: float = 1.0,
    ) -> Motion:
        """Let a motion come from a pose and end in one, standing on the floor, z = 0.

        Joints move with minimum jerk. Source: Flash and Hogan, J. Neuroscience, 1985.

        Args:
            motion: A motion, whose lowest foot keeps its place; poses are upright.
            begin: Name of a pose, or positions in [rad] or [m], shape (n_joints,) or by
                joint; None: nothing is added there.
            end: Like ``begin``, after the motion.
            seconds: Shortest duration of each way, in [s]; longer where a joint would
                exceed its velocity limit.

        Returns:
            The motion from 0 s on.

        Raises:
            G1DescriptionError: If a pose or the duration is invalid.
        """
        before, after = self._by_joint(begin), self._by_joint(end)
        return padded(self.description, as_motion(motion), before, after, seconds)

    def _by_joint(self, pose: str | JointValues | None) -> dict[str, float] | None:
        """Return the positions of a pose by joint."""
        if pose is None:
            return None
        return dict(zip(self.joint_names, self._configuration(pose).tolist()))

    def on_floor(self, motion: MotionLike) -> Motion:
        """Lift or lower a whole motion so that its lowest point is at z = 0 of the map.

        Args:
            motion: The motion.

        Returns:
            The motion, all its bases moved by one height.

        Raises:
            MotionError: If it has no base.
        """
        return on_floor(self.description, as_motion(motion))

    def check(
        self,
        motion: MotionLike | str | PathLike[str],
        only: Collection[str] = (),
        thresholds: ThresholdValues = None,
        fixed_base: bool = False,
        scene: SceneOrFile = None,
    ) -> Verdict:
        """Check a motion.

        Args:
            motion: The motion, or its file.
            only: Names of the checks to make; none: all.
            thresholds: Changes of the default thresholds: a YAML file, or its content
                such as ``{"skating": {"failure": 0.5}}``.
            fixed_base: Whether the base is fixed, so that efforts are determined.
            scene: The objects around the robot, or their file; None: there are none.

        Returns:
            The findings and measurements; ``passed`` is False if any check failed.

        Raises:
            G1DescriptionError: If the motion does not fit the robot, or a check or
                threshold is unknown.
        """
        checker = self.checker(thresholds, fixed_base, scene=scene)
        return checker.check(self._fitted(motion), _names(only))

    def mended(
        self,
        motion: MotionLike | str | PathLike[str],
        only: Collection[str] = (),
        max_change: float = inf,
        max_base: float = inf,
        keep_hands: bool = False,
        thresholds: ThresholdValues = None,
        physics: bool = False,
    ) -> Mended:
        """Remove what checks find in a motion by small changes.

        Args:
            motion: The motion, or its file.
            only: Of ``outliers``, ``noise``, ``floor``, ``limits``, ``feet``,
                ``collisions``, ``speed`` and ``balance``; none: all.
            max_change: Largest change of a joint in [rad] or [m].
            max_base: Largest change of the base's place in [m].
            keep_hands: Whether hands keep their paths in the map.
            thresholds: As for ``check``.
            physics: Whether the motion is simulated before and after, and a change with
                which the robot falls earlier is not kept.

        Returns:
            The mended ``motion``, which is the given one if nothing was changed, and a
            ``certificate`` of findings and changes.

        Raises:
            G1DescriptionError: If the motion does not fit the robot, or an option is
                wrong.
        """
        from g1_description.mend.mending import mended
        from g1_description.mend.options import MendOptions

        options = MendOptions(_names(only), max_change, max_base, keep_hands)
        checker = self.checker(thresholds, physics=physics)
        return mended(checker, self._fitted(motion), options)

    def contact_forces(
        self,
        motion: MotionLike | str | PathLike[str],
        thresholds: ThresholdValues = None,
        scene: SceneOrFile = None,
    ) -> ContactForces:
        """Find the forces of the floor that a motion needs, and what is missing.

        Args:
            motion: The motion with its base, or its file; with one sample, at rest.
            thresholds: As for ``check``.
            scene: As for ``check``.

        Returns:
            Forces on links, efforts of joints, and what no contact can give.

        Raises:
            MotionError: If the motion has no base, too few samples per second, or does
                not fit the robot.
            G1DescriptionError: If a file or threshold is wrong.
        """
        return self.checker(thresholds, scene=scene).contact_forces(
            self._fitted(motion)
        )

    def write_page(
        self,
        path: str | PathLike[str],
        motion: MotionLike,
        verdict: Verdict | None = None,
    ) -> None:
        """Write a page in three dimensions: the robot, a motion and its findings.

        It is one file that any browser opens from disk.

        Args:
            path: The file, .html; an existing one is replaced.
            motion: The motion; a configuration is a motion of one sample.
            verdict: Result of ``check``; None: the motion was not checked.

        Raises:
            MotionError: If the robot has none of the motion's joints.
            InvalidValueError: If the file cannot be written.
        """
        from g1_description.render.page import motion_page

        file, motion = Path(path).expanduser(), as_motion(motion)
        text = motion_page(self.description, motion, verdict, motion.name or file.stem)
        write_whole(file, text.encode("utf-8", "backslashreplace"))

    def compare(
        self,
        reference: MotionLike | str | PathLike[str],
        executed: MotionLike | str | PathLike[str],
        shift: float | None = None,
    ) -> Comparison:
        """Compare an executed motion with its reference.

        Args:
            reference: The motion that was to be executed, or its file.
            executed: The measured motion, or its file.
            shift: Time of the executed motion minus that of the reference, in [s];
                None: the one with the smallest rms error of the joints.

        Returns:
            Their differences at the samples of the executed motion.

        Raises:
            G1DescriptionError: If they do not fit the robot, or have nothing in common.
        """
        from g1_description.checks.comparison import compare

        motions = self._fitted(reference), self._fitted(executed)
        return compare(self.checker(), *motions, shift)

    def _fitted(self, motion: MotionLike | str | PathLike[str]) -> Motion:
        """Return the motion, or that of a file, with the joints of this robot."""
        if isinstance(motion, (str, PathLike)):
            return self.read_motion(motion)
        return fitted(as_motion(motion), self.description)

    def check_state(
        self,
        positions: JointValues,
        base: Any = None,
        only: Collection[str] = (),
        thresholds: ThresholdValues = None,
        scene: SceneOrFile = None,
    ) -> Verdict:
        """Check a configuration at rest.

        Args:
            positions: Positions of the joints, shape (n_joints,), or by joint.
            base: Pose of the base link in the map, whose floor is z = 0, shape (7,);
                None: unknown, the floor is not checked.
            only: Names of the checks to make; none: all.
            thresholds: As for ``check``.
            scene: As for ``check``.

        Returns:
            The findings; ``passed`` is False if any check failed.

        Raises:
            G1DescriptionError: If the configuration is invalid, or a check or threshold
                is unknown.
        """
        placed = self.positions(positions)
        pose = None if base is None else as_poses(base)
        for array, shape in ((placed, (len(self.joint_names),)), (pose, (7,))):
            if array is not None and array.shape != shape:
                raise InvalidValueError(
                    "A configuration must have positions of shape "
                    f"({len(self.joint_names)},) and a base of shape (7,) (got "
                    f"{array.shape})."
                )
        checker = self.checker(thresholds, scene=scene)
        by_name = dict(zip(self.joint_names, placed.tolist()))
        return checker.check_state(by_name, pose, _names(only))

    def checker(
        self,
        thresholds: ThresholdValues = None,
        fixed_base: bool = False,
        physics: bool = False,
        visual_hulls: bool = True,
        engine: str = "",
        scene: SceneOrFile = None,
    ) -> Checker:
        """Create a checker for many motions.

        Args:
            thresholds: As for ``check``.
            fixed_base: Whether the base is fixed, so that efforts are determined.
            physics: Whether motions are also simulated, with the robot's motors.
            visual_hulls: Whether links without collision shapes use the convex hulls of
                their visuals.
            engine: Physics engine of simulations, ``bullet`` or ``mujoco``; empty:
                MuJoCo, if it is installed.
            scene: As for ``check``.

        Returns:
            The checker, whose ``check`` takes a motion with joints of this robot.

        Raises:
            G1DescriptionError: If a file cannot be read, a threshold is unknown, or an
                engine is not installed.
        """
        is_usual = thresholds is None and visual_hulls and scene is None
        if is_usual and not (fixed_base or physics):
            return self._usual_checker
        from g1_description.checks.checker import Checker
        from g1_description.sim.engines import fastest_engine
        from g1_description.sim.rollout import Conditions

        conditions = None
        if physics:
            motors_of(self.description)  # a wrong file is refused at once
            conditions = Conditions(
                engine=engine or fastest_engine(), fixed_base=fixed_base
            )
        usual = self._usual_checker if visual_hulls else None
        shapes = usual.collisions if usual else self._shapes(visual_hulls=False)
        limits = _thresholds(thresholds)
        found = Checker(self.description, limits, fixed_base, shapes, conditions)
        return found if scene is None else found.among(as_scene(scene), visual_hulls)

    def self_collisions(
        self, positions: JointValues, base: Any = None, margin: float = 0.0
    ) -> Contacts:
        """Find self-collisions, except of allowed pairs.

        Args:
            positions: Positions by joint, or of shape (n, n_joints) or (n_joints,).
            base: Poses of the base link in the world, shape (n, 7) or (7,).
            margin: In [m]; links nearer than this are found; 0: only overlaps.

        Returns:
            The contacts; ``sample`` is the index of the configuration, ``pair`` that of
            the links in ``collision_pairs``, ``distance`` in [m] is negative for
            overlaps: the shortest way out.

        Raises:
            G1DescriptionError: If positions or base are invalid.
        """
        poses = self.forward_kinematics(positions, base)
        poses = poses.reshape(-1, len(self.link_names), 7)
        return self._usual_checker.collisions.contacts(poses, margin)

    collisions = former("Robot.collisions", "self_collisions")

    @property
    def collision_pairs(self) -> tuple[tuple[str, str], ...]:
        """The pairs of links that are checked for collisions."""
        return self._usual_checker.collisions.pairs

    def _rates(
        self, given: JointValues | None, shape: tuple[int, ...], label: str
    ) -> np.ndarray:
        """Arrange velocities or accelerations like positions; by default 0."""
        still = np.zeros(len(self.joint_names))
        if given is None:
            return np.broadcast_to(still, shape)
        rates = as_array(given, self.joint_names, still, label)
        try:
            return np.broadcast_to(rates, shape)
        except ValueError as error:
            raise InvalidValueError(
                f"The {label} array of shape {rates.shape} does not match positions of "
                f"shape {shape}."
            ) from error

    @cached_property
    def _ranges(self) -> tuple[np.ndarray, np.ndarray]:
        """Ranges of random positions, shapes (n_joints,)."""
        lower, upper = self.lower, self.upper
        has_lower, has_upper = np.isfinite(lower), np.isfinite(upper)
        for row, joint in enumerate(self.description.movable_joints):
            if joint.kind == "prismatic" and not (has_lower & has_upper)[row]:
                raise InvalidValueError(
                    f"{joint.name} needs finite limits for random positions (got "
                    f"{joint.lower:g} to {joint.upper:g})."
                )
        turn = 2.0 * np.pi
        begin = np.where(has_upper, upper - turn, -np.pi)
        end = np.where(has_lower, lower + turn, np.pi)
        return np.where(has_lower, lower, begin), np.where(has_upper, upper, end)

    @cached_property
    def _kinematics(self) -> Kinematics:
        return Kinematics(self.description)

    @cached_property
    def _masses(self) -> Masses:
        return Masses(self.description)

    @cached_property
    def _root_in_base(self) -> np.ndarray:
        return root_in_base(self.description)

    def _placed(
        self, positions: JointValues, base: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return poses of the root link and positions, with the same leading axes."""
        placed = self.positions(positions)
        roots = IDENTITY if base is None else as_poses(base)
        if self.base_link != self.description.root:
            roots = compose(roots, self._root_in_base)
        first, second = roots.shape[:-1], placed.shape[:-1]
        try:
            arrays = np.broadcast_to(0, first), np.broadcast_to(0, second)
            lead = np.broadcast(*arrays).shape
        except ValueError as error:
            raise InvalidValueError(
                f"The leading axes {first} and {second} do not match."
            ) from error
        return (
            np.broadcast_to(roots, (*lead, 7)),
            np.broadcast_to(placed, (*lead, len(self.joint_names))),
        )

    @cached_property
    def _usual_checker(self) -> Checker:
        """The checker with default arguments; preparing it takes a second."""
        # Imported late: PyBullet and scipy are slow, and most programs check nothing.
        from g1_description.checks.checker import Checker

        return Checker(self.description, collisions=self._shapes())

    def _shapes(self, visual_hulls: bool = True) -> SelfCollisions:
        """Prepare the self-collisions."""
        from g1_description.collisions.find_pairs import collisions_of

        return collisions_of(self.description, self._allowed, visual_hulls)


def _messages() -> Any:
    """Import what converts messages; a robot itself needs no ROS."""
    try:
        from g1_description.ros import motion_messages
    except ImportError as error:
        raise ImportError(
            f"Messages need {error.name}, which {sys.executable} lacks: source the "
            "workspace and use /usr/bin/python3."
        ) from error
    return motion_messages


def _row(kind: str, name: str, names: Sequence[str]) -> int:
    """Return the index of a name."""
    if name not in names:
        known = listed(similar_first(name, names)) or "none"
        raise UnknownNameError(f"Unknown {kind} '{name}'. Known: {known}.")
    return names.index(name)


def _each(joints: Sequence[Joint], value: Callable[[Joint], float]) -> np.ndarray:
    """Collect a number of each joint, shape (n_joints,)."""
    return _frozen(np.array([value(joint) for joint in joints], dtype=float))


def _frozen(array: np.ndarray) -> np.ndarray:
    """Make an array read-only."""
    array.setflags(write=False)
    return array


def _names(only: Collection[str]) -> Collection[str]:
    """Accept a single name, too."""
    return (only,) if isinstance(only, str) else only


def _thresholds(given: ThresholdValues) -> Thresholds:
    """Read thresholds, if necessary."""
    if isinstance(given, Thresholds):
        return given
    from g1_description.checks.thresholds_file import read_thresholds, with_thresholds

    if isinstance(given, Mapping):
        return with_thresholds(read_thresholds(), given)
    return read_thresholds(None if given is None else Path(given).expanduser())
