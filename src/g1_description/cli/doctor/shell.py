"""Decisions on this shell and the address of the master; nothing is asked here."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import urlparse

from g1_description.cli.doctor.faults import Fault, fault
from g1_description.cli.doctor.nodes import UNKNOWN_HOST

DEFAULT_MASTER = "http://localhost:11311"

OF_ROS = ("rospy",)
"""What tells the Python of ROS."""

OF_WORKSPACE = ("g1_description.srv", "gazebo_msgs.msg")
"""What is found after the workspace is sourced."""

PACKAGES = {
    "numpy": "'numpy<2'",
    "scipy": "scipy",
    "lxml": "lxml",
    "PIL": "Pillow",
    "ruamel.yaml": "ruamel.yaml",
    "urdf_parser_py.urdf": "urdf_parser_py",
    "diagnostic_updater": "diagnostic_updater",
    "tf2_ros": "tf2_ros",
    "pybullet": "pybullet",
}
"""What the nodes import, and its name for pip."""


@dataclass(frozen=True)
class Interpreter:
    """A Python, and what it cannot import."""

    path: str
    """The program; empty if there is none."""

    failed: Mapping[str, str]
    """What is wrong, by the name of the module."""


def python(
    own: Interpreter, ros_folder: str, setup: str, is_sourced: bool
) -> Fault | None:
    """Judge the Python of this command, which rosrun starts as it does the nodes.

    Args:
        own: The one that runs this.
        ros_folder: Where the Python of ROS is.
        setup: The file of the workspace that a shell has to source.
        is_sourced: Whether it has. Else that comes first: rosrun finds the Python.
    """
    reason = _first(own, OF_ROS)
    if reason and is_sourced and os.path.dirname(own.path) != ros_folder:
        words = {"python": own.path, "folder": ros_folder}
        return fault("wrong_python", reason=reason, **words)
    reason = reason or _first(own, OF_WORKSPACE)
    return fault("no_workspace", reason=reason, setup=setup) if reason else None


def python_remark(own: Interpreter, first: Interpreter, ros_folder: str) -> str:
    """Name the Python of this command, and a python3 on PATH without ROS.

    Args:
        own: The one that runs this.
        first: The python3 that stands first on PATH.
        ros_folder: Where the Python of ROS is.
    """
    reason = _first(first, OF_ROS) if first.path else "there is none"
    if not reason:
        return own.path
    return (
        f"{own.path}; python3 on PATH is {first.path or 'missing'}, without ROS: "
        f"{reason}; scripts that begin with '#!/usr/bin/env python3' need export "
        f"PATH={ros_folder}:$PATH"
    )


def packages(own: Interpreter, needs_pybullet: bool) -> Fault | None:
    """Judge whether the nodes have what they import.

    Args:
        own: The Python that runs this, and the nodes.
        needs_pybullet: Whether the simulator is the one of this package.
    """
    for name, package in PACKAGES.items():
        if name not in own.failed or (name == "pybullet" and not needs_pybullet):
            continue
        return fault(
            "no_pybullet" if name == "pybullet" else "no_package",
            python=own.path,
            reason=own.failed[name],
            package=package,
        )
    return None


def _first(one: Interpreter, names: Sequence[str]) -> str:
    """Return what is wrong with the first of some modules that fails."""
    return next((one.failed[name] for name in names if name in one.failed), "")


def master_uri(uri: str) -> Fault | None:
    """Judge ROS_MASTER_URI."""
    try:
        host_of(uri)
    except ValueError:
        return fault("bad_master_uri", uri=uri, meant=_meant(uri))
    return None


def _meant(uri: str) -> str:
    """Complete what is no address, as far as it can be part of one."""
    host, port = r"[\w.-]+", r"\d+"
    parts = re.fullmatch(f"(?:https?://)?({host})(?::({port}))?/?", uri)
    return f"http://{parts[1]}:{parts[2] or 11311}" if parts else DEFAULT_MASTER


def master(uri: str, reason: str, is_here: bool) -> Fault:
    """Tell that there is no master.

    Args:
        uri: Where it should be.
        reason: What came of asking it.
        is_here: Whether that is this machine.
    """
    if is_here:
        return fault("no_master", uri=uri, reason=reason)
    host = host_of(uri)[0]
    cure = f"ssh {host} roscore"
    if reason == UNKNOWN_HOST:
        cure = (
            f"getent hosts {host}  # knows no such host: correct the name in "
            "ROS_MASTER_URI, add it to /etc/hosts, or use the IP address"
        )
    return fault("no_remote_master", uri=uri, reason=reason, cure=cure)


def host_of(uri: str) -> tuple[str, int]:
    """Read host and port of an address.

    Raises:
        ValueError: If it is none.
    """
    parts = urlparse(uri)
    if parts.scheme != "http" or not parts.hostname or not parts.port:
        raise ValueError(f"'{uri}' is no address")
    return parts.hostname, parts.port


def is_loopback(address: str) -> bool:
    """Whether an address means the machine that uses it."""
    return address.startswith("127.") or address == "::1"


def own_address(
    name: tuple[str, str],
    addresses: Mapping[str, bool],
    master_is_here: bool,
    towards_master: str,
) -> Fault | None:
    """Judge what nodes of this shell give as their address.

    Args:
        name: The variable, and its value.
        addresses: The addresses of that value, and whether they are this machine's.
        master_is_here: Whether the master is on this machine.
        towards_master: This machine's address on the way to the master.
    """
    variable, value = name
    if not addresses:
        reason = "no machine of that name is known here"
    elif not any(addresses.values()):
        reason = "that is another machine"
    elif not master_is_here and all(is_loopback(address) for address in addresses):
        reason = "on the machine of the master that is the master's own"
    else:
        return None
    cure = f"unset ROS_HOSTNAME; export ROS_IP={towards_master or '127.0.0.1'}"
    return fault(
        "wrong_ros_ip", variable=variable, value=value, reason=reason, cure=cure
    )
