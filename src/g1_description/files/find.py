"""Finding the file of a model, with suggestions if there is none."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from urllib.parse import unquote

from g1_description.errors import DescriptionError
from g1_description.files.model_files import find_folder, packages
from g1_description.text import did_you_mean

_ARGUMENT = re.compile(r"\s+(?=[A-Za-z_]\w*:?=)")


def split_arguments(requested: str) -> tuple[str, dict[str, str]]:
    """Split a model into its file and the arguments for xacro.

    Args:
        requested: File, then any number of ``NAME=VALUE`` or ``NAME:=VALUE``. The name
            of an existing file is not split.

    Returns:
        The file as given, and the arguments.
    """
    if _exists(Path(os.path.expanduser(requested))):
        return requested, {}
    file, *given = _ARGUMENT.split(requested.strip())
    pairs = (re.split(":?=", word, maxsplit=1) for word in given)
    return file, {name: value.strip() for name, value in pairs}


def find_model_file(name: str) -> Path:
    """Find the file of a model.

    Args:
        name: Path, absolute or from the working directory, ``~`` for the home;
            ``file:///PATH``; or ``package://PACKAGE/PATH``.

    Returns:
        Path of an existing regular file.

    Raises:
        DescriptionError: If there is none; the message suggests similar names.
    """
    path = named_path(name)
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError) as error:
        raise DescriptionError(_absent(path)) from error
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise DescriptionError(f"{path} cannot be read: {why}.") from error
    if stat.S_ISDIR(mode):
        raise DescriptionError(f"{path} is a folder{with_robots(path)}.")
    if not stat.S_ISREG(mode):
        raise DescriptionError(f"{path} is not a regular file.")
    return path


def _exists(path: Path) -> bool:
    """Return whether a path exists and can be accessed."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def named_path(name: str) -> Path:
    """Convert a user's name of a file to a path, which need not exist.

    Raises:
        DescriptionError: If the package or scheme is unknown.
    """
    scheme, separator, rest = name.partition("://")
    if not separator:
        return Path(os.path.expanduser(name))
    if scheme == "file":
        return Path(unquote(rest))
    if scheme != "package":
        raise DescriptionError(
            f"{name} has the unknown scheme {scheme}://; use a path, package:// or "
            "file://."
        )
    package, _, inside = rest.partition("/")
    folder = find_folder(package)
    if folder is None:
        near = did_you_mean(package, packages())
        raise DescriptionError(f"There is no package '{package}'{near}.")
    return Path(folder) / unquote(inside)


def _absent(path: Path) -> str:
    """Return a message on a missing file, with suggestions."""
    missing = path
    while not missing.parent.is_dir() and missing.parent != missing:
        missing = missing.parent
    kind = "file" if missing == path else "folder"
    others = [missing.parent / name for name in _names_in(missing.parent)]
    if kind == "folder":
        known = {other.name: other.name for other in others if other.is_dir()}
        near = did_you_mean(missing.name, known)
    else:  # endings alone make no names similar
        known = {o.stem: o.name for o in others if path.suffix in ("", o.suffix)}
        near = did_you_mean(path.stem, known, known)
    return f"There is no {kind} {missing}{near}."


def _names_in(folder: Path) -> list[str]:
    """List a folder; empty if it cannot be read."""
    try:
        return sorted(os.listdir(folder))
    except OSError:
        return []


def with_robots(folder: Path) -> str:
    """List the robots in a folder or its folder urdf, as the end of a message."""
    for place in ("", "urdf"):
        names = [
            os.path.join(place, name)
            for suffix in (".urdf", ".xacro")
            for name in _names_in(folder / place)
            if name.endswith(suffix)
        ]
        if names:
            more = f" and {len(names) - 3} more" if len(names) > 3 else ""
            return f"; it contains {', '.join(names[:3])}{more}"
    return ""
