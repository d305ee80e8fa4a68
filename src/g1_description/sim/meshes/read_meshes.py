"""A program that reads meshes, so that a hostile one ends it and not the simulator.

Its arguments are a folder, the most seconds of the processor and of the clock that a
file may take, and files. In the folder it writes for the n-th file ``n.npz``, or
``n.txt`` with the reason why not. It dies of the first file that takes too long;
whoever started it goes on with the next.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import warnings
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.sim.meshes.assimp import (
    TRIANGULATE,
    Assimp,
    CannotReadError,
    RawPart,
)
from g1_description.sim.meshes.stl import (
    HEAD,
    binary_size,
    triangle_count,
    triangle_normals,
)

BEGUN, LAST_WORDS = "begun", "last_words"
"""Files that tell that it began to read, and of what mistake of its own it ended."""

MEMORY = 4 * 2**30
"""Most memory that it may take, in bytes."""

MAX_TRIANGLES = 3_000_000

LEAST_NORMAL = 0.001
"""Square of the length that a normal has at least, if it has a direction."""


def main() -> None:
    """Read all files."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    folder, limits, files = Path(sys.argv[1]), sys.argv[2:4], sys.argv[4:]
    (folder / BEGUN).touch()
    try:
        for number, file in enumerate(files):
            for timer, limit in zip((signal.ITIMER_PROF, signal.ITIMER_REAL), limits):
                signal.setitimer(timer, float(limit))
            _read_to(folder, number, Path(file))
    except Exception as error:  # raised again; the parent learns of any mistake
        words = f"{type(error).__name__}: {error}"
        (folder / LAST_WORDS).write_text(words, encoding="utf-8")
        raise


def _read_to(folder: Path, number: int, file: Path) -> None:
    """Read a mesh, and write what is in it."""
    try:
        arrays = read(file)
    except (CannotReadError, MemoryError) as error:
        full = f"it takes more than {MEMORY // 2**30} GiB of memory"
        why_not = full if isinstance(error, MemoryError) else str(error)
        (folder / f"{number}.txt").write_text(why_not, encoding="utf-8")
        return
    # A file that is there is whole.
    np.savez(folder / "unfinished.npz", **arrays)
    (folder / "unfinished.npz").rename(folder / f"{number}.npz")


def read(path: Path) -> dict[str, np.ndarray]:
    """Read a mesh.

    Args:
        path: Its file.

    Returns:
        Of all parts, one after the other: ``corners`` and ``normals``, shape
        (n, 3, 3); of each part: ``counts`` of its triangles, shape (m,), and
        ``colors``, shape (m, 4), NaN where it has none.

    Raises:
        CannotReadError: If it cannot be read.
        MemoryError: If it takes too much memory.
    """
    # Before the library: version 5.0 aborts at a binary STL that ends too early.
    fault = _stl_fault(path, is_surely_binary=True)
    if fault:
        raise CannotReadError(fault)
    library = Assimp()
    try:
        parts = [part for part in library.read(path) if len(part.corners)]
    except CannotReadError as error:
        raise CannotReadError(_fault(library, path) or str(error)) from error
    counts = [len(part.corners) for part in parts]
    if not parts:
        raise CannotReadError("it has no triangles")
    if sum(counts) > MAX_TRIANGLES:
        raise CannotReadError(
            f"it has {sum(counts)} triangles; there is room for {MAX_TRIANGLES}"
        )
    corners = np.concatenate([part.corners for part in parts])
    if not (np.abs(corners) <= MAX_VALUE).all():
        raise CannotReadError("it has corners that are nowhere")
    return {
        "corners": corners,
        "normals": _normals(corners, np.concatenate([p.normals for p in parts])),
        "counts": np.array(counts),
        "colors": np.array([_color(part, path.parent) for part in parts]),
    }


def _fault(library: Assimp, path: Path) -> str:
    """Say what is wrong with a refused file where the library's message says less.

    It takes out what has corners that are no numbers, and then reports that
    nothing is left.
    """
    fault = _stl_fault(path)
    if fault:
        return fault
    try:
        parts = library.read(path, TRIANGULATE)
    except CannotReadError:
        return ""
    if not sum(len(part.corners) for part in parts):
        return "it has no triangles"
    sound = all(np.isfinite(part.corners).all() for part in parts)
    return "" if sound else "it has corners that are no numbers"


def _stl_fault(path: Path, is_surely_binary: bool = False) -> str:
    """Say why a file is neither kind of STL; empty if that is not what is wrong.

    Args:
        path: The file; one of another format has no such fault.
        is_surely_binary: Whether to judge only what no reader takes for text.
    """
    if path.suffix.lower() != ".stl":
        return ""
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
            size = file.seek(0, os.SEEK_END)
    except OSError:
        return ""
    needed = binary_size(head)
    # The number of triangles has a zero byte, which text has not.
    is_text = b"\0" not in head and (
        is_surely_binary or head.lstrip().startswith(b"solid")
    )
    if not size or size == needed or is_text:
        return ""
    return (
        'it is no text that begins with "solid" in small letters, and its '
        f"{size} bytes are not the {needed} of {triangle_count(head)} triangles"
    )


def has_direction(normals: np.ndarray) -> np.ndarray:
    """Return which normals, shape (..., 3), are long enough to have a direction."""
    with np.errstate(all="ignore"):
        squares = (normals.astype(float) ** 2).sum(axis=-1)
        return (squares >= LEAST_NORMAL) & (squares < np.inf)


def _normals(corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Put that of the triangle in the place of each normal without a direction.

    Args:
        corners: Of triangles, shape (n, 3, 3).
        normals: At the corners, shape (n, 3, 3).
    """
    own = triangle_normals(corners)[:, np.newaxis]
    valid = has_direction(normals)[..., np.newaxis]
    return np.where(valid, normals, own).astype(normals.dtype)


def _color(part: RawPart, folder: Path) -> tuple[float, ...]:
    """Give the colour of a part, shape (4,); of a picture the mean."""
    if part.color is None:
        return (np.nan,) * 4
    names = filter(None, (part.texture, unquote(part.texture)))
    # A name may be too long for a file: then a path's own is_file() raises.
    pictures = [folder / name for name in names if os.path.isfile(folder / name)]
    mean = _mean_color(pictures[0]) if pictures else None
    return (*(mean or part.color[:3]), part.color[3])


def _mean_color(picture: Path) -> tuple[float, ...] | None:
    """Give the mean colour of a picture, from 0 to 1; None if it cannot be read."""
    from PIL import Image

    try:
        with warnings.catch_warnings(), Image.open(picture) as image:
            warnings.simplefilter("error")  # of one that is larger than memory
            small = image.convert("RGB").resize((1, 1), Image.Resampling.BOX)
            return tuple(value / 255.0 for value in small.getpixel((0, 0)))
    except Exception:  # what Pillow raises depends on the format
        return None


if __name__ == "__main__":
    main()
