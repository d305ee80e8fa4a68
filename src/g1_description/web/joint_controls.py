"""Sliders for all joints of a robot."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from g1_description.checks.rule import units
from g1_description.robot.description import Joint, by_limb
from g1_description.web.edit_guard import Held
from g1_description.web.robot import ShownRobot, ShownState
from g1_description.web.ui_loop import Desk

if TYPE_CHECKING:
    from viser import GuiApi, GuiSliderHandle


STEP = 0.001
"""Of sliders, in [rad] or [m]."""

FINE = 5e-5
"""Sliders show a change of more than this, in [rad] or [m]."""

UNLIMITED = {"prismatic": 1.0}
"""How far the slider of a joint without limits goes to both sides, by kind."""

HELD = 0.7
"""How long a slider that a person has moved does not follow the robot, in [s]: states
that are on their way are older than what the person wants."""

PERIOD = 0.1
"""Time between two looks at the robot by sliders, in [s]."""


class JointPanel:
    """Sliders in folders, one per limb."""

    def __init__(self, gui: GuiApi, desk: Desk, robot: ShownRobot) -> None:
        """Add the sliders.

        Args:
            gui: Where to.
            desk: Does what a person wants.
            robot: Whose joints they are.
        """
        self._robot = robot
        self._sliders: dict[str, GuiSliderHandle[float]] = {}
        self._held = Held(HELD)
        self._looked = 0.0
        joints = {joint.name: joint for joint in robot.description.movable_joints}
        for limb, names in by_limb(joints).items():
            with gui.add_folder(limb.capitalize(), expand_by_default=len(joints) < 12):
                for name in names:
                    slider = self._add(gui, joints[name])
                    self._sliders[name] = slider
                    self._held.know(slider)
                    desk.on(slider, partial(self._moved, name))

    @staticmethod
    def _add(gui: GuiApi, joint: Joint) -> GuiSliderHandle[float]:
        """Add the slider of a joint."""
        lower, upper = slider_range(joint)
        unit = units(joint)[0]
        limits = f"from {joint.lower:g} to {joint.upper:g} {unit}"
        if not math.isfinite(joint.upper - joint.lower):
            limits = f"without limits, in {unit}"
        return gui.add_slider(
            label_of(joint.name),
            min=lower,
            max=upper,
            step=min(STEP, max(upper - lower, 1e-6)),
            initial_value=min(max(0.0, lower), upper),
            hint=f"{joint.name} {limits}",
            disabled=joint.lower >= joint.upper,
        )

    def _moved(self, name: str) -> None:
        """Move a joint to where a person wants it."""
        slider = self._sliders[name]
        value = float(slider.value)
        # A browser sends no others; these come from elsewhere, or are not numbers.
        if slider.min - STEP <= value <= slider.max + STEP:
            self._held.hold(slider)
            self._robot.command({name: min(max(value, slider.min), slider.max)})

    def follow(self, state: ShownState) -> None:
        """Show where the joints are, but those that a person moves."""
        now = time.monotonic()
        if now < self._looked + PERIOD:
            return
        self._looked = now
        for name, slider in self._sliders.items():
            place = state.positions.get(name)
            if place is None or self._held.is_held(slider):
                continue
            value = min(max(place, slider.min), slider.max)
            self._held.show(slider, round(value, 4), FINE)

    def let_go(self) -> None:
        """Follow the robot again: it is moved by other means."""
        self._held.let_go()


def label_of(name: str) -> str:
    """Leave out what ends the names of most joints."""
    return name[: -len("_joint")] if name.endswith("_joint") else name


def slider_range(joint: Joint) -> tuple[float, float]:
    """Return from where to where a joint's slider goes, in [rad] or [m]."""
    most = UNLIMITED.get(joint.kind, math.pi)
    lower = joint.lower if math.isfinite(joint.lower) else -most
    upper = joint.upper if math.isfinite(joint.upper) else most
    return (lower, upper) if lower < upper else (-most, most)


def known(positions: Mapping[str, float], robot: ShownRobot) -> dict[str, float]:
    """Return the known positions of a robot's joints in the order of its file.

    They are rounded, but not to beyond a limit: others would refuse them.
    """
    return {
        joint.name: min(max(round(positions[joint.name], 6), joint.lower), joint.upper)
        for joint in robot.description.movable_joints
        if joint.name in positions
    }
