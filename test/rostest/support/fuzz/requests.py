"""Requests of any kind, as bytes: strategies made from the message definitions.

Bytes, not messages: a list may announce more than it holds, a name need not be text.
"""

import math
import struct
from functools import lru_cache

import genpy

from ..examples import strategies as st
from .xml import BOX, SOLID, entities, link, mesh, numbers, robot, sdf_model
from tcpros import LENGTH, packed

FORMATS = {
    **{"bool": "B", "byte": "b", "char": "B", "float32": "f", "float64": "d"},
    **{"int8": "b", "int16": "h", "int32": "i", "int64": "q"},
    **{"uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q"},
    **{"time": "II", "duration": "ii"},
}
FLOATS = (
    *(0.0, -0.0, 1.0, -1.0, 0.1, 0.793, 100.0, 1e-3, 1e-9, 5e-324, 2.2e-308),
    *(1e9, -1e9, 1.0000001e9, 1e18, 1e308, -1e308, math.nan, math.inf, -math.inf),
)
MODELS = (b"g1_robot", b"ground_plane", b"thing", b"sun", b"", b"world", b"nobody")
PLAIN = (b"pelvis", b"torso_link", b"left_knee_link", b"link", b"collision", b"only")
JOINTS = (b"left_elbow_joint", b"right_knee_joint", b"waist_yaw_joint", b"nothing")
SCOPED = tuple(
    b"::".join(names)
    for names in (
        (b"g1_robot", b"pelvis"),
        (b"g1_robot", b"left_elbow_joint"),
        (b"ground_plane", b"link"),
        (b"ground_plane", b"link", b"collision"),
        (b"thing", b"only"),
        (b"g1_robot", b""),
        (b"", b"pelvis"),
    )
)
ODD = (
    *(
        b"map",
        b"/map",
        b"::",
        b"\0",
        b"\n",
        b"%s%n",
        b"../..",
        b"\xff\xfe",
        b"\xed\xa0",
    ),
    *("\u4e2d\U0001f916".encode(), b"n" * 1001, b"n" * 100_000, b"\xc3" * 1_000_000),
)
LEVELS = (b"debug", b"info", b"warn", b"error", b"fatal", b"rosout", b"rospy", b"ros")
NUMBERS = (b"time_step", b"max_update_rate", b"gravity_z", b"erp", b"sor_pgs_iters")
THINGS = tuple(
    text.encode()
    for text in (
        robot(link()),
        robot(link(content=SOLID)),
        numbers("nan", 1),
        numbers(1e9, 0),
        mesh("/etc/passwd"),
        sdf_model('<link name="only"/>'),
        sdf_model("<static>1</static><link name='only'/>"),
        "<sdf/>",
        "<!-- ",
        entities(10, 10),
        robot(link(content=SOLID + BOX * 100)),
    )
)
EXISTING = st.sampled_from(MODELS + PLAIN + JOINTS + SCOPED)
NAMES = st.one_of(
    EXISTING,
    EXISTING,
    EXISTING,
    st.sampled_from(ODD + LEVELS + NUMBERS),
    st.text(max_size=20).map(lambda text: text.encode("utf-8", "surrogatepass")),
    st.binary(max_size=20),
)
SANE = st.sampled_from([0.0, 0.001, 0.1, 0.5, 1.0, 9.8, 100.0, 1000.0])


@st.composite
def broken(draw, text):
    """Break bytes in a few places."""
    data = bytearray(draw(text))
    for _ in range(draw(st.integers(0, 4))):
        place = draw(st.integers(0, len(data)))
        length = draw(st.integers(0, 12))
        data[place : place + length] = draw(st.binary(max_size=12))
    return bytes(data)


XML = st.one_of(st.sampled_from(THINGS), broken(st.sampled_from(THINGS)))


def number(kind):
    """Give any number of a kind."""
    code = FORMATS[kind]
    if code in "fd":
        wide = st.one_of(SANE, SANE, st.sampled_from(FLOATS), st.floats())
        return wide.map(lambda value: _float(code, value))
    widths = [struct.calcsize(f"<{letter}") * 8 for letter in code]
    parts = []
    for letter, bits in zip(code, widths):
        low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        low, high = (0, 2**bits - 1) if letter.isupper() else (low, high)
        edges = st.sampled_from([0, 1, 2, low, high])
        parts.append(st.one_of(edges, edges, st.integers(low, high)))
    return st.tuples(*parts).map(lambda values: struct.pack(f"<{code}", *values))


def _float(code, value):
    try:
        return struct.pack(f"<{code}", value)
    except OverflowError:
        return struct.pack(f"<{code}", math.inf)


@lru_cache(maxsize=None)
def of_type(kind, field=""):
    """Give the bytes of any value of a type of ROS."""
    base, is_array = kind.split("[")[0], kind.endswith("]")
    if is_array:
        items = st.lists(of_type(base, field), max_size=5)
        return items.map(lambda parts: LENGTH.pack(len(parts)) + b"".join(parts))
    if base == "string":
        return {"model_xml": XML}.get(field, NAMES).map(packed)
    if base in FORMATS:
        return number(base)
    return of_message(genpy.message.get_message_class(base))


@lru_cache(maxsize=None)
def of_message(message):
    """Give the bytes of any message of a class."""
    fields = zip(message._slot_types, message.__slots__)
    return st.tuples(*(of_type(kind, field) for kind, field in fields)).map(b"".join)


def of_service(name, request_class):
    """Give a service's name with any request, one in ten of them broken."""
    whole = of_message(request_class)
    is_stepping = name in ("step", "step_model")
    if is_stepping:  # what was asked for last is done, so not too much of it
        steps = st.integers(0, 20).map(LENGTH.pack)
        whole = st.tuples(whole, steps).map(
            lambda drawn: drawn[0][: -LENGTH.size] + drawn[1]
        )
    choice = st.integers(0, 9)
    bodies = st.tuples(choice, whole, broken(whole)).map(
        lambda drawn: drawn[2] if drawn[0] == 0 and not is_stepping else drawn[1]
    )
    return st.tuples(st.just(name), bodies)


def any_request(classes):
    """Give any request to any service.

    Args:
        classes: The classes of the requests by the services' names.
    """
    return st.one_of([of_service(name, kind) for name, kind in classes.items()])
