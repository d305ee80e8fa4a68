"""The named frames of an SDF document, and poses relative to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from lxml import etree

from g1_description.errors import DescriptionError
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.robot.xml_values import pose_of

MODEL = "__model__"
"""SDF's name of a model's frame."""


class Frames:
    """The named frames of a model or world, each relative to another one.

    Args:
        owner: Owner of the frames, for messages.
        root: Name of the root frame.
    """

    def __init__(self, owner: str, root: str) -> None:
        self._owner = owner
        self._given: dict[str, tuple[np.ndarray, str]] = {}
        self._placed = {root: IDENTITY}

    def __contains__(self, name: str) -> bool:
        """Return whether there is a frame with exactly this name."""
        return name in self._given or name in self._placed

    def add(self, name: str, pose: np.ndarray, relative_to: str) -> None:
        """Add a frame.

        Args:
            name: Its name.
            pose: Its pose in the other frame, shape (7,).
            relative_to: Name of the other frame, which may be added later.

        Raises:
            DescriptionError: If the name is used.
        """
        if name in self:
            raise DescriptionError(f"The name {name} is used twice in {self._owner}.")
        self._given[name] = pose, relative_to

    def pose(self, name: str) -> np.ndarray:
        """Compute the pose of a frame in the root frame.

        Returns:
            Its pose, shape (7,).

        Raises:
            DescriptionError: If there is no such frame, or frames refer to each other
                in a loop.
        """
        above: dict[str, None] = {}
        name = self._known(name)
        while name not in self._placed:
            if name in above:
                raise DescriptionError(
                    f"The frames of {self._owner} refer to each other in a loop: "
                    f"{' on '.join([*above, name])}."
                )
            above[name] = None
            name = self._known(self._given[name][1])
        for frame in reversed(list(above)):
            pose, relative_to = self._given[frame]
            self._placed[frame] = compose(self._placed[self._known(relative_to)], pose)
        return self._placed[self._known(next(iter(above), name))]

    def between(self, frame: str, other: str) -> np.ndarray:
        """Compute the pose of a frame in another one.

        Args:
            frame: The reference frame.
            other: The other frame.

        Returns:
            T_frame_other, shape (7,).
        """
        return compose(inverse(self.pose(frame)), self.pose(other))

    def _known(self, name: str) -> str:
        """Resolve a name: a frame, or the frame of a nested model."""
        for meant in (name, f"{name}::{MODEL}"):
            if meant in self:
                return meant
        raise DescriptionError(f"Unknown frame {name} in {self._owner}.")


@dataclass(frozen=True)
class Scope:
    """The scope of names: a model, or a nested one."""

    prefix: str
    """Prefix of its names; empty for the outer model."""

    frames: Frames
    """Frames of the outer model."""

    def full(self, name: str) -> str:
        """Return the full name in the outer model."""
        return f"{self.prefix}{name}"

    def add(self, name: str, element: etree._Element, relative_to: str) -> None:
        """Add the frame of an element.

        Args:
            name: Its full name.
            element: The element, which may have a pose.
            relative_to: Name of the default reference frame of its pose.
        """
        pose, other = pose_of(element, f"{element.tag} {name}")
        self.frames.add(name, pose, self.full(other or relative_to))

    def pose_in(self, frame: str, element: etree._Element, owner: str) -> np.ndarray:
        """Return the pose of an element that is not a frame.

        Args:
            frame: Full name of the default reference frame of its pose.
            element: The element, which may have a pose.
            owner: Name of the element, for messages.

        Returns:
            Its pose in that frame, shape (7,).
        """
        pose, other = pose_of(element, owner)
        if not other:
            return pose
        return compose(self.frames.between(frame, self.full(other)), pose)
