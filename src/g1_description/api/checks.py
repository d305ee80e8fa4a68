"""Verdicts over a robot's configurations and motions."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

from g1_description.core.checks.thresholds import (
    Thresholds,
    read_thresholds,
    with_thresholds,
)
from g1_description.core.checks.verdict import Verdict
from g1_description.core.errors import InvalidValueError
from g1_description.core.motion.motion import Motion, fitted
from g1_description.core.motion.trajectory import Trajectory

from .joint_values import JointValues
from .kinematics import RobotKinematics
from .motions import RobotMotions
from .poses import as_poses

if TYPE_CHECKING:
    from g1_description.sim.checks.checker import Checker
    from g1_description.sim.collisions.shape_collisions import Contacts

ThresholdValues = Union[Thresholds, "Mapping[str, Any]", str, "PathLike[str]", None]
"""A YAML file, or what it would hold; None: the defaults."""


class RobotChecks(RobotKinematics, RobotMotions):
    """A robot whose configurations and motions can be judged."""

    def check(
        self,
        motion: Motion | Trajectory | str | PathLike[str],
        only: Collection[str] = (),
        thresholds: ThresholdValues = None,
        fixed_base: bool = False,
    ) -> Verdict:
        """Judge a motion.

        Args:
            motion: The motion, or its file.
            only: Names of the checks to make; none: all.
            thresholds: What is a warning and what a failure: a YAML file, or its
                content such as ``{"skating": {"failure": 0.5}}``.
            fixed_base: Whether something holds the base, so that efforts are known.

        Returns:
            What was found; ``passed`` is False if anything failed.

        Raises:
            G1DescriptionError: If the motion is none of this robot, or there is no such
                check or threshold.
        """
        if isinstance(motion, Trajectory):
            motion = Motion(motion)
        elif not isinstance(motion, Motion):
            motion = self.read_motion(motion)
        motion = fitted(motion, self.description)
        checker = self._checker(thresholds, fixed_base)
        return checker.check_motion(motion, _names(only)).verdict

    def check_state(
        self,
        positions: JointValues,
        base: Any = None,
        only: Collection[str] = (),
        thresholds: ThresholdValues = None,
    ) -> Verdict:
        """Judge a configuration at rest.

        Args:
            positions: Of the joints, shape (n_joints,), or by joint.
            base: Pose of the base link, shape (7,); by default unknown: the floor is
                not judged.
            only: Names of the checks to make; none: all.
            thresholds: As for ``check``.

        Raises:
            G1DescriptionError: If that is no configuration of this robot, or there is
                no such check or threshold.
        """
        placed = self.positions(positions)
        pose = None if base is None else as_poses(base)
        for array, shape in ((placed, (len(self.joint_names),)), (pose, (7,))):
            if array is not None and array.shape != shape:
                raise InvalidValueError(
                    f"An array of shape {array.shape} is given; a configuration has "
                    f"positions of shape ({len(self.joint_names)},) and a base of (7,)."
                )
        checker = self._checker(thresholds, fixed_base=False)
        by_name = dict(zip(self.joint_names, placed.tolist()))
        return checker.check_state(by_name, pose, _names(only))

    def collisions(
        self, positions: JointValues, base: Any = None, margin: float = 0.0
    ) -> Contacts:
        """Find where links touch each other, besides those that may by design.

        Args:
            positions: Of the joints, shape (n, n_joints) or (n_joints,), or by joint.
            base: Poses of the base link, shape (n, 7) or (7,).
            margin: In [m]; links that are nearer are found; 0: those that overlap.

        Returns:
            The contacts; ``frame`` is the row of the configuration, ``pair`` the row of
            the links in ``collision_pairs``, ``distance`` is negative where they
            overlap.

        Raises:
            G1DescriptionError: If that are no configurations of this robot.
        """
        poses = self.forward_kinematics(positions, base)
        poses = poses.reshape(-1, len(self.link_names), 7)
        return self._usual_checker.collisions.contacts(poses, margin)

    @property
    def collision_pairs(self) -> tuple[tuple[str, str], ...]:
        """The pairs of links that are checked for collisions."""
        return self._usual_checker.collisions.pairs

    @cached_property
    def _usual_checker(self) -> Checker:
        """All checks with the usual thresholds; their preparation takes a second."""
        # PyBullet and scipy take a while, and most programs check nothing.
        from g1_description.sim.checks.checker import Checker

        return Checker.of(self.description)

    def _checker(self, given: ThresholdValues, fixed_base: bool) -> Checker:
        """Return the checks with some thresholds."""
        checker = self._usual_checker
        if given is None and not fixed_base:
            return checker
        if given is None:
            thresholds = checker.thresholds
        elif isinstance(given, Thresholds):
            thresholds = given
        elif isinstance(given, Mapping):
            thresholds = with_thresholds(checker.thresholds, given)
        else:
            thresholds = read_thresholds(Path(given).expanduser())
        from g1_description.sim.checks.checker import Checker

        changed = Checker(
            self.description, checker.collisions, thresholds, fixed_base=fixed_base
        )
        changed.notes = checker.notes
        return changed


def _names(only: Collection[str]) -> Collection[str]:
    """Take a single name as well: as a collection, it is one of letters."""
    return (only,) if isinstance(only, str) else only
