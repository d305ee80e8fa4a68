"""The threads of a page, none of which waits for another: drawing, calls, computing.

User actions arrive in threads of viser, and are run by the drawing thread; of several
values of a slider, only the newest is used. Services are called by the lane of calls,
one after another. Panels that compute, or read files, have lanes of their own.
"""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Callable

import numpy as np

from g1_description.errors import G1DescriptionError

if TYPE_CHECKING:
    from viser import ViserServer


LOG = logging.getLogger(__name__)

SHOWN = 8.0
"""How long a message stays, in [s]."""

AGAIN = 3.0
"""Least time between two messages of the same words, in [s]."""

HELD = 0.7
"""Time for which an edited element does not follow the robot, in [s]: states that
arrive meanwhile are older."""

ROUND_TRIP = 0.3
"""Longest time in [s] in which an update and an edit may cross on their ways."""


@dataclass(eq=False)
class Work:
    """Something that takes long."""

    pieces: Iterator[Any]
    then: Callable[[Any], object]
    """Gets the results, in the thread that draws."""

    key: Hashable
    is_off: bool = False
    """Whether the rest is not needed."""


class Lane:
    """A thread for long work; of one key, only the newest is done."""

    def __init__(self, ui: UiLoop) -> None:
        """Start the thread.

        Args:
            ui: Receives the results and the errors.
        """
        self._ui = ui
        self._newest: dict[Hashable, Work] = {}
        self._waiting: queue.Queue[Work] = queue.Queue()
        threading.Thread(target=self._work, daemon=True).start()

    def do(
        self,
        act: Callable[[], Any],
        then: Callable[[Any], object] = lambda _: None,
        key: Hashable = None,
    ) -> None:
        """Do something after the work that waits.

        Args:
            act: Returns a result.
            then: Called with the result by the thread that draws.
            key: Replaces what waits with the same key; None: nothing.
        """
        self.go_through(((act(),) for _ in "1"), lambda found: then(*found), key)

    def go_through(
        self,
        pieces: Iterator[Any],
        then: Callable[[Any], object],
        key: Hashable = None,
    ) -> None:
        """Do something in pieces, until there is something newer with its key.

        Args:
            pieces: Yields results; None: there is none yet.
            then: As for ``do``; of several results it may get the last one only.
            key: As for ``do``.
        """
        work = Work(pieces, then, object() if key is None else (id(self), key))
        if key is not None:
            before, self._newest[key] = self._newest.get(key), work
            if before is not None:
                before.is_off = True
        self._waiting.put(work)

    def cancel(self, key: Hashable) -> None:
        """Drop the work of a key, and its results."""
        work = self._newest.pop(key, None)
        if work is not None:
            work.is_off, work.then = True, lambda _: None

    @property
    def is_busy(self) -> bool:
        """Whether something is done, or waits."""
        return bool(self._waiting.unfinished_tasks)

    def _work(self) -> None:
        """Do one after the other."""
        while True:
            work = self._waiting.get()
            self._ui.guarded(partial(self._go, work))
            del work  # with all that it holds, while it waits for the next one
            self._waiting.task_done()
            self._ui.new.set()

    def _go(self, work: Work) -> None:
        if work.is_off:
            return
        for found in work.pieces:
            if found is not None:
                self._ui.post(work.key, partial(_hand_over, work, found))
            if work.is_off:
                return


def _hand_over(work: Work, found: Any) -> None:
    """Hand a result over, unless the work is cancelled by now."""
    work.then(found)


class Edits:
    """Distinguishes values that a person has set from those of the page.

    An element's ``update_timestamp`` is that of its last change, whoever made it.
    """

    def __init__(self) -> None:
        self._shown: dict[int, float] = {}
        """When the page last set a value, by identity of the element."""

    def is_held(self, handle: Any) -> bool:
        """Return whether an element was edited recently."""
        edited = handle.update_timestamp
        is_edited = edited != self._shown.get(id(handle))
        return is_edited and abs(time.time() - edited) < HELD

    def show(self, handle: Any, value: Any, tolerance: float = 0.0) -> None:
        """Show a value, if it differs and nobody edits it.

        A browser that sent a value may receive an older one afterwards, so an element
        that was edited just after an update is updated in any case. No other is, as
        that would undo what is being typed.

        Args:
            handle: The element.
            value: A number, several, or a text.
            tolerance: Smaller differences of numbers are ignored.
        """
        if self.is_held(handle):
            return
        key, edited = id(handle), handle.update_timestamp
        shown = self._shown.get(key, -math.inf)
        has_crossed = shown < edited < shown + ROUND_TRIP
        if _is_near(handle.value, value, tolerance):
            if not has_crossed or isinstance(value, str):
                return
            handle.value = np.add(value, 1.0)  # viser sends only changed values
        handle.value = value
        self._shown[key] = handle.update_timestamp


def _is_near(one: Any, other: Any, tolerance: float) -> bool:
    """Compare two values, whose numbers may differ a little."""
    if isinstance(other, str) or np.shape(one) != np.shape(other):
        return bool(one == other)
    return bool(np.abs(np.subtract(one, other)).max() <= tolerance)


class UiLoop:
    """Gathers the actions of people, and runs them."""

    def __init__(self, server: ViserServer, new: threading.Event) -> None:
        """Begin.

        Args:
            server: Shows errors in its browsers.
            new: Set when there is something to do for the thread that draws.
        """
        self.new = new
        self._server = server
        self._lock = threading.Lock()
        self._done: dict[Hashable, Callable[[], object]] = {}
        self._notified: dict[str, float] = {}
        self.edits = Edits()
        self.calls = Lane(self)
        """Calls services."""

    def on(self, handle: Any, act: Callable[[], object]) -> None:
        """Let something be done when a person uses an element of the page.

        Args:
            handle: The element: a button, or what has a value.
            act: What to do, by the thread that draws.
        """

        def came(event: Any) -> None:
            if event.client is None:  # we have set it ourselves
                return
            if getattr(event, "phase", "update") != "update":  # pressed, not dragged
                return
            options = getattr(handle, "options", None)
            if options and handle.value not in options:
                handle.value = options[0]  # no browser sends such
                return
            self.post(id(handle), act)

        attach = handle.on_click if hasattr(handle, "on_click") else handle.on_update
        attach(came)

    def post(self, key: Hashable, act: Callable[[], object]) -> None:
        """Let the thread that draws do something soon.

        Args:
            key: Of what; the newest with a key is done only.
            act: What to do.
        """
        with self._lock:
            self._done.pop(key, None)
            self._done[key] = act
        self.new.set()

    def do_all(self) -> None:
        """Run the posted actions; to be called by the thread that draws."""
        with self._lock:
            done, self._done = self._done, {}
        for act in done.values():
            self.guarded(act)

    def guarded(self, act: Callable[[], object]) -> None:
        """Do something; show people what went wrong."""
        try:
            act()
        except G1DescriptionError as error:
            self.notify(str(error), "red")
        except Exception:  # a mistake of ours: the page goes on, the log has it
            LOG.exception("A panel of the page failed")
            self.notify("Internal error; see the log.", "red")

    def notify(self, text: str, color: Any = "blue") -> None:
        """Show a message in all browsers for a while."""
        now = time.monotonic()
        newest = {t: at for t, at in self._notified.items() if now < at + AGAIN}
        if text in newest:
            return
        self._notified = {**newest, text: now}
        for client in self._server.get_clients().values():
            client.add_notification(
                "g1_description", text, auto_close_seconds=SHOWN, color=color
            )
