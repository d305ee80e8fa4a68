"""Whether time runs, and who waits for steps that pass while it stands still."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass


@dataclass
class _Waiting:
    """Somebody who waits for steps to pass."""

    answer: Future
    steps: int
    respond: Callable
    """Makes the response: takes success and a sentence."""

    done: int = 0


class Stepper:
    """Requests for steps, served one after the other."""

    def __init__(self, paused: bool) -> None:
        """Begin.

        Args:
            paused: Whether time stands still at first.
        """
        self.paused = paused
        self._waiting: deque[_Waiting] = deque()

    @property
    def is_stepping(self) -> bool:
        """Whether steps were requested that have not passed yet."""
        return bool(self._waiting)

    @property
    def is_last_step(self) -> bool:
        """Whether the next step is the last of a request."""
        return bool(self._waiting) and self._waiting[0].steps == (
            self._waiting[0].done + 1
        )

    def request(self, steps: int, respond: Callable) -> Future:
        """Request steps.

        Args:
            steps: How many, at least one.
            respond: Makes the response when they have passed or will not: takes
                success and a sentence.

        Returns:
            The response to come.
        """
        answer: Future = Future()
        self._waiting.append(_Waiting(answer, steps, respond))
        return answer

    def count(self) -> None:
        """Note that a step has passed, and answer who has waited for it."""
        if not self._waiting:
            return
        first = self._waiting[0]
        first.done += 1
        if first.done == first.steps:
            self._waiting.popleft()
            first.answer.set_result(first.respond(True, f"{first.steps} steps done"))

    def end(self, reason: str) -> None:
        """Answer those who wait for steps that will not pass."""
        while self._waiting:
            one = self._waiting.popleft()
            outcome = f"ended by {reason} after {one.done} of {one.steps} steps"
            one.answer.set_result(one.respond(False, outcome))

    def cancel(self) -> None:
        """Let nobody wait any more, without a response."""
        while self._waiting:
            self._waiting.popleft().answer.cancel()
