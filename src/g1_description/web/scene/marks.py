"""Marks of checks in a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.sim.marks.canvas import Color

from .robot import rgb

if TYPE_CHECKING:
    from viser import SceneApi, SceneNodeHandle


THICKNESS = 0.004
"""Of what lies on the floor, in [m]."""


@dataclass(frozen=True)
class _Mark:
    """A mark that is wanted."""

    kind: tuple[object, ...]
    """What it is; a node of the same kind is moved instead of made anew."""

    moving: dict[str, Any]
    """Properties of its node that change as the robot moves."""

    make: Callable[..., SceneNodeHandle]
    """Adds the node, given its name and these properties."""


class SceneMarks:
    """A canvas whose marks stay until the next ones are drawn."""

    def __init__(self, scene: SceneApi, path: str) -> None:
        """Begin without marks.

        Args:
            scene: Where to draw.
            path: Name of all marks in the scene.
        """
        self._scene, self._path = scene, path
        self._shown: dict[str, tuple[_Mark, SceneNodeHandle]] = {}
        self._wanted: dict[str, _Mark] = {}

    def show(self) -> None:
        """Show what was drawn since the last time, and nothing else."""
        wanted, self._wanted = self._wanted, {}
        for name in self._shown.keys() - wanted.keys():
            self._shown.pop(name)[1].remove()
        for name, mark in wanted.items():
            last, node = self._shown.get(name, (None, None))
            if last is None or node is None or last.kind != mark.kind:
                node = mark.make(f"{self._path}/{name}", **mark.moving)
            else:
                for key, value in mark.moving.items():
                    if not np.array_equal(value, last.moving[key]):
                        setattr(node, key, value)
            self._shown[name] = mark, node

    def _draw(
        self,
        namespace: str,
        make: Callable[..., Any],
        *kind: object,
        **moving: Any,
    ) -> None:
        """Keep a mark until it is shown."""
        number = sum(name.startswith(f"{namespace}/") for name in self._wanted)
        self._wanted[f"{namespace}/{number}"] = _Mark(kind, moving, make)

    def ball(
        self,
        namespace: str,
        center: np.ndarray,
        size: float,
        color: Color,
        alpha: float = 1.0,
    ) -> None:
        """Add a ball with a diameter in [m] about a point, shape (3,)."""
        make = partial(
            self._scene.add_icosphere,
            radius=0.5 * size,
            color=rgb(color),
            opacity=alpha if alpha < 1.0 else None,
            cast_shadow=False,
        )
        self._draw(namespace, make, "ball", size, color, alpha, position=center)

    def disc(
        self, namespace: str, center: np.ndarray, size: float, color: Color
    ) -> None:
        """Add a flat disc on the floor, with a diameter in [m]."""
        make = partial(
            self._scene.add_cylinder,
            radius=0.5 * size,
            height=THICKNESS,
            color=rgb(color),
            cast_shadow=False,
        )
        self._draw(namespace, make, "disc", size, color, position=center)

    def line(
        self, namespace: str, points: np.ndarray, width: float, color: Color
    ) -> None:
        """Add a line through points, shape (n, 3), of a width in [m]."""
        segments = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
        make = partial(
            self._scene.add_line_segments, colors=rgb(color), thickness=width
        )
        kind = "line", len(points), width, color
        self._draw(namespace, make, *kind, points=segments)

    def triangles(
        self, namespace: str, corners: np.ndarray, color: Color, alpha: float
    ) -> None:
        """Add triangles with corners of shape (3 n, 3)."""
        make = partial(
            self._scene.add_mesh_simple,
            faces=np.arange(len(corners)).reshape(-1, 3),
            color=rgb(color),
            opacity=alpha,
            side="double",
            cast_shadow=False,
        )
        kind = "triangles", len(corners), color, alpha
        self._draw(namespace, make, *kind, vertices=corners.astype(np.float32))

    def text(
        self, namespace: str, place: np.ndarray, text: str, size: float, color: Color
    ) -> None:
        """Add a text of a height in [m] that faces whoever looks."""
        make = partial(
            self._scene.add_label,
            font_size_mode="scene",
            font_scene_height=size,
            anchor="center-center",
        )
        self._draw(namespace, make, "text", size, text=text, position=place)
