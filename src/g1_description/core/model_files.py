"""Where packages and models lie on this machine."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

import rospkg

MODEL_PATH = "GAZEBO_MODEL_PATH"
"""Environment variable with the folders that models lie in."""


def listed_folders(variable: str) -> list[str]:
    """Give the folders that an environment variable lists."""
    return [*filter(None, os.environ.get(variable, "").split(os.pathsep))]


@lru_cache(maxsize=None)
def _packages() -> rospkg.RosPack:
    """Keep one list of packages: making it walks through all folders."""
    return rospkg.RosPack()


def package_names() -> list[str]:
    """List the ROS packages."""
    return list(_packages().list())


def find_folder(name: str) -> str | None:
    """Find the folder of ``package://NAME`` or ``model://NAME``.

    Packages are ROS packages; models lie in the folders of GAZEBO_MODEL_PATH and in
    ``~/.gazebo/models``, as for Gazebo.

    Args:
        name: The package or model.

    Returns:
        Its folder, or None where there is none.
    """
    try:
        return _packages().get_path(name)
    except rospkg.ResourceNotFound:
        pass
    own = Path.home() / ".gazebo" / "models"
    for place in (*map(Path, listed_folders(MODEL_PATH)), own):
        if (place / name).is_dir() and os.sep not in name and name != "..":
            return str(place / name)
    return None


def find_model(uri: str) -> str | None:
    """Read the SDF file behind ``model://NAME``.

    Args:
        uri: As written in an include element.

    Returns:
        The text of its ``model.sdf``, or None where there is none.
    """
    scheme, _, name = uri.partition("://")
    folder = find_folder(name.strip("/")) if scheme == "model" else None
    file = Path(folder or os.devnull) / "model.sdf"
    return (
        file.read_text(encoding="utf-8", errors="replace") if file.is_file() else None
    )
