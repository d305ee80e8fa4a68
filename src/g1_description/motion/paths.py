"""Paths of motions: a file or folder, or ``FILE#NAME`` for one of several in a file.

Those of this package also have a bare name, such as ``squat.csv``.
"""

from __future__ import annotations

import re
from os import PathLike, fspath
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


def motion_path(name: str | PathLike[str]) -> Path:
    """Convert a user's name of a motion to a path, which need not exist.

    Args:
        name: A path, ``~`` for the home; ``package://PACKAGE/PATH`` or ``file://``; or
            the name of a motion of this package, if there is no such file.

    Raises:
        DescriptionError: If the package or scheme is unknown.
    """
    # Only where it is needed: doctor must run without what finds packages.
    from g1_description.files.find import named_path
    from g1_description.files.model_files import share_folder

    path = named_path(fspath(name))
    packaged = share_folder() / "motions" / path
    is_bare = len(path.parts) == 1 and not split(path)[0].exists()
    return packaged if is_bare and packaged.is_file() else path
