"""Marks of checks in a scene."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Callable

import numpy as np

from g1_description.checks.marks import Color
from g1_description.web.scene.robot import rgb

if TYPE_CHECKING:
    from viser import SceneApi, SceneNodeHandle


Add = Callable[..., Any]
"""Adds a mark of a kind to a scene, given its name and what may change of it."""


class SceneMarks:
    """A canvas whose marks stay until the next ones are drawn.

    Changing a mark is ten times cheaper than creating one, so marks are reused.
    Browsers apply positions before shapes, so lines and triangles are centred at their
    position.
    """

    def __init__(self, scene: SceneApi, path: str) -> None:
        """Begin without marks.

        Args:
            scene: Where to draw.
            path: Name of all marks in the scene.
        """
        self._scene, self._path = scene, path
        self._shown: dict[str, tuple[SceneNodeHandle, dict[str, Any]]] = {}
        self._drawn: dict[str, tuple[Add, dict[str, Any]]] = {}

    def show(self) -> None:
        """Replace the marks by those drawn since the last call."""
        drawn, self._drawn = self._drawn, {}
        for name in self._shown.keys() - drawn.keys():
            self._shown.pop(name)[0].remove()
        for name, (add, values) in drawn.items():
            if name in self._shown:
                handle, old = self._shown[name]
                for key, value in values.items():
                    if not np.array_equal(value, old[key]):
                        setattr(handle, key, value)
            else:
                handle = add(f"{self._path}/{name}", **values)
            self._shown[name] = handle, values

    def _draw(self, namespace: str, kind: str, add: Add, **values: Any) -> None:
        """Keep a mark, and what it is made of."""
        path = f"{namespace}/{kind}_"
        number = sum(name.startswith(path) for name in self._drawn)
        self._drawn[f"{path}{number}"] = add, values

    def ball(
        self,
        namespace: str,
        center: np.ndarray,
        size: float,
        color: Color,
        alpha: float = 1.0,
    ) -> None:
        """Add a ball with a diameter in [m] about a point, shape (3,)."""
        self._draw(
            namespace,
            "ball",
            partial(self._scene.add_icosphere, cast_shadow=False),
            radius=0.5 * size,
            color=rgb(color),
            opacity=alpha if alpha < 1.0 else None,
            position=center,
        )

    def disc(
        self, namespace: str, center: np.ndarray, size: float, color: Color
    ) -> None:
        """Add a flat disc on the floor, with a diameter in [m]."""
        self._draw(
            namespace,
            "disc",
            partial(self._scene.add_cylinder, height=0.004, cast_shadow=False),
            radius=0.5 * size,
            color=rgb(color),
            position=center,
        )

    def line(
        self, namespace: str, points: np.ndarray, width: float, color: Color
    ) -> None:
        """Add a line through points, shape (n, 3), of a width in [m]."""
        middle = points.mean(axis=0)
        self._draw(
            namespace,
            "line",
            self._scene.add_line_segments,
            points=np.round(np.stack([points[:-1], points[1:]], axis=1) - middle, 5),
            position=middle,
            colors=np.array(rgb(color), dtype=np.uint8),
            thickness=width,
        )

    def triangles(
        self, namespace: str, corners: np.ndarray, color: Color, alpha: float
    ) -> None:
        """Add triangles with corners of shape (3 n, 3)."""
        middle = corners.mean(axis=0)
        self._draw(
            namespace,
            f"triangles_{len(corners)}",  # viser wants as many as before
            partial(
                self._scene.add_mesh_simple,
                faces=np.arange(len(corners)).reshape(-1, 3),
                side="double",
                cast_shadow=False,
            ),
            vertices=np.round(corners - middle, 5),
            position=middle,
            color=rgb(color),
            opacity=alpha if alpha < 1.0 else None,
        )

    def text(
        self, namespace: str, place: np.ndarray, text: str, size: float, color: Color
    ) -> None:
        """Add a text of a height in [m] that faces whoever looks."""
        self._draw(
            namespace,
            "text",
            partial(
                self._scene.add_label,
                font_size_mode="scene",
                font_scene_height=size,
                anchor="center-center",
            ),
            text=text,
            position=place,
        )
