"""Folders of packages and models on this machine."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from urllib.parse import unquote

from lxml import etree

from g1_description.errors import DescriptionError, NoSuchModelError
from g1_description.files.xml import check_size, decoded, parse_xml

NEWEST = (1, 9)
"""The latest supported version of SDF."""


PACKAGE = "g1_description"

SETTINGS = "config/checks.yaml"
"""A file by which its share folder is found."""


@lru_cache(maxsize=None)
def share_folder() -> Path:
    """Find the folder that holds ``config``, ``meshes``, ``motions`` and ``urdf``.

    Raises:
        DescriptionError: If there is none, as when only the code was copied.
    """
    own = Path(__file__).resolve().parents[1]
    for above in (own, *own.parents):  # a wheel has them inside the package
        for folder in (above, above / "share" / PACKAGE):
            if (folder / SETTINGS).is_file():
                return folder
    raise DescriptionError(
        f"The data files of {PACKAGE} are missing: neither {own} nor a folder above it "
        f"has {SETTINGS} or share/{PACKAGE}/{SETTINGS}."
    )


MODEL_PATH = "GAZEBO_MODEL_PATH"
"""Environment variable with the folders of models."""

RESOURCE_PATH = "GAZEBO_RESOURCE_PATH"
"""Environment variable with the folders of worlds and media."""


def listed_folders(variable: str) -> list[str]:
    """Split an environment variable into folders."""
    return [*filter(None, os.environ.get(variable, "").split(os.pathsep))]


@lru_cache(maxsize=None)
def packages() -> dict[str, str]:
    """Return the folders of packages by name; cached, as rospkg searches all folders.

    ROS' folder of this package takes precedence: RViz and others use it.
    """
    own = {PACKAGE: str(share_folder())}
    try:
        import rospkg  # slow, and only meshes need it
    except ImportError:  # without ROS, this is the only package
        return own
    ros = rospkg.RosPack()
    return {**own, **{name: ros.get_path(name) for name in ros.list()}}


def _exported_folders(attribute: str) -> Iterator[str]:
    """List the folders that ROS packages export to gazebo_ros.

    Args:
        attribute: One of ``<export><gazebo_ros .../></export>`` in a ``package.xml``:
            folders separated by colons; ``${prefix}`` is that of the package.
    """
    for own in packages().values():
        for element in _exports_to_gazebo(Path(own, "package.xml")):
            folders = element.get(attribute, "").replace("${prefix}", own)
            yield from filter(None, folders.split(os.pathsep))


@lru_cache(maxsize=None)
def _exports_to_gazebo(manifest: Path) -> list[etree._Element]:
    """Read a package's exports to gazebo_ros; empty if it cannot be read."""
    try:
        root = parse_xml("package", decoded(manifest.read_bytes(), "replace"))
    except (OSError, DescriptionError):
        return []
    return root.findall("export/gazebo_ros")


def model_folders() -> Iterator[str]:
    """List the folders of models, in search order."""
    yield from listed_folders(MODEL_PATH)
    yield from _exported_folders("gazebo_model_path")
    yield str(Path.home() / ".gazebo" / "models")


def resource_folders() -> Iterator[str]:
    """List the folders of worlds and media, in search order."""
    yield from listed_folders(RESOURCE_PATH)
    yield from _exported_folders("gazebo_media_path")


def find_folder(name: str) -> str | None:
    """Find the folder of ``package://NAME`` or ``model://NAME``.

    Packages are this one and those of ROS. Models are searched as by Gazebo: in
    GAZEBO_MODEL_PATH, folders exported by packages, and ``~/.gazebo/models``.

    Args:
        name: The package or model.

    Returns:
        Its folder, or None.
    """
    if name in packages():
        return packages()[name]
    for place in model_folders():
        if Path(place, name).is_dir() and os.sep not in name and name != "..":
            return os.path.join(place, name)
    return None


def ros_home() -> Path:
    """Return the folder of the user's files, which need not exist."""
    return Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")


def searched_folders() -> str:
    """Describe where models are searched."""
    return (
        f"{MODEL_PATH} ({os.environ.get(MODEL_PATH) or 'empty'}), ~/.gazebo/models and "
        "the folders that packages export"
    )


def find_model(uri: str) -> str:
    """Read the SDF file of a model.

    Args:
        uri: URI of an include element: ``model://NAME``, ``file://FOLDER`` or the path
            of a folder, each optionally with a file in it.

    Returns:
        The text of the file named in its ``model.config``, or else of its
        ``model.sdf``.

    Raises:
        NoSuchModelError: If there is none.
        DescriptionError: If ``model.config`` is invalid or its file is missing.
    """
    place = _model_place(uri)
    try:
        file = _model_file(place) if place.is_dir() else place
        if not file.is_file():
            raise NoSuchModelError(f"There is no file {file}.")
        check_size(str(file), file.stat().st_size)
        return decoded(file.read_bytes(), "replace")
    except OSError as error:
        raise DescriptionError(f"{place} cannot be read: {error.strerror}.") from error


def _model_place(uri: str) -> Path:
    """Find the folder or file of an include's URI."""
    scheme, separator, name = uri.partition("://")
    if not separator:
        scheme, name = "file", uri
    if scheme in ("model", "package"):
        name, _, inside = name.partition("/")
        folder = find_folder(name) if name else None
        if folder is None:
            raise NoSuchModelError(
                f"There is no package '{name}', and no folder '{name}' below "
                f"{searched_folders()}."
            )
        return Path(folder, unquote(inside))
    if scheme == "file" and os.path.isabs(name):
        return Path(unquote(name))
    raise NoSuchModelError(
        "A model must be given as model://NAME, file://FOLDER or an absolute path."
    )


def _model_file(folder: Path) -> Path:
    """Find the SDF file in a model's folder, which need not exist.

    From ``model.config``: the file with the highest supported version, else the first.
    """
    config = folder / "model.config"
    if not config.is_file():
        return folder / "model.sdf"
    text = decoded(config.read_bytes(), "replace")
    files = parse_xml(f"file {config}", text).findall("sdf")
    best, known = None, (0, 0)
    for element in files:
        version = version_number(element.get("version", "")) or (0, 0)
        if best is None or known < version <= NEWEST:
            best = element
            known = version if version <= NEWEST else known
    name = "" if best is None else (best.text or "").strip()
    file = folder / (name or ".")
    if not file.is_file():
        fault = f"names {name}, which is not a file" if name else "names no SDF file"
        raise DescriptionError(f"{config} {fault}.")
    return file


def version_number(version: str) -> tuple[int, int] | None:
    """Read a version of SDF such as 1.10; None if invalid."""
    found = re.fullmatch(r"(\d{1,9})\.(\d{1,9})", version.strip(), re.ASCII)
    return (int(found[1]), int(found[2])) if found else None
