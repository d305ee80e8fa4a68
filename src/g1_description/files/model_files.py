"""Where packages and models lie on this machine."""

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
"""The latest version of SDF whose meaning is known."""


PACKAGE = "g1_description"

ROBOT = "urdf/g1_29dof.urdf"
"""The robot of this package, in the folder that is looked for."""


@lru_cache(maxsize=None)
def share_folder() -> Path:
    """Find the folder that holds ``config``, ``meshes`` and ``urdf``.

    Raises:
        DescriptionError: If there is none: somebody copied the code alone.
    """
    own = Path(__file__).resolve().parents[1]
    for above in own.parents:
        for folder in (above, above / "share" / PACKAGE):
            if (folder / ROBOT).is_file():
                return folder
    raise DescriptionError(
        f"{own} lacks the robot and the files of {PACKAGE}: no folder above it has "
        f"share/{PACKAGE}/{ROBOT}."
    )


try:
    import rospkg
except ImportError:  # without ROS there are no other packages than this one
    rospkg = None


MODEL_PATH = "GAZEBO_MODEL_PATH"
"""Environment variable with the folders that models lie in."""

RESOURCE_PATH = "GAZEBO_RESOURCE_PATH"
"""Environment variable with the folders that worlds and media lie in."""


def listed_folders(variable: str) -> list[str]:
    """Give the folders that an environment variable lists."""
    return [*filter(None, os.environ.get(variable, "").split(os.pathsep))]


@lru_cache(maxsize=None)
def _packages() -> dict[str, str]:
    """Give the folders of packages by name; listing them walks through all folders.

    The one that ROS has of this package is what RViz and others see.
    """
    own = {PACKAGE: str(share_folder())}
    if rospkg is None:
        return own
    ros = rospkg.RosPack()
    return {**own, **{name: ros.get_path(name) for name in ros.list()}}


def package_names() -> list[str]:
    """List the packages."""
    return list(_packages())


def _exported_folders(attribute: str) -> Iterator[str]:
    """List the folders that ROS packages export to gazebo_ros.

    Args:
        attribute: Of ``<export><gazebo_ros .../></export>`` in a ``package.xml``:
            folders with colons between them; ``${prefix}`` is the package's own.
    """
    for own in _packages().values():
        for element in _exports_to_gazebo(Path(own, "package.xml")):
            folders = element.get(attribute, "").replace("${prefix}", own)
            yield from filter(None, folders.split(os.pathsep))


@lru_cache(maxsize=None)
def _exports_to_gazebo(manifest: Path) -> list[etree._Element]:
    """Read what a package exports to gazebo_ros; nothing where it cannot be read."""
    try:
        root = parse_xml("package", decoded(manifest.read_bytes(), "replace"))
    except (OSError, DescriptionError):
        return []
    return root.findall("export/gazebo_ros")


def model_folders() -> Iterator[str]:
    """List the folders that models lie in, in the order they are searched."""
    yield from listed_folders(MODEL_PATH)
    yield from _exported_folders("gazebo_model_path")
    yield str(Path.home() / ".gazebo" / "models")


def resource_folders() -> Iterator[str]:
    """List the folders that worlds and media lie in, in the order they are searched."""
    yield from listed_folders(RESOURCE_PATH)
    yield from _exported_folders("gazebo_media_path")


def find_folder(name: str) -> str | None:
    """Find the folder of ``package://NAME`` or ``model://NAME``.

    Packages are this one and those of ROS. Models lie in the folders of
    GAZEBO_MODEL_PATH, in those that packages export, and in ``~/.gazebo/models``, as
    for Gazebo.

    Args:
        name: The package or model.

    Returns:
        Its folder, or None where there is none.
    """
    if name in _packages():
        return _packages()[name]
    for place in model_folders():
        if Path(place, name).is_dir() and os.sep not in name and name != "..":
            return os.path.join(place, name)
    return None


def ros_home() -> Path:
    """Give the folder of the user's own files, which need not exist."""
    return Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")


def searched_folders() -> str:
    """Say where models are searched."""
    return (
        f"{MODEL_PATH} ({os.environ.get(MODEL_PATH) or 'empty'}), ~/.gazebo/models and "
        "the folders that packages export"
    )


def find_model(uri: str) -> str:
    """Read the SDF file of a model.

    Args:
        uri: As written in an include element: ``model://NAME``, ``file://FOLDER`` or
            the path of a folder; or one of these with a file in the folder.

    Returns:
        The text of the file that its ``model.config`` names, without that of its
        ``model.sdf``.

    Raises:
        NoSuchModelError: If there is none.
        DescriptionError: If ``model.config`` is wrong, or names what is no file.
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
    """Find the folder or file that the URI of an include means."""
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
        "Models are found by model://NAME, file://FOLDER and a folder's absolute path."
    )


def _model_file(folder: Path) -> Path:
    """Find the SDF file of a model's folder, which need not be there.

    Of those in ``model.config`` it is the one of the highest version that is known,
    else the first.
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
        what = f"names {name}, which is no file" if name else "names no SDF file"
        raise DescriptionError(f"{config} {what}.")
    return file


def version_number(version: str) -> tuple[int, int] | None:
    """Read a version of SDF such as 1.10; None where it is none."""
    found = re.fullmatch(r"(\d{1,9})\.(\d{1,9})", version.strip(), re.ASCII)
    return (int(found[1]), int(found[2])) if found else None
