"""The text below the button Why? of the page."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed")

from g1_description import Robot, Scene
from g1_description.motion.history_chunks import Stretch
from g1_description.web.first_cause import FirstCause

ROBOT = Robot()
HEIGHT = 0.3


@pytest.fixture
def states():
    """A robot on a box; a command jumps at 1 s, another joint lags from 1.5 s on."""
    motion = ROBOT.read_motion("squat.csv").resampled(100.0)
    names, stamps = motion.joint_names, np.round(1e9 * motion.times).astype(np.int64)
    bases = motion.base_poses + HEIGHT * np.eye(7)[2]
    states = Stretch(1, stamps, names, names, motion.positions, None, bases)
    commanded = motion.positions.copy()
    commanded[100:150, names.index("left_elbow_joint")] += 0.19
    commanded[150:, names.index("right_elbow_joint")] += np.linspace(0.0, 1.0, 451)
    return replace(states, commanded=commanded)


def text_of(states, scene):
    """Return the text, its checks and files being done at once."""
    text, checker = SimpleNamespace(), ROBOT.checker()

    def ask(_owner, _robot, find, then, _failed):
        then(find(checker))

    gui = SimpleNamespace(add_markdown=lambda _: text)
    page = SimpleNamespace(checks=SimpleNamespace(ask=ask))
    lane = SimpleNamespace(do=lambda get, then: then(get()))
    FirstCause(gui, page, lane).explain(None, lambda: (states, ()), scene=scene)
    return text.content.replace("\\", "")


def test_events_are_a_list_and_what_is_not_known_is_a_line_below(states):
    head, *events, unknown = text_of(states, None).splitlines()
    assert head.startswith("**right") and head.endswith("**")
    assert events[1].startswith("- 1.000 s: left_elbow_joint")
    assert unknown == "Not known: efforts of the motors, how it stands."


def test_a_robot_on_an_object_of_the_scene_stands(states):
    scene = Scene()
    scene.box("box", [2.0, 2.0, HEIGHT], [0.0, 0.0, HEIGHT / 2.0])
    assert text_of(states, scene).endswith("\n\nNot known: efforts of the motors.")
