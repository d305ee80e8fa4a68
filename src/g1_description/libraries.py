"""Libraries that are not installed: the sentence about them."""

from __future__ import annotations

import re
import sys
from importlib import metadata

PACKAGE = "g1_description"

ROS_MODULES = re.compile(
    r"(ros(py|graph|lib|bag|pkg)|tf|tf2_\w+|actionlib|genpy|\w+_(msgs|srvs)"
    r"|diagnostic_updater|dynamic_reconfigure|g1_description\.(msg|srv))(\.|$)"
)
"""Modules that come with ROS or with its workspace."""

DISTRIBUTIONS = {"PIL": "Pillow", "ruamel": "ruamel.yaml"}
"""Names for pip of libraries that are imported by another one."""


def missing(what: str, error: ModuleNotFoundError) -> str:
    """Write a sentence about a library that is not there, and how to install it.

    Args:
        what: What needs it.
        error: The error of its import.
    """
    name = str(error.name)
    if ROS_MODULES.match(name):
        return (
            f"{what} needs {name}, which {sys.executable} lacks: it needs ROS. Source "
            "the workspace and use /usr/bin/python3."
        )
    library = DISTRIBUTIONS.get(name.split(".")[0], name.split(".")[0])
    needs, pip = f"{what} needs {library}", f"{sys.executable} -m pip install"
    try:
        marker = _requirement(library)
    except metadata.PackageNotFoundError:  # built by catkin
        return f"{needs}; install it as docs/install.md says: {pip} -r requirements.txt"
    installed = library
    below = re.search(r"python_version < ['\"]3\.(\d+)", marker or "")
    if below and sys.version_info >= (3, int(below[1])):
        return f"{needs}, which needs a Python older than 3.{below[1]}."
    if marker is not None:
        extra = re.search(r"extra == ['\"](\w+)", marker)
        installed = f"'{PACKAGE}[{extra[1]}]'" if extra else PACKAGE
    return f"{needs}; install it with: {pip} {installed}"


def _requirement(library: str) -> str | None:
    """Return the marker with which pip knows a library of this package, if it does.

    Raises:
        PackageNotFoundError: If pip did not install this package.
    """
    lines = metadata.requires(PACKAGE) or ()
    name = re.compile(re.sub(r"[-_.]+", "[-_.]+", library) + r"\b", re.IGNORECASE)
    pairs = (line.partition(";") for line in lines)
    markers = (marker for needed, _, marker in pairs if name.match(needed))
    return next((marker for marker in markers if "all" not in marker), None)
