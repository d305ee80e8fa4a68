"""A setup with all files that it names, for machines that do not have these."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.sax.saxutils import escape

from g1_description.core.collisions.pairs_file import read_allowed_pairs
from g1_description.core.files.model_files import find_folder
from g1_description.core.files.uris import local_path
from g1_description.core.urdf.reader import parse_urdf

from .setup import Setup

PAIRS = "pairs.yaml"


@dataclass(frozen=True, eq=False)
class Package:
    """A setup, and the files that it names."""

    setup: Setup

    meshes: Mapping[str, bytes] = field(default_factory=dict)
    """Contents by the names that the robot's description has for them."""

    pairs: bytes | None = None
    """Content of the file of allowed pairs; None where that of the package is meant."""

    key: str = field(default_factory=lambda: uuid.uuid4().hex)
    """Tells packages apart."""


def packed(setup: Setup) -> Package:
    """Pack a setup.

    Raises:
        G1DescriptionError: If its robot or its pairs cannot be read.
        OSError: If a mesh cannot be read.
    """
    links = parse_urdf(setup.urdf).links
    shapes = [s for link in links for s in (*link.collisions, *link.visuals)]
    meshes = {}
    for name in dict.fromkeys(s.filename for s in shapes if s.kind == "mesh"):
        path = local_path(name, find_folder)
        if path is not None:
            meshes[name] = Path(path).read_bytes()
    pairs = None
    if setup.pairs is not None:
        read_allowed_pairs(setup.pairs)
        pairs = setup.pairs.read_bytes()
    return Package(setup, meshes, pairs)


def unpacked(package: Package, folder: Path) -> Setup:
    """Write the files of a package.

    Args:
        package: The package.
        folder: An empty folder, which has to stay as long as the setup is used.

    Returns:
        The setup, which names these files.
    """
    setup, urdf = package.setup, package.setup.urdf
    for number, (name, content) in enumerate(package.meshes.items()):
        file = folder / f"{number}{Path(name).suffix}"
        file.write_bytes(content)
        urdf = urdf.replace(f'"{_quoted(name)}"', f'"file://{file}"')
    pairs = setup.pairs
    if package.pairs is not None:
        pairs = folder / PAIRS
        pairs.write_bytes(package.pairs)
    return replace(setup, urdf=urdf, pairs=pairs)


def _quoted(name: str) -> str:
    """Write a name as it is between the quotes of an XML attribute."""
    return escape(name, {'"': "&quot;"})
