"""Pictures as text for a terminal with 24-bit colours."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from PIL import Image

HALF, RESET, GAP = "\u2580", "\x1b[0m", "  "
"""The upper half of a character, in its foreground colour: two pixels per character."""


def beside(pictures: Sequence[bytes], columns: int) -> str:
    """Write pictures beside each other.

    Args:
        pictures: PNG files of the same size.
        columns: Width of each, in characters.
    """
    drawn = [_lines(png, columns) for png in pictures]
    return "\n".join(GAP.join(("", *parts)) for parts in zip(*drawn))


def _lines(png: bytes, columns: int) -> list[str]:
    """Write a picture as lines."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    rows = round(columns * picture.height / picture.width / 2.0)
    pixels = np.asarray(picture.resize((columns, 2 * rows), Image.Resampling.LANCZOS))
    return [
        "".join(
            f"\x1b[38;2;{_color(above)};48;2;{_color(below)}m{HALF}"
            for above, below in zip(*pixels[row : row + 2])
        )
        + RESET
        for row in range(0, 2 * rows, 2)
    ]


def _color(pixel: np.ndarray) -> str:
    """Write a colour for an escape sequence."""
    return ";".join(map(str, pixel.tolist()))
