"""Messages of link states: broken, strange, and good ones."""

from __future__ import annotations

import math
from typing import NamedTuple

from geometry_msgs.msg import Pose, Twist
from scipy.spatial.transform import Rotation
from std_msgs.msg import String

from .arm import LINKS, arm_states
from tcpros import LENGTH, body_of
from tcpros import packed as text

MANY = 2**32 - 1
SHOWN = {"shoulder": 0.25, "elbow": -0.5, "slide": 0.125}
MALFORMED, MISSING, TWICE = "Cannot decode", "are ignored", "Duplicate links"
SILENCE, COMMAND = "No valid message", "is ignored"
TILT = [0.2, 0.0, 0.0]
KINDS = (MALFORMED, MISSING, TWICE, SILENCE, COMMAND)
"""Words that tell a kind of line from the others."""


class Case(NamedTuple):
    """One message, and what the bridge makes of it."""

    data: bytes
    told: str | None = None
    """The kind of line that tells of it, if any."""
    shown: dict | None = SHOWN
    """The joint states that come of it, if any."""


def cases():
    """Give all cases by name."""
    return {**_broken(), **_strange_numbers(), **_strange_names(), **_good()}


def _broken():
    """List bytes that are no message."""
    whole = body_of(arm_states(**SHOWN))
    names, poses, twists = _sections()
    count = LENGTH.pack(5)
    found = {
        "nothing": b"",
        "half a count": whole[:2],
        "names without an end": whole[:40],
        "names alone": names,
        "half the poses": (names + poses)[:-100],
        "all but the last byte": whole[:-1],
        "a byte too much": whole + b"\0",
        "a message and a half": whole + whole[: len(whole) // 2],
        "fewer poses than names": names + _fewer(poses, 56) + twists,
        "fewer twists than names": names + poses + _fewer(twists, 48),
        "a name too few": arm_names(LINKS[:-1]) + poses + twists,
        "four billion names": LENGTH.pack(MANY) + names[4:] + poses + twists,
        "four billion poses": names + LENGTH.pack(MANY) + poses[4:] + twists,
        "four billion twists": names + poses + LENGTH.pack(MANY) + twists[4:],
        "a name of four billion bytes": count + LENGTH.pack(MANY) + whole[8:],
        "four billion of everything": LENGTH.pack(MANY) * (len(whole) // 4),
        "zeros": bytes(len(whole)),
        "a message of another type": body_of(String("not what you think")),
    }
    return {name: Case(data, MALFORMED, None) for name, data in found.items()}


def _sections():
    """Give the three lists of a message."""
    whole = body_of(arm_states(**SHOWN))
    numbers = 4 + 5 * 7 * 8, 4 + 5 * 6 * 8
    head = len(whole) - sum(numbers)
    return whole[:head], whole[head : head + numbers[0]], whole[head + numbers[0] :]


def _fewer(rows, width):
    """Take the last row of a list away."""
    return LENGTH.pack(4) + rows[4:-width]


def arm_names(links):
    """Write the list of names of some of the arm's links."""
    names = ["ground_plane::link", *(f"arm::{link}" for link in links)]
    return LENGTH.pack(len(names)) + b"".join(text(name.encode()) for name in names)


def _strange_numbers():
    """List numbers that no link has. The tip is the last link."""
    without_tip = {"shoulder": 0.25, "elbow": -0.5}

    def with_tip(**numbers):
        message = arm_states(**SHOWN)
        for name, number in numbers.items():
            part, field = name.split("_")
            setattr(getattr(message.pose[-1], part), field, number)
        return Case(body_of(message), MISSING, without_tip)

    zeros = {f"orientation_{field}": 0.0 for field in "xyzw"}
    found = {
        f"{number} as {name}": with_tip(**{name: number})
        for name in ("position_x", "orientation_x", "orientation_w")
        for number in (math.nan, math.inf, -math.inf, 1e300)
    }
    found["a zero quaternion"] = with_tip(**zeros)
    found["a quaternion too long"] = with_tip(orientation_w=1.1)
    twist = arm_states(**SHOWN)
    twist.twist[-1].angular.y = math.nan
    found["NaN in a twist"] = Case(body_of(twist), MISSING, without_tip)
    nowhere = arm_states(**SHOWN)
    for pose in nowhere.pose:
        pose.position.x = math.nan
    found["NaN everywhere"] = Case(body_of(nowhere), MISSING, {})
    elsewhere = arm_states(**SHOWN)
    elsewhere.pose[0].orientation.w = elsewhere.twist[0].linear.x = math.nan
    found["NaN in another model"] = Case(body_of(elsewhere))
    tilted = arm_states(**without_tip)
    q = tilted.pose[-1].orientation
    turned = Rotation.from_quat([q.x, q.y, q.z, q.w]) * Rotation.from_rotvec(TILT)
    q.x, q.y, q.z, q.w = turned.as_quat()
    shown = {**without_tip, "slide": 0.0}
    found["a link off its axis"] = Case(body_of(tilted), None, shown)
    return found


def _strange_names():
    """List names that come twice, not at all, or in no encoding."""
    twice = arm_states(**SHOWN)
    _add_links(twice, ["arm::tip"])
    ground = arm_states(**SHOWN)
    _add_links(ground, ["ground_plane::link"] * 2)
    odd = arm_states(**SHOWN)
    _add_links(odd, ["", "::", "arm::", "arm", "::tip", "\0", "arm::tip\0", "é" * 999])
    gone, empty = arm_states(**SHOWN), arm_states(**SHOWN)
    for field in ("name", "pose", "twist"):
        setattr(gone, field, getattr(gone, field)[:1])
        setattr(empty, field, [])
    whole = body_of(arm_states(**SHOWN))
    return {
        "a link twice": Case(body_of(twice), TWICE),
        "another model's link three times": Case(body_of(ground)),
        "odd names": Case(body_of(odd)),
        "another model's name no UTF-8": Case(
            whole.replace(b"ground", b"gr\xff\xfe\x80d")
        ),
        "a link's name no UTF-8": Case(
            whole.replace(b"arm::fore", b"arm::\xc3\x28re"), MISSING, {"shoulder": 0.25}
        ),
        "the model gone": Case(body_of(gone), MISSING, None),
        "the model renamed": Case(
            body_of(arm_states(**SHOWN, model="leg")), MISSING, None
        ),
        "no links": Case(body_of(empty), MISSING, None),
    }


def _add_links(message, names):
    """Put more links behind the others."""
    pose = Pose()
    pose.orientation.w = 1.0
    for name in names:
        message.name.append(name)
        message.pose.append(pose)
        message.twist.append(Twist())


def _good():
    """List messages that are as good as any."""
    reverse = arm_states(**SHOWN)
    for field in ("name", "pose", "twist"):
        getattr(reverse, field).reverse()
    more, most = arm_states(**SHOWN), arm_states(**SHOWN)
    other = arm_states(1.0, 1.0, 1.0, model="leg")
    for field in ("name", "pose", "twist"):
        getattr(more, field)[:0] = getattr(other, field)
    _add_links(most, [f"crowd::link_{number}" for number in range(10_000)])
    return {
        "links in reverse": Case(body_of(reverse)),
        "another model before it": Case(body_of(more)),
        "ten thousand links": Case(body_of(most)),
    }
