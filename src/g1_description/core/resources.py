"""Where the files that a URDF names really are."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote, unquote
from xml.etree import ElementTree

from .errors import DescriptionError

_HAS_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")


def with_absolute_uris(text: str, folder: Path) -> str:
    """Make the relative file names in a URDF absolute.

    RViz and every other reader of the parameter server then find the meshes
    without knowing where the URDF file was. Everything else in the robot stays as
    it is, comments and unknown tags too.

    Args:
        text: URDF as XML text.
        folder: Folder of the URDF file, which relative names start from.

    Returns:
        The same XML with ``file://`` URIs in place of plain paths.

    Raises:
        DescriptionError: If the text is not XML.
    """
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    try:
        root = ElementTree.fromstring(text, parser=parser)
    except ElementTree.ParseError as error:
        raise DescriptionError(f"The robot description is not XML: {error}.") from error
    for element in root.iter():
        name = element.get("filename", "")
        if element.tag in ("mesh", "texture") and name and not _HAS_SCHEME.match(name):
            path = os.path.normpath(folder.resolve() / name)
            element.set("filename", "file://" + quote(path))
    return ElementTree.tostring(root, encoding="unicode")


def local_path(uri: str, package_folder: Callable[[str], str | None]) -> Path | None:
    """Find the file behind a mesh URI.

    Args:
        uri: ``package://NAME/...``, ``file:///...`` or an absolute path.
        package_folder: Gives a package's folder, None if there is no such package.

    Returns:
        The file's path, or None where there is no such file.
    """
    scheme, _, rest = uri.partition("://")
    path: Path | None = None
    if scheme == "package":
        package, _, inside = rest.partition("/")
        folder = package_folder(package)
        path = None if folder is None else Path(folder) / unquote(inside)
    elif scheme == "file":
        path = Path(unquote(rest))
    elif os.path.isabs(uri):
        path = Path(uri)
    try:
        return path if path is not None and path.is_file() else None
    except OSError:  # such as a name that is too long
        return None
