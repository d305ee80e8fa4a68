"""What clients ask of the world: done in the node's loop, or read beside it."""

from __future__ import annotations

import contextlib
import queue
import threading
from concurrent.futures import CancelledError, Future
from functools import partial

import rospy

MAX_PENDING = 100
"""Pending calls above which a subscriber's thread waits for its message's turn."""


class Calls:
    """Callbacks of rospy, which run in its threads, and the calls that they queue.

    Only the loop changes the world. Others read it while they hold its lock: they do
    not wait for the step under way, but for a command that is being obeyed.
    """

    def __init__(self, lock: threading.Lock) -> None:
        """Begin without any.

        Args:
            lock: Held while the world changes.
        """
        self._lock = lock
        # Not a SimpleQueue: a signal during its get() can make it wait for ever.
        self._queue: queue.Queue = queue.Queue()
        self._is_over = False

    def serve(self, name: str, answer, *prepare):
        """Make the callback of a service: one that reads does not need the loop.

        Args:
            name: The service's; those that read begin with ``get_``.
            answer: What answers.
            prepare: What is done with the request before, while time runs on.
        """
        make = self._beside_the_loop if name.startswith("get_") else self.in_the_loop
        return make(answer, *prepare)

    def _beside_the_loop(self, answer):
        """Make a callback that answers at once, from the state after the last step.

        A robot that lies keeps the loop busy all the time.
        """

        def handler(request):
            with self._lock:
                return answer(request)

        return handler

    def in_the_loop(self, answer, prepare=None):
        """Make a callback that lets the loop answer, and waits for it.

        Args:
            answer: What answers, in the loop.
            prepare: What is done with the request before, while time runs on.
        """

        def handler(request):
            if prepare:
                request = prepare(request)
            call: Future = Future()
            self._queue.put((call, answer, request))
            if self._is_over:
                self.cancel()
            try:
                return call.result()
            except CancelledError:
                raise rospy.ServiceException("the simulator is shutting down") from None

        return handler

    def later_in_the_loop(self, act):
        """Make a callback that lets the loop act, and waits only where much waits.

        To wait each time would let messages pile up on a busy machine, where it takes
        the loop long to get its turn.
        """

        def callback(message):
            call: Future = Future()
            call.add_done_callback(_log_failure)
            self._queue.put((call, act, message))
            if self._queue.qsize() > MAX_PENDING:
                with contextlib.suppress(CancelledError):
                    call.result()

        return callback

    def __len__(self) -> int:
        """Count those that wait for the loop."""
        return self._queue.qsize()

    def answer(self, wait: float) -> bool:
        """Wait for a call and answer it, if one comes; only the loop does.

        Args:
            wait: Longest wait in [s].

        Returns:
            Whether one came.
        """
        try:
            call, answer, request = self._queue.get(wait > 0.0, wait)
        except queue.Empty:
            return False
        try:
            with self._lock:
                result = answer(request)
        except BaseException as error:  # the caller's thread raises it again
            call.set_exception(error)
        else:
            if isinstance(result, Future):
                result.add_done_callback(partial(_hand_on, call))
            else:
                call.set_result(result)
        return True

    def cancel(self) -> None:
        """Cancel all calls, also those to come; nobody answers any more."""
        self._is_over = True
        with contextlib.suppress(queue.Empty):
            while True:
                self._queue.get_nowait()[0].cancel()


def _hand_on(call: Future, result: Future) -> None:
    """Answer a call with what has come later."""
    if result.cancelled():
        call.cancel()
    elif result.exception():
        call.set_exception(result.exception())
    else:
        call.set_result(result.result())


def _log_failure(call: Future) -> None:
    """Log the exception of a call that nobody waits for."""
    if not call.cancelled() and call.exception() is not None:
        rospy.logerr("A message could not be obeyed: %r", call.exception())
