"""The observations of the real Gazebo, and how answers are compared with them."""

import json
import math
from fnmatch import fnmatchcase

import numpy as np
from geometry_msgs.msg import Pose, Twist

from ..ros_testing import REPOSITORY

GOLDEN = REPOSITORY / "test" / "data" / "golden"
XYZ, XYZW = set("xyz"), set("xyzw")
NUMBERS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}


def load_cases():
    """Read the cases, those that are to run last at the end."""
    text = (GOLDEN / "gazebo11_observed.json").read_text(encoding="utf-8")
    cases = json.loads(text)["cases"]
    return sorted(cases, key=run_order)


def run_order(case):
    """Keep cases of one gravity together: each other gravity is a new start."""
    last = case["id"].startswith("last.")
    return last, -case["gravity"][2] if last else case["gravity"][2]


def with_numbers(value):
    """Put floats where JSON has words for them."""
    if isinstance(value, dict):
        return {key: with_numbers(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [with_numbers(entry) for entry in value]
    return NUMBERS.get(value, value) if isinstance(value, str) else value


def plain(message):
    """Turn a ROS message into what the file has: dicts, lists, numbers, strings."""
    if isinstance(message, Pose):
        return plain(message.position) + plain(message.orientation)
    if isinstance(message, Twist):
        return plain(message.linear) + plain(message.angular)
    if isinstance(message, (list, tuple)):
        return [plain(entry) for entry in message]
    if not hasattr(message, "__slots__"):
        return message
    values = {name: plain(getattr(message, name)) for name in message.__slots__}
    if values and set(values) <= XYZW:
        return list(values.values())
    return values


def as_lists(value):
    """Write what the file has as dicts of coordinates as ``plain`` writes messages."""
    if isinstance(value, list):
        return [as_lists(entry) for entry in value]
    if not isinstance(value, dict):
        return value
    entries = {key: as_lists(entry) for key, entry in value.items()}
    if set(entries) == {"position", "orientation"}:
        return entries["position"] + entries["orientation"]
    return list(entries.values()) if set(entries) in (XYZ, XYZW) else entries


class Comparison:
    """Compare what came with what was observed; differences are kept."""

    def __init__(self, tolerance):
        """Take a case's tolerances by pattern."""
        self._tolerance = tolerance
        self.differences = []

    def compare(self, field, expected, got):
        """Compare all that is expected; what came beyond that is not looked at."""
        if isinstance(expected, dict) and isinstance(got, dict):
            for name, value in expected.items():
                self.compare(f"{field}.{name}", value, got.get(name, "nothing"))
        elif is_numbers(expected) and is_numbers(got) and len(expected) == len(got):
            self._compare_numbers(field, expected, got)
        elif isinstance(expected, list) and isinstance(got, list):
            if len(expected) != len(got):
                self._differs(field, expected, got)
            for index, pair in enumerate(zip(expected, got)):
                self.compare(f"{field}.{index}", *pair)
        elif is_number(expected) and is_number(got):
            self._compare_numbers(field, [expected], [got])
        elif type(expected) is not type(got) or expected != got:
            self._differs(field, expected, got)

    def compare_whole(self, field, expected, got):
        """Compare a dict that has all there is: absent numbers are zero."""
        for name in sorted({*expected, *got}):
            pair = expected.get(name, 0.0), got.get(name, 0.0)
            self.compare(f"{field}.{name}", *pair)

    def _compare_numbers(self, field, expected, got):
        expected, got = np.array(expected, float), np.array(got, float)
        if len(expected) == 7 and expected[3:] @ got[3:] < 0.0:
            got = np.concatenate([got[:3], -got[3:]])
        error = np.abs(expected - got)
        same = (error <= self._allowed(field, expected)) | (
            np.isnan(expected) & np.isnan(got)
        )
        if not same.all():
            self._differs(field, expected.tolist(), got.tolist())

    def _allowed(self, field, expected):
        """Find the tolerance of a field: the longest pattern's, or the general one."""
        patterns = [name for name in self._tolerance if fnmatchcase(field, name)]
        if patterns:
            return max(self._tolerance[max(patterns, key=len)], 1e-9)
        return 1e-6 + 1e-5 * np.abs(expected)

    def _differs(self, field, expected, got):
        self.differences.append(f"{field}: expected {expected!r}, got {got!r}")


def is_number(value):
    """Tell numbers from truth values."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_numbers(value):
    """Tell whether it is a list of numbers only."""
    return isinstance(value, list) and bool(value) and all(map(is_number, value))
