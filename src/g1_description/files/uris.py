"""Resolving the file names in a URDF."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from itertools import count
from pathlib import Path
from urllib.parse import quote, unquote

from lxml import etree

from g1_description.errors import DescriptionError
from g1_description.files.model_files import resource_folders
from g1_description.files.xml import decoded, parse_xml


def give_names(root: etree._Element, name: str) -> list[str]:
    """Add missing names of a robot and the materials of its visuals.

    Args:
        root: The robot element, which is changed.
        name: For the robot.

    Returns:
        A message on the robot's name, and one on all names of materials.
    """
    sentences = []
    if root.get("name") is None:
        root.set("name", name)
        sentences.append(f"The robot has no name; using that of its file: {name}.")
    taken = {material.get("name") for material in root.iter("material")}
    free = (f"material_{number}" for number in count(1))
    given = []
    for link in root.findall("link"):
        for material in link.findall("visual/material"):
            if material.get("name") is None:
                new = next(word for word in free if word not in taken)
                material.set("name", new)
                given.append(f"{new} (link {link.get('name')})")
    if given:
        sentences.append(f"Materials without a name were named: {', '.join(given)}.")
    return sentences


_HAS_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")

FINDABLE = ("package", "model", "file")
"""Schemes of URIs of local files."""


def scheme_of(name: str) -> str:
    """Return the scheme of a URI, empty for a path."""
    return name.partition("://")[0] if _HAS_SCHEME.match(name) else ""


def with_absolute_uris(
    text: str,
    folder: Path,
    package_folder: Callable[[str], str | None] = lambda _: None,
    name: str | None = None,
) -> str:
    """Make the file names in a URDF absolute.

    RViz and other readers of the parameter server can then find the meshes. Relative
    names become absolute, and so do those in a package that is not on the package path
    but around the file. Everything else is unchanged, comments and unknown tags too.

    Args:
        text: URDF as XML text.
        folder: Folder of the URDF file; the base of relative names.
        package_folder: Returns a package's folder, None if there is no such package.
        name: Name of the robot if the text has none; missing names of materials are
            added, too. RViz needs both. None: names are not added.

    Returns:
        The same XML with ``file://`` URIs in place of plain paths.

    Raises:
        DescriptionError: If the text is not XML.
    """
    root = parse_xml("robot description", text, keep_comments=True)
    if name is not None:
        give_names(root, name)
    for element in root.iter("mesh", "texture"):
        file = element.get("filename", "")
        if not file:
            continue
        if not scheme_of(file):
            element.set("filename", _absolute_uri(file, folder))
        elif local_path(file, package_folder) is None:
            path = find_file(file, folder, package_folder)
            if path is not None:
                element.set("filename", "file://" + quote(str(path)))
    return etree.tostring(root, encoding="unicode")


def _absolute_uri(name: str, folder: Path) -> str:
    """Make a URI of a path relative to a folder."""
    return "file://" + quote(os.path.normpath(folder.resolve() / name))


def find_file(
    name: str, folder: Path, package_folder: Callable[[str], str | None]
) -> Path | None:
    """Find a file named in a URDF.

    If the package is unknown or lacks the file, the folders around the URDF file are
    searched for one with the package's name, in its package.xml or as its own name.

    Args:
        name: As written in the URDF.
        folder: Folder of the URDF file; the base of relative names.
        package_folder: Returns a package's folder, None if there is no such package.

    Returns:
        The file's path, or None if there is no such file.
    """
    if not name:
        return None
    if not scheme_of(name):
        return local_path(_absolute_uri(name, folder), package_folder)
    return local_path(name, package_folder) or local_path(name, _around(folder).get)


def _around(folder: Path) -> dict[str, str]:
    """List a folder and its parents by name, the nearest of equal names."""
    folder = folder.resolve()
    around: dict[str, str] = {}
    for place in (folder, *folder.parents):
        for name in (package_name(place / "package.xml"), place.name):
            if name:
                around.setdefault(name, str(place))
    return around


def package_name(manifest: Path) -> str | None:
    """Read a package's name; None if there is no package."""
    try:
        text = decoded(manifest.read_bytes())
        name = parse_xml("package manifest", text).findtext("name")
    except (OSError, UnicodeError, DescriptionError):
        return None
    return name.strip() if name else None


def local_path(uri: str, package_folder: Callable[[str], str | None]) -> Path | None:
    """Find the file of a mesh URI.

    Args:
        uri: ``package://NAME/...``, ``model://NAME/...``, ``file:///...``,
            ``file://...`` below a folder of Gazebo's resources, or an absolute path.
        package_folder: Returns a package's folder, None if there is no such package.

    Returns:
        The file's path without ``..``, or None if there is no such file.
    """
    scheme, _, rest = uri.partition("://")
    path: Path | None = None
    if scheme in ("package", "model"):
        package, _, inside = rest.partition("/")
        folder = package_folder(package)
        path = None if folder is None else Path(folder) / unquote(inside)
    elif scheme == "file":
        path = Path(unquote(rest))
        places = () if path.is_absolute() else resource_folders()
        paths = (Path(place, path) for place in places)
        path = next((one for one in paths if os.path.isfile(one)), path)
    elif os.path.isabs(uri):
        path = Path(uri)
    if path is None:
        return None
    path = Path(os.path.normpath(path))
    try:
        return path if path.is_file() else None
    except OSError:  # such as a name that is too long
        return None
