"""What draws marks: markers for RViz, or the scene of a browser."""

from __future__ import annotations

from typing import Protocol, Tuple

import numpy as np

Color = Tuple[float, float, float]
"""Red, green, blue, from 0 to 1."""

RED, ORANGE, GREEN = (0.85, 0.05, 0.05), (0.95, 0.5, 0.0), (0.1, 0.6, 0.2)


class Canvas(Protocol):
    """Takes one mark after the other; a namespace can be switched on and off."""

    def ball(
        self,
        namespace: str,
        center: np.ndarray,
        size: float,
        color: Color,
        alpha: float = 1.0,
    ) -> None:
        """Add a ball with a diameter in [m] about a point, shape (3,)."""

    def disc(
        self, namespace: str, center: np.ndarray, size: float, color: Color
    ) -> None:
        """Add a flat disc on the floor, with a diameter in [m]."""

    def line(
        self, namespace: str, points: np.ndarray, width: float, color: Color
    ) -> None:
        """Add a line through points, shape (n, 3), of a width in [m]."""

    def triangles(
        self, namespace: str, corners: np.ndarray, color: Color, alpha: float
    ) -> None:
        """Add triangles with corners of shape (3 n, 3)."""

    def text(
        self, namespace: str, place: np.ndarray, text: str, size: float, color: Color
    ) -> None:
        """Add a text of a height in [m] that faces whoever looks."""
