"""What is drawn about a robot as it is now."""

from dataclasses import replace

import numpy as np
from checked import POST, assert_as_kept

from g1_description.checks.checker import Checker
from g1_description.checks.marks import draw_marks, red_links, short_name
from g1_description.checks.thresholds import Thresholds
from g1_description.checks.verdict import Finding, Verdict
from g1_description.robot.urdf import parse_urdf

FLOOR = Thresholds(floor_height=1.0)


class Written:
    """A canvas that writes down what is drawn on it, in [mm]."""

    def __init__(self):
        self.lines = []

    def __getattr__(self, kind):
        def write(namespace, points, *rest):
            numbers = np.rint(1000.0 * np.asarray(points)).astype(int).tolist()
            self.lines.append(f"{kind} {namespace}: {numbers} {rest}\n")

        return write


def test_marks_are_where_they_were(tmp_path):
    light = Checker(parse_urdf(POST), FLOOR)
    # So narrow that its arm, which is heavy, lets it fall over.
    narrow = POST.replace('"0.4 0.4 0.1"', '"0.1 0.1 0.1"')
    heavy = Checker(parse_urdf(narrow.replace('"0.5"/>\n', '"500"/>\n')), FLOOR)
    flat, tilted = (0.0, 0.0, 0.6, 0.8), (0.28, 0.0, 0.576, 0.768)
    canvas = Written()
    for checker, arm, height, turn, only in (
        (light, 0.95, 1.05, flat, ()),
        (light, -1.25, 1.02, flat, ()),
        (light, 1.25, 1.2, flat, ()),
        (light, 0.95, None, flat, ()),
        (light, 1.02, 1.05, tilted, ("position",)),
        (heavy, -0.75, 1.05, flat, ("center_of_mass",)),
    ):
        base = None if height is None else np.array([1.0, 2.0, height, *turn])
        canvas.lines.append(f"state {arm} {height} {only}\n")
        verdict = checker.check_state({"arm_joint": arm}, base, only)
        draw_marks(canvas, verdict, 0.1)
    canvas.lines.append("the same while it moves\n")
    draw_marks(canvas, replace(verdict, findings=(), checked=()), 0.1)
    assert_as_kept("".join(canvas.lines), "marks.txt", tmp_path)


def test_links_in_collision_alone_are_red():
    numbers = 0.5, 0.1, "m", 1.0, 2.0, 0.5, ((1.0, 2.0),), "far"
    found = [
        Finding(check, "failed", subject, *numbers)
        for check, subject in (
            ("self_collision", ("a_link", "b_link")),
            ("penetration", ("c_link",)),
            ("position", ("d_joint",)),
        )
    ]
    assert red_links(Verdict("r", tuple(found))) == {"a_link", "b_link"}
    assert [*map(short_name, ("a_link", "d_joint", "torso"))] == ["a", "d", "torso"]
