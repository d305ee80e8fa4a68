"""The named frames of an SDF document, and the poses that are written in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from lxml import etree

from g1_description.errors import DescriptionError
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.robot.xml_values import pose_of

MODEL = "__model__"
"""What SDF calls a model's own frame."""


class Frames:
    """The named frames of a model or a world, each given in another one.

    Args:
        owner: Whose frames they are, for the sentences.
        root: Name of the frame that all others are placed in.
    """

    def __init__(self, owner: str, root: str) -> None:
        self._owner = owner
        self._given: dict[str, tuple[np.ndarray, str]] = {}
        self._placed = {root: IDENTITY}

    def __contains__(self, name: str) -> bool:
        """Return whether there is a frame of this very name."""
        return name in self._given or name in self._placed

    def add(self, name: str, pose: np.ndarray, relative_to: str) -> None:
        """Add a frame.

        Args:
            name: Its name.
            pose: Its pose in the other frame, shape (7,).
            relative_to: Name of the other frame, which may be added later.

        Raises:
            DescriptionError: If there is one of that name.
        """
        if name in self:
            raise DescriptionError(
                f"There are two of the name {name} in {self._owner}."
            )
        self._given[name] = pose, relative_to

    def pose(self, name: str) -> np.ndarray:
        """Place a frame in the root frame.

        Returns:
            Its pose, shape (7,).

        Raises:
            DescriptionError: If there is none of that name, or it hangs on itself.
        """
        above: dict[str, None] = {}
        name = self._known(name)
        while name not in self._placed:
            if name in above:
                raise DescriptionError(
                    f"The frames of {self._owner} hang on each other in a loop: "
                    f"{' on '.join([*above, name])}."
                )
            above[name] = None
            name = self._known(self._given[name][1])
        for frame in reversed(list(above)):
            pose, relative_to = self._given[frame]
            self._placed[frame] = compose(self._placed[self._known(relative_to)], pose)
        return self._placed[self._known(next(iter(above), name))]

    def between(self, frame: str, other: str) -> np.ndarray:
        """Give the pose of a frame in another one.

        Args:
            frame: The frame that the pose is written in.
            other: The frame that is placed.

        Returns:
            T_frame_other, shape (7,).
        """
        return compose(inverse(self.pose(frame)), self.pose(other))

    def _known(self, name: str) -> str:
        """Find what a name means: a frame, or a model inside with its own frame."""
        for meant in (name, f"{name}::{MODEL}"):
            if meant in self:
                return meant
        raise DescriptionError(f"There is no frame {name} in {self._owner}.")


@dataclass(frozen=True)
class Scope:
    """Where a name of the file is looked up: a model, or one inside of it."""

    prefix: str
    """What stands before its names; empty for the outer model."""

    frames: Frames
    """Those of the outer model."""

    def full(self, name: str) -> str:
        """Give the name that the outer model has for a name of this one."""
        return f"{self.prefix}{name}"

    def add(self, name: str, element: etree._Element, relative_to: str) -> None:
        """Add the frame that an element is.

        Args:
            name: Its full name.
            element: The element, which may have a pose.
            relative_to: Name of the frame that its pose is in by default.
        """
        pose, other = pose_of(element, f"{element.tag} {name}")
        self.frames.add(name, pose, self.full(other or relative_to))

    def pose_in(self, frame: str, element: etree._Element, owner: str) -> np.ndarray:
        """Give the pose of an element that is no frame itself.

        Args:
            frame: Full name of the frame that its pose is in by default.
            element: The element, which may have a pose.
            owner: What it is called, for the sentences.

        Returns:
            Its pose in that frame, shape (7,).
        """
        pose, other = pose_of(element, owner)
        if not other:
            return pose
        return compose(self.frames.between(frame, self.full(other)), pose)
