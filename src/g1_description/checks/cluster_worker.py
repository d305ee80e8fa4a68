"""What a worker of a cluster does."""

from __future__ import annotations

import threading
import uuid
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.sax.saxutils import escape

from g1_description.checks.batch import Judge, Setup
from g1_description.checks.report import Outcome
from g1_description.collisions.allowed_pairs import read_allowed_pairs
from g1_description.files.model_files import find_folder
from g1_description.files.uris import local_path
from g1_description.motion.files.read import read_motion
from g1_description.motion.motion import Motion
from g1_description.robot.urdf import parse_urdf

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


MAX_JUDGES = 2
"""So many robots are kept ready: one that works, and one whose work ends."""

_LOCK = threading.Lock()
"""Threads of a worker take turns: what judges is made for one thread."""

_judges: OrderedDict[str, tuple[Judge, TemporaryDirectory[str]]] = OrderedDict()


def judged_content(package: Package, name: str, content: bytes | Motion) -> Outcome:
    """Judge a motion.

    Args:
        package: What is judged.
        name: Of the motion's file.
        content: All of that file, or its motion.
    """
    with _LOCK:
        judge = _judge(package)
        if isinstance(content, Motion):
            motion = content
            return judge.outcome(name, lambda: motion)
        with _folder() as folder:
            path = Path(folder, Path(name).name)
            path.write_bytes(content)
            rate = package.setup.rate
            return judge.outcome(
                name, lambda: read_motion(path, judge.description, rate)
            )


def _judge(package: Package) -> Judge:
    """Return what judges, made anew only for another package."""
    if package.key not in _judges:
        folder = _folder()
        judge = Judge(unpacked(package, Path(folder.name)))
        _judges[package.key] = judge, folder
        while len(_judges) > MAX_JUDGES:
            _, (_, old) = _judges.popitem(last=False)
            old.cleanup()
    return _judges[package.key][0]


def _folder() -> TemporaryDirectory[str]:
    """Make a folder, which Dask removes where this worker cannot any more."""
    from distributed import get_worker

    return TemporaryDirectory(dir=get_worker().local_directory)
