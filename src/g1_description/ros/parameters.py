"""Private parameters of a node, read at start into a dataclass."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import rosgraph
import rospy

from g1_description.errors import DescriptionError, InvalidValueError
from g1_description.robot.description import Description
from g1_description.robot.profile import find_profile
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.waiting import MASTER_PERIOD, wait_until

NAMESPACE = "namespace"
"""Key in a field's metadata: the namespace of its parameters, with a final slash."""


def check_range(parameters, name, low, high):
    """Check that a parameter is within its range.

    Raises:
        InvalidValueError: If it is not, or is NaN.
    """
    value = getattr(parameters, name)
    if not low <= value <= high:
        raise InvalidValueError(f"~{name} must be from {low} to {high} (got {value}).")


def check_files(parameters, *names):
    """Check that parameters are absolute paths, or empty.

    Raises:
        InvalidValueError: If one is not.
    """
    for name in names:
        file = getattr(parameters, name)
        if file and not Path(file).is_absolute():
            raise InvalidValueError(f"~{name} must be an absolute path (got '{file}').")


def check_prefix(subject: str, prefix: str) -> None:
    """Check that a prefix is also a valid tf_prefix of robot_state_publisher.

    Raises:
        InvalidValueError: If it is not.
    """
    if prefix and (prefix.startswith("/") or not prefix.endswith("/")):
        raise InvalidValueError(
            f"{subject} must end with a slash and not begin with one (got '{prefix}')."
        )


def read_parameters(kind, given=None):
    """Read a node's private parameters.

    Args:
        kind: A dataclass with a parameter for each field, of the type of its default.
            The fields of a nested dataclass are parameters in the namespace of its
            field's metadata.
        given: Values by name that override the defaults, not the server's.

    Returns:
        The parameters, checked.

    Raises:
        InvalidValueError: If one has the wrong type or is out of its range.
    """
    name = rospy.get_name()
    found = {**(given or {}), **_flat(private_parameters())}
    for field in default_parameters(kind):
        place = rospy.resolve_name(f"~{field}")
        if place != f"{name}/{field}" and rospy.has_param(place):  # it is remapped
            found[field] = rospy.get_param(place)
    return _filled(kind, found)


def private_parameters() -> dict:
    """Return all parameters in the node's own namespace, by one call."""
    own = rospy.get_param(rospy.get_name(), {})
    return own if isinstance(own, dict) else {}


def _flat(values, namespace=""):
    """Flatten namespaces to NAMESPACE/NAME."""
    found = {}
    for name, value in values.items():
        found[namespace + name] = value
        if isinstance(value, dict):
            found.update(_flat(value, f"{namespace}{name}/"))
    return found


def _filled(kind, found, namespace=""):
    """Make a dataclass of values by name, or their defaults."""
    values = {}
    for field in fields(kind):
        if is_dataclass(field.default_factory):
            inner = namespace + field.metadata.get(NAMESPACE, "")
            values[field.name] = _filled(field.default_factory, found, inner)
        else:
            name = namespace + field.name
            value = found.get(name, field.default)
            values[field.name] = _converted(name, value, field.default)
    return kind(**values)


def default_parameters(kind, namespace="") -> dict:
    """List the parameters that ``read_parameters`` reads, with their defaults."""
    values = {}
    for field in fields(kind):
        if is_dataclass(field.default_factory):
            inner = namespace + field.metadata.get(NAMESPACE, "")
            values.update(default_parameters(field.default_factory, inner))
        else:
            values[namespace + field.name] = field.default
    return values


def _converted(name, value, default):
    """Check that a value has the type of its default; an int is a float, too."""
    if isinstance(default, float) and type(value) in (int, float):
        if math.isfinite(value):
            return float(value)
    elif isinstance(default, tuple) and isinstance(value, (list, tuple)):
        return tuple(value)
    elif type(value) is type(default):
        return value
    kind = "list" if isinstance(default, tuple) else type(default).__name__
    example = "" if isinstance(default, tuple) else f" like {default!r}"
    raise InvalidValueError(f"~{name} must be a {kind}{example} (got {value!r}).")


DESCRIPTION = "robot_description"

PROFILE = "_profile"
"""End of the name of the parameter with the profile of a robot."""


def parse_robot(urdf: str) -> Description:
    """Parse a URDF; if it is that of the parameter server, with the chosen profile.

    Raises:
        G1DescriptionError: If it is not a robot, or there is no such profile.
    """
    with suppress(OSError):  # without a master there is no profile
        is_chosen = bool(rospy.get_param(DESCRIPTION + PROFILE, ""))
        if is_chosen and rospy.get_param(DESCRIPTION, "") == urdf:
            return read_robot(DESCRIPTION)
    return parse_urdf(urdf)


def read_robot(parameter: str) -> Description:
    """Read a robot from the parameter server.

    Args:
        parameter: Its URDF. The launch files write next to it, as ``_profile``, the
            profile that ``robot:=`` chose; without one it is found by the URDF.

    Raises:
        G1DescriptionError: If it is not a robot, or there is no such profile.
    """
    urdf = rospy.get_param(parameter, None)
    if not isinstance(urdf, str):
        raise DescriptionError(f"The parameter {parameter} has no URDF.")
    chosen = rospy.get_param(parameter + PROFILE, "")
    profile = find_profile(str(chosen)) if chosen else None
    return replace(parse_urdf(urdf), given_profile=profile)


def find_parameter(name: str, namespace: str = "") -> str | None:
    """Find a parameter in a namespace or one above it.

    Args:
        name: The parameter. A name with / or ~ is not searched for upward.
        namespace: Namespace to start in; by default the node's.

    Returns:
        Its full name; None if there is none.
    """
    if name.startswith(("/", "~")):
        return rospy.resolve_name(name) if rospy.has_param(name) else None
    # The master starts in the caller's namespace; for the node's own name that would be
    # its private one.
    begin = f"/{namespace}/" if namespace else rospy.get_namespace()
    try:
        return rosgraph.Master(f"{begin}anyone").searchParam(name)
    except rosgraph.MasterError:
        return None


def wait_for_parameter(
    name: str,
    namespace: str,
    on_wait: Callable[[], None],
    timeout: float | None = None,
) -> str | None:
    """Wait until ``find_parameter`` finds a parameter.

    Args:
        name: The parameter.
        namespace: Namespace to start in.
        on_wait: Called once if it is not set yet.
        timeout: Longest wait in [s]; None: no limit, also while the master is down.

    Returns:
        Its full name; None after the timeout.

    Raises:
        ROSInterruptException: If the node is shut down.
        OSError: If the master is down and there is a timeout.
    """
    ignored = (OSError,) if timeout is None else ()

    def find():
        with suppress(*ignored):
            return find_parameter(name, namespace)

    found = find()
    if found is None:
        on_wait()
        found = wait_until(find, timeout, period=MASTER_PERIOD)
    return found
