"""A stand-in for Gazebo, a link-state bridge and a display for the Unitree G1.

``Robot``, ``Client`` and ``Stream`` are the interface for Python programs, with what
they take and return; see docs/python.md. They are imported when they are first used,
which takes a while.
"""

from __future__ import annotations

import importlib
import site
import sys
from pkgutil import extend_path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api import Robot as Robot
    from .checks.verdict import Finding as Finding
    from .checks.verdict import Verdict as Verdict
    from .client import Client as Client
    from .ik.keyframe_poses import Keyframes as Keyframes
    from .ik.limits import TrajectoryBounds as TrajectoryBounds
    from .ik.results import IkResult as IkResult
    from .ik.targets import Target as Target
    from .ik.targets import box_targets as box_targets
    from .ik.ways import arc as arc
    from .ik.ways import line as line
    from .ik.ways import turn as turn
    from .motion.motion import Motion as Motion
    from .scenes.scene import Scene as Scene
    from .stream import Stream as Stream

# The generated services, g1_description.srv, lie in another folder of this name.
__path__ = extend_path(__path__, __name__)

PUBLIC = {
    "Client": "client",
    "Finding": "checks.verdict",
    "IkResult": "ik.results",
    "Keyframes": "ik.keyframe_poses",
    "Motion": "motion.motion",
    "Robot": "api",
    "Scene": "scenes.scene",
    "Stream": "stream",
    "Target": "ik.targets",
    "TrajectoryBounds": "ik.limits",
    "Verdict": "checks.verdict",
    "arc": "ik.ways",
    "box_targets": "ik.targets",
    "line": "ik.ways",
    "turn": "ik.ways",
}
"""Where the public names are."""

__all__ = [name for name in PUBLIC if name not in ("Client", "Stream")]  # need ROS


def __getattr__(name: str) -> Any:
    """Import a public name.

    Raises:
        ImportError: If this Python lacks a library that it needs.
    """
    if name not in PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        module = importlib.import_module(f"{__name__}.{PUBLIC[name]}")
    except ModuleNotFoundError as error:
        from .libraries import missing

        raise ImportError(missing(f"{__name__}.{name}", error)) from error
    return getattr(module, name)


def __dir__() -> list[str]:
    """List the names of this module."""
    return sorted({*globals(), *PUBLIC})


def _find_installed() -> None:
    """Let this Python find libraries that pip installed for catkin's Python.

    For ROS' own Python where the nodes have an environment. That one is searched last,
    so that whatever this Python has itself is used.
    """
    try:
        from .built_with import SITE_PACKAGES, VERSION
    except ImportError:
        return  # not built by catkin
    is_same_version = "{}.{}".format(*sys.version_info) == VERSION
    if is_same_version and SITE_PACKAGES not in sys.path:
        site.addsitedir(SITE_PACKAGES)


_find_installed()
