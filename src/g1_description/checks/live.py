"""Checks of the current state of one robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from g1_description.checks.checker import Checker
from g1_description.checks.rules import RULES
from g1_description.checks.verdict import Verdict
from g1_description.errors import UnknownNameError
from g1_description.robot.state import RobotState
from g1_description.text import listed

AT_REST = tuple(rule.name for rule in RULES if rule.only_at_rest)
"""Checks that apply only to a robot at rest."""

LIVE = tuple(r.name for r in RULES if r.is_live and not r.needs_physics)
"""Checks of a current state."""

STANDSTILL = 1e-6
"""States closer in time than this, in [s], have no velocity: simulated time is
paused."""


class LiveCheck:
    """Checks states of one robot; an unchanged state is not checked again."""

    def __init__(self, checker: Checker) -> None:
        self._checker = checker
        joints = checker.description.movable_joints
        self._joints = frozenset(joint.name for joint in joints)
        self._last: tuple[float, np.ndarray] | None = None
        self._newest: tuple[object, Verdict] | None = None

    def begin_again(self) -> None:
        """Forget the last state, because time went back."""
        self._last = None

    def check(self, state: RobotState) -> Verdict:
        """Check a state.

        Args:
            state: Its unknown joints, such as those of hands, are ignored.

        Returns:
            The verdict. While the centre of mass moves, the checks of ``AT_REST`` are
            skipped.

        Raises:
            G1DescriptionError: If it cannot be checked.
        """
        positions, velocities = state.positions_by_name, state.velocities_by_name
        base = state.base_pose
        content = (
            positions,
            None if base is None else base.tobytes(),
            velocities,
        )
        if self._newest is None or content != self._newest[0]:
            own = self._own(positions)
            rates = None if velocities is None else self._own(velocities) or None
            verdict = self._checker.check_state(own, base, LIVE, rates)
            self._newest = content, verdict
        verdict = self._newest[1]
        if self._moves(state.time, verdict):
            return _without(verdict, AT_REST, "the robot moves")
        return verdict

    def _own(self, values: Mapping[str, float]) -> dict[str, float]:
        """Select the robot's joints; raise if there are none."""
        own = {name: value for name, value in values.items() if name in self._joints}
        if values and not own:
            raise UnknownNameError(
                f"{self._checker.description.name} has none of these joints: "
                f"{listed(values)}."
            )
        return own

    def _moves(self, time: float, verdict: Verdict) -> bool:
        """Tell whether the centre of mass has moved since the last state."""
        assert verdict.measured is not None
        balance, last = verdict.measured.balance, self._last
        if balance is None:
            self._last = None
            return False
        center = balance.center[0]
        self._last = time, center
        if last is None or time - last[0] < STANDSTILL:
            return False
        speed = np.linalg.norm(center - last[1]) / (time - last[0])
        return bool(speed > self._checker.thresholds.still_speed)


def _without(verdict: Verdict, checks: tuple[str, ...], reason: str) -> Verdict:
    """Remove some checks from a verdict, with their findings."""
    removed = [name for name in verdict.checked if name in checks]
    return replace(
        verdict,
        findings=tuple(f for f in verdict.findings if f.check not in checks),
        checked=tuple(name for name in verdict.checked if name not in checks),
        skipped={**verdict.skipped, **dict.fromkeys(removed, reason)},
    )
