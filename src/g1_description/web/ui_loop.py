"""The threads of a page: one draws, another one makes blocking calls.

User actions arrive in threads of viser, and are run by the drawing thread; of several
values of a slider, only the newest is used. Blocking calls, of services or for files,
are made by the other thread, one after another.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Hashable
from functools import partial
from typing import TYPE_CHECKING, Any, Callable, Tuple

from g1_description.errors import G1DescriptionError

if TYPE_CHECKING:
    from viser import ViserServer


LOG = logging.getLogger(__name__)

SHOWN = 8.0
"""How long a message stays, in [s]."""

AGAIN = 3.0
"""Least time between two messages of the same words, in [s]."""

Work = Tuple[Callable[[], object], Callable[[Any], object]]
"""What is to be done, and what its result is given to."""


class UiLoop:
    """Gathers what a person does, and hands it out."""

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
        self._told: dict[str, float] = {}
        self._waiting: queue.Queue[Work] = queue.Queue()
        threading.Thread(target=self._work, daemon=True).start()

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
        """Do what was posted; to be called by the thread that draws."""
        with self._lock:
            done, self._done = self._done, {}
        for act in done.values():
            self.guarded(act)

    def wait_for(
        self, act: Callable[[], Any], then: Callable[[Any], object] = lambda _: None
    ) -> None:
        """Let the thread that waits do something.

        Args:
            act: What may take long.
            then: Given its result, by the thread that draws.
        """
        self._waiting.put((act, then))

    @property
    def is_busy(self) -> bool:
        """Whether something is waited for, or waits."""
        return bool(self._waiting.unfinished_tasks)

    def _work(self) -> None:
        """Do what may take long, one after the other."""
        while True:
            act, then = self._waiting.get()
            self.guarded(partial(self._hand_back, act, then))
            self._waiting.task_done()
            self.new.set()

    def _hand_back(self, act: Callable[[], Any], then: Callable[[Any], object]) -> None:
        result = act()
        self.post(object(), lambda: then(result))

    def guarded(self, act: Callable[[], object]) -> None:
        """Do something; tell people what went wrong."""
        try:
            act()
        except G1DescriptionError as error:
            self.tell(str(error), "red")
        except Exception:  # a mistake of ours: the page goes on, the log has it
            LOG.exception("A panel of the page failed")
            self.tell("Internal error; see the log.", "red")

    def tell(self, text: str, color: Any = "blue") -> None:
        """Show a message in all browsers for a while."""
        now = time.monotonic()
        if now < self._told.get(text, -AGAIN) + AGAIN:
            return
        self._told = {t: when for t, when in self._told.items() if now < when + AGAIN}
        self._told[text] = now
        for client in self._server.get_clients().values():
            client.add_notification(
                "g1_description", text, auto_close_seconds=SHOWN, color=color
            )


class Newest:
    """Lets the thread that waits do the newest of several things; others are dropped.

    Such as to show the times of a slider that is dragged.
    """

    def __init__(self, ui: UiLoop) -> None:
        self._ui = ui
        self._lock = threading.Lock()
        self._act: Callable[[], object] | None = None
        self._is_busy = False

    def wait_for(self, act: Callable[[], object]) -> None:
        """Let it be done soon."""
        with self._lock:
            self._act = act
            if self._is_busy:
                return
            self._is_busy = True
        self._ui.wait_for(self._do)

    def _do(self) -> None:
        """Do the newest; what came meanwhile waits behind what others wait for."""
        with self._lock:
            act, self._act = self._act, None
        try:
            if act is not None:
                act()
        finally:
            with self._lock:
                self._is_busy = self._act is not None
            if self._is_busy:
                self._ui.wait_for(self._do)
