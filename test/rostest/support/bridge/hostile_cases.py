"""Messages of link states: broken, strange, and good ones, one of each kind.

The decoder's and the estimator's own tests have the others of each kind.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from geometry_msgs.msg import Pose, Twist
from std_msgs.msg import String

from .arm import arm_states
from tcpros import LENGTH, body_of

SHOWN = {"shoulder": 0.25, "elbow": -0.5, "slide": 0.125}
MALFORMED, MISSING, TWICE = "Cannot decode", "are ignored", "Duplicate links"
SILENCE, COMMAND = "No valid message", "is ignored"
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
    whole = body_of(arm_states(**SHOWN))
    nan, twice, most = (arm_states(**SHOWN) for _ in range(3))
    nan.pose[-1].position.x = math.nan
    _add_links(twice, ["arm::tip"])
    _add_links(most, [f"crowd::link_{number}" for number in range(10_000)])
    for field in ("name", "pose", "twist"):
        getattr(most, field).reverse()
    other = body_of(arm_states(**SHOWN, model="leg"))
    return {
        "nothing": Case(b"", MALFORMED, None),
        "all but the last byte": Case(whole[:-1], MALFORMED, None),
        "four billion names": Case(LENGTH.pack(2**32 - 1) + whole[4:], MALFORMED, None),
        "another type": Case(body_of(String("not what you think")), MALFORMED, None),
        "NaN": Case(body_of(nan), MISSING, {"shoulder": 0.25, "elbow": -0.5}),
        "a link twice": Case(body_of(twice), TWICE),
        "the model renamed": Case(other, MISSING, None),
        "no UTF-8": Case(whole.replace(b"ground", b"gr\xff\xfe\x80d")),
        "ten thousand links in reverse": Case(body_of(most)),
    }


def _add_links(message, names):
    """Put more links behind the others."""
    pose = Pose()
    pose.orientation.w = 1.0
    for name in names:
        message.name.append(name)
        message.pose.append(pose)
        message.twist.append(Twist())
