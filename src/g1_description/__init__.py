"""A stand-in for Gazebo, a link-state bridge and a display for the Unitree G1."""

from __future__ import annotations

import site
import sys
from pkgutil import extend_path

# The generated services, g1_description.srv, lie in another folder of this name.
__path__ = extend_path(__path__, __name__)


def _find_installed() -> None:
    """Let this Python find what pip installed for the Python that catkin was given.

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
