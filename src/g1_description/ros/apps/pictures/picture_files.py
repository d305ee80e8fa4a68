"""Picture files: whole ones or none."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from g1_description.core.errors import InvalidValueError
from g1_description.core.files.atomic import write_whole

COLORS = 255
"""Colours of a film; one more stands for what has not changed."""

FILMS = (".gif", ".mp4")
"""What names of films end in."""

BLOCK = 4096
"""How many colours are looked up at a time, for the sake of memory."""


def check_place(path: Path, suffixes: Sequence[str]) -> None:
    """Check that a file can be written, before the work is done.

    Args:
        path: The file; one that is there will be replaced.
        suffixes: What its name may end in.

    Raises:
        InvalidValueError: If it cannot.
    """
    folder = path.parent
    if path.suffix.lower() not in suffixes:
        raise InvalidValueError(
            f"The file {path} does not end in {' or '.join(suffixes)}; a picture is "
            "written as .png, a film as .gif or .mp4."
        )
    if not folder.is_dir():
        raise InvalidValueError(f"There is no folder {folder} for {path.name}.")
    if path.is_dir() or not os.access(folder, os.W_OK):
        raise InvalidValueError(f"The file {path} cannot be written there.")


def write_picture(path: Path, picture: np.ndarray) -> None:
    """Write a picture.

    Args:
        path: The file.
        picture: Colours as uint8, shape (height, width, 3).

    Raises:
        InvalidValueError: If it cannot be written; what was there stays.
    """
    content = io.BytesIO()
    Image.fromarray(picture).save(content, "PNG", optimize=True)
    write_whole(path, content.getvalue())


def side_by_side(pictures: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """Join pictures of one size in rows.

    Args:
        pictures: As uint8, shape (height, width, 3) each.
        columns: How many stand in a row.

    Returns:
        The whole, white where there is no picture, shape (n_rows height, columns
        width, 3).
    """
    blank = np.full_like(pictures[0], 255)
    rows = [list(pictures[k : k + columns]) for k in range(0, len(pictures), columns)]
    rows[-1] += [blank] * (columns - len(rows[-1]))
    return np.concatenate([np.concatenate(row, axis=1) for row in rows])


def palette_of(pictures: Sequence[np.ndarray]) -> Image.Image:
    """Choose the colours of a film.

    Args:
        pictures: Some of it, as uint8, shape (height, width, 3) each.
    """
    together = Image.fromarray(np.concatenate(pictures))
    return together.quantize(COLORS, dither=Image.Dither.NONE)


def in_colors(picture: np.ndarray, palette: Image.Image) -> Image.Image:
    """Give each pixel the nearest colour of a film.

    Pillow's own way looks at the upper bits only, which tints light areas.

    Args:
        picture: As uint8, shape (height, width, 3).
        palette: An image that has the colours.
    """
    packed = picture.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    codes, places = np.unique(packed, return_inverse=True)
    blocks = np.array_split(codes, len(codes) // BLOCK + 1)
    nearest = np.concatenate([_nearest(block, palette) for block in blocks])
    image = Image.fromarray(nearest[places].reshape(picture.shape[:2]), "P")
    image.putpalette(palette.getpalette())
    return image


def _nearest(codes: np.ndarray, palette: Image.Image) -> np.ndarray:
    """Find colours, packed into integers, in a palette: indices, shape (n,)."""
    known = np.array(palette.getpalette()[: 3 * COLORS], dtype=int).reshape(-1, 3)
    wanted = codes[:, np.newaxis].astype(int) >> [16, 8, 0] & 255
    squares = ((wanted[:, np.newaxis] - known) ** 2).sum(axis=-1)
    return squares.argmin(axis=1).astype(np.uint8)


def write_film(path: Path, images: Sequence[Image.Image], rate: float) -> None:
    """Write a film that begins again at its end.

    A GIF counts in hundredths of a second, so its images are shown for times that
    add up to the right ones. An image equal to the last one prolongs that.

    Args:
        path: The file.
        images: All of one palette.
        rate: Images per second in [Hz].

    Raises:
        InvalidValueError: If it cannot be written; what was there stays.
    """
    ends = np.round(100.0 * np.arange(len(images) + 1) / rate)
    content = io.BytesIO()
    images[0].save(
        content,
        "GIF",
        save_all=True,
        append_images=images[1:],
        duration=(10.0 * np.diff(ends)).astype(int).tolist(),
        loop=0,
        optimize=False,
    )
    write_whole(path, content.getvalue())
