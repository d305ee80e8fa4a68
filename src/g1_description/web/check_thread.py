"""Checks of motions and current states, in a thread."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Callable, Tuple, TypeVar

from g1_description.checks.arrows import ForceArrows, force_arrows
from g1_description.checks.checker import Checker, LiveCheck
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.state import RobotState
from g1_description.scenes.scene import Scene
from g1_description.web.robot import ShownRobot
from g1_description.web.ui_loop import UiLoop

if TYPE_CHECKING:
    from g1_description.checks.verdict import Verdict


PERIOD = 0.04
"""Shortest period of checks of current states, in [s]."""

AGAIN = 10.0
"""Time between attempts to prepare checks, in [s]."""

Found = TypeVar("Found")

MakeChecker = Callable[[Description], Checker]


_Request = Tuple[
    Callable[[Checker], Any], Callable[[Any], object], Callable[[], object]
]
"""What a checker finds, what is called with that, and what on errors."""


class CheckThread:
    """Checks motions at once, and the newest state of each robot on request."""

    def __init__(
        self,
        ui: UiLoop,
        make: MakeChecker,
        seen: Callable[[ShownRobot, RobotState, Verdict], object],
    ) -> None:
        """Start the thread; checks are prepared on first use.

        Args:
            ui: Receives the results.
            make: Prepares the checks of a robot.
            seen: Called by the UI loop with each verdict on a state.
        """
        self._ui, self._make, self._seen = ui, make, seen
        self._checkers: dict[int, Checker] = {}
        self._failed: dict[int, tuple[Exception, float]] = {}
        self._live: dict[ShownRobot, LiveCheck] = {}
        self._lock = threading.Condition()
        self._states: dict[ShownRobot, tuple[RobotState, bool, RobotState | None]] = {}
        self._was_past: dict[ShownRobot, bool] = {}
        self._motions: dict[tuple[object, ShownRobot], _Request] = {}
        self.forces: dict[tuple[object, ShownRobot], ForceArrows | None] = {}
        """Contact forces of the motion that each owner had checked last."""
        self._newest: dict[tuple[object, ShownRobot], Motion] = {}
        threading.Thread(target=self._work, daemon=True).start()

    def check_motion(
        self,
        owner: object,
        robot: ShownRobot,
        motion: Motion,
        then: Callable[[Verdict], object],
        failed: Callable[[], object],
        scene: Scene | None = None,
    ) -> None:
        """Check a motion, unless another one of the owner and robot comes before.

        Args:
            owner: Who wants to know.
            robot: The robot of the motion.
            motion: The motion.
            then: Called by the UI loop with the verdict.
            failed: Called by the UI loop on errors.
            scene: The objects around the robot; None: there are none.
        """
        self.forces.pop((owner, robot), None)
        self._newest[owner, robot] = motion

        def find(checker: Checker) -> tuple[Verdict, ForceArrows | None]:
            verdict = (checker.among(scene) if scene else checker).check(motion)
            # Without what needs much memory.
            return replace(verdict, measured=None), force_arrows(verdict)

        def show(found: tuple[Verdict, ForceArrows | None]) -> None:
            verdict, forces = found
            if self._newest.get((owner, robot)) is motion:
                self.forces[owner, robot] = forces
            then(verdict)

        self.ask(owner, robot, find, show, failed)

    def ask(
        self,
        owner: object,
        robot: ShownRobot,
        find: Callable[[Checker], Found],
        then: Callable[[Found], object],
        failed: Callable[[], object],
    ) -> None:
        """Ask the checker of a robot, unless the owner asks again before.

        Args:
            owner: Who wants to know.
            robot: The robot.
            find: Given its checker, finds the answer.
            then: Called by the UI loop with the answer.
            failed: Called by the UI loop on errors.
        """
        with self._lock:
            self._motions[owner, robot] = find, then, failed
            self._lock.notify()

    def check_state(
        self,
        robot: ShownRobot,
        state: RobotState,
        past: bool = False,
        before: RobotState | None = None,
    ) -> None:
        """Check a state, unless another one arrives before.

        Args:
            robot: The robot.
            state: The state.
            past: Whether it does not follow the one that was checked last.
            before: A past one shortly before it, if there is one.
        """
        with self._lock:
            self._states[robot] = state, past, before
            self._lock.notify()

    def _work(self) -> None:
        """Check, one after the other."""
        while True:
            with self._lock:
                self._lock.wait_for(lambda: self._motions or self._states)
                motions, self._motions = self._motions, {}
                states, self._states = self._states, {}
            for key, (find, then, failed) in motions.items():
                self._try(partial(self._answer, key, find, then), failed)
            for robot, given in states.items():
                if not self._failure(robot):
                    self._try(partial(self._state, robot, *given))
                if self._failure(robot):
                    with self._lock:  # it may stand still until the next try
                        self._states.setdefault(robot, given)
            time.sleep(PERIOD)

    def _try(
        self, act: Callable[[], object], failed: Callable[[], object] = lambda: None
    ) -> None:
        """Run a check; errors are shown like those of user actions."""

        def attempt() -> None:
            try:
                act()
            except Exception:
                self._ui.post(object(), failed)
                raise

        self._ui.guarded(attempt)

    def _answer(
        self,
        key: tuple[object, ShownRobot],
        find: Callable[[Checker], Any],
        then: Callable[[Any], object],
    ) -> None:
        found = find(self._checker(key[1]))
        self._ui.post(("motion", *key), lambda: then(found))

    def _state(
        self,
        robot: ShownRobot,
        state: RobotState,
        past: bool,
        before: RobotState | None,
    ) -> None:
        if robot not in self._live:
            self._live[robot] = LiveCheck(self._checker(robot))
        live = self._live[robot]
        if past or self._was_past.get(robot):
            live.begin_again()
        self._was_past[robot] = past
        if before is not None:
            live.check(before)
        verdict = live.check(state)
        self._ui.post(("seen", robot), lambda: self._seen(robot, state, verdict))

    def _checker(self, robot: ShownRobot) -> Checker:
        """Prepare the checks of a robot, or of one like it."""
        number, failure = id(robot.description), self._failure(robot)
        if failure is not None:
            raise failure
        if number not in self._checkers:
            try:
                self._checkers[number] = self._make(robot.description)
            except Exception as error:
                self._failed[number] = error, time.monotonic() + AGAIN
                raise
        return self._checkers[number]

    def _failure(self, robot: ShownRobot) -> Exception | None:
        """Return the error of preparing checks, until the next attempt."""
        error, until = self._failed.get(id(robot.description), (None, 0.0))
        return error if time.monotonic() < until else None
