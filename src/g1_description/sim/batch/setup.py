"""What judging motions needs to know, in a form that other processes can be sent."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from g1_description.core.checks.thresholds import Thresholds, read_thresholds
from g1_description.core.motion.motors import Motors


@dataclass(frozen=True, eq=False)
class Setup:
    """A robot, and how its motions are judged."""

    urdf: str
    """Text of its description, with absolute names of its meshes."""

    thresholds: Thresholds = field(default_factory=read_thresholds)

    only: tuple[str, ...] = ()
    """Names of the checks to make; none: all."""

    pairs: Path | None = None
    """File of the pairs of links that may touch; None: that of the package."""

    visual_hulls: bool = True
    """Whether links without collision shapes have the hulls of their visual ones."""

    fixed_base: bool = False
    """Whether something holds the base."""

    physics: bool = False
    """Whether motions are played in physics, too."""

    motors: Motors | None = None
    """What drives the joints in physics."""

    plot: bool = False
    """Whether a picture of each motion is drawn."""

    rate: float | None = None
    """Samples per second of files without times."""

    topic: str | None = None
    """Topic of bags with the joints."""
