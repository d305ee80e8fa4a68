"""Marks of checks in a scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.sim.marks.canvas import Color

from .robot import rgb

if TYPE_CHECKING:
    from viser import SceneApi, SceneNodeHandle


class SceneMarks:
    """A canvas whose marks stay until the next ones are drawn."""

    def __init__(self, scene: SceneApi, path: str) -> None:
        """Begin without marks.

        Args:
            scene: Where to draw.
            path: Name of all marks in the scene.
        """
        self._scene, self._path = scene, path
        self._shown: dict[str, tuple[bytes, SceneNodeHandle]] = {}
        self._wanted: dict[str, tuple[bytes, Callable[[str], SceneNodeHandle]]] = {}

    def show(self) -> None:
        """Show what was drawn since the last time, and nothing else."""
        wanted, self._wanted = self._wanted, {}
        for name in self._shown.keys() - wanted.keys():
            self._shown.pop(name)[1].remove()
        for name, (content, make) in wanted.items():
            if name not in self._shown or self._shown[name][0] != content:
                self._shown[name] = content, make(f"{self._path}/{name}")

    def _draw(
        self, namespace: str, make: Callable[[str], Any], *content: object
    ) -> None:
        """Keep a mark, and what it is made of."""
        number = sum(name.startswith(f"{namespace}/") for name in self._wanted)
        parts = [c.tobytes() if isinstance(c, np.ndarray) else c for c in content]
        self._wanted[f"{namespace}/{number}"] = repr(parts).encode(), make

    def ball(
        self,
        namespace: str,
        center: np.ndarray,
        size: float,
        color: Color,
        alpha: float = 1.0,
    ) -> None:
        """Add a ball with a diameter in [m] about a point, shape (3,)."""

        def make(name: str) -> SceneNodeHandle:
            return self._scene.add_icosphere(
                name,
                0.5 * size,
                rgb(color),
                opacity=alpha if alpha < 1.0 else None,
                position=center,
                cast_shadow=False,
            )

        self._draw(namespace, make, center, size, color, alpha)

    def disc(
        self, namespace: str, center: np.ndarray, size: float, color: Color
    ) -> None:
        """Add a flat disc on the floor, with a diameter in [m]."""

        def make(name: str) -> SceneNodeHandle:
            return self._scene.add_cylinder(
                name,
                0.5 * size,
                0.004,
                rgb(color),
                position=center,
                cast_shadow=False,
            )

        self._draw(namespace, make, center, size, color)

    def line(
        self, namespace: str, points: np.ndarray, width: float, color: Color
    ) -> None:
        """Add a line through points, shape (n, 3), of a width in [m]."""
        segments = np.stack([points[:-1], points[1:]], axis=1)

        def make(name: str) -> SceneNodeHandle:
            return self._scene.add_line_segments(
                name, segments, rgb(color), thickness=width
            )

        self._draw(namespace, make, segments, width, color)

    def triangles(
        self, namespace: str, corners: np.ndarray, color: Color, alpha: float
    ) -> None:
        """Add triangles with corners of shape (3 n, 3)."""

        def make(name: str) -> SceneNodeHandle:
            return self._scene.add_mesh_simple(
                name,
                corners,
                np.arange(len(corners)).reshape(-1, 3),
                color=rgb(color),
                opacity=alpha,
                side="double",
                cast_shadow=False,
            )

        self._draw(namespace, make, corners, color, alpha)

    def text(
        self, namespace: str, place: np.ndarray, text: str, size: float, color: Color
    ) -> None:
        """Add a text of a height in [m] that faces whoever looks."""

        def make(name: str) -> SceneNodeHandle:
            return self._scene.add_label(
                name,
                text,
                position=place,
                font_size_mode="scene",
                font_scene_height=size,
                anchor="center-center",
            )

        self._draw(namespace, make, place, text, size)
