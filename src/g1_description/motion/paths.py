"""Paths of motions: a file or folder, or ``FILE#NAME`` for one of several in a file."""

from __future__ import annotations

import re
from pathlib import Path


def split(path: Path) -> tuple[Path, str | None]:
    """Split ``FILE#NAME``, which names one of the motions in a file.

    Returns:
        The path, and the name; None: the path is a whole file.
    """
    text = str(path)
    for found in re.finditer("#", text):
        file = Path(text[: found.start()])
        if not path.exists() and file.exists():
            return file, text[found.end() :]
    return path, None
