"""What a simulator builds: bodies, the joints between them, and where they begin."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from .description import Description, Link
from .transform import IDENTITY

SCOPE = "::"
"""What stands between a model's name and a link's or joint's."""

WORLD = "world"
"""A root link of this name is the world itself: it is no body and does not move."""


@dataclass(frozen=True)
class Assembly:
    """A model as Gazebo would simulate it, whether it came as URDF or as SDF."""

    description: Description
    """Bodies with mass and the joints between them, fixed ones only where they are
    kept; its root may be ``WORLD``."""

    root_pose: np.ndarray = field(default_factory=lambda: np.array(IDENTITY))
    """Pose of the root link in the model frame, shape (7,)."""

    positions: dict[str, float] = field(default_factory=dict)
    """Where joints begin, in [rad] or [m] by name, inside their limits; the others
    begin at zero."""

    canonical: str = ""
    """Link whose pose and twist are the model's; empty: the root, wherever it is."""

    static: bool = False
    """Whether it never moves by itself, nor its joints."""

    frames: dict[str, tuple[str, np.ndarray]] = field(default_factory=dict)
    """Where links are lumped: each link of the file that is there or became part of
    another, with the body that holds it and its pose in that body, shape (7,)."""

    left_out: tuple[str, ...] = ()
    """A clause for each thing in the file that is not simulated."""

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the bodies, in the order of the file."""
        names = self.description.link_names
        if self.description.root != WORLD:
            return names
        return tuple(name for name in names if name != WORLD)

    def with_link(self, link: Link) -> Assembly:
        """Give the same with one link in the place of that of its name."""
        links = tuple(
            link if old.name == link.name else old for old in self.description.links
        )
        return replace(self, description=replace(self.description, links=links))
