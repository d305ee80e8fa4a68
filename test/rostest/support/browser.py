"""A real browser without a screen.

Chromium draws in software. It and Playwright's driver end with this process,
however that ends: both hang on pipes that it holds.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import shutil
import signal
import threading

from .browser_page import DEADLINE, Page

PHONE = (390, 844)
"""Size of a phone's screen in [px]."""
PROGRAMS = ("chromium", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--no-sandbox",  # root has none
    "--ignore-gpu-blocklist",
    "--use-angle=gl-egl",  # Mesa draws in half the time that SwiftShader needs
    "--enable-unsafe-swiftshader",  # where there is no Mesa
    "--disable-dev-shm-usage",  # a container's /dev/shm is small
)

JAGGED = """
const make = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return make.call(this, kind, {...options, antialias: false});
};
"""
"""JavaScript for a page that draws without antialiasing: half the work in software."""


def missing():
    """Say what is missing to run a browser; nothing if nothing is."""
    if importlib.util.find_spec("playwright") is None:
        return "playwright is not installed"
    if _program() is None:
        return "Chromium is not installed"
    return ""


def _program():
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Browser:
    """Chromium, for as long as the context lasts; used by the thread that made it."""

    def __init__(self):
        """Start it."""
        from playwright.sync_api import sync_playwright

        with contextlib.ExitStack() as stack:
            driver = stack.enter_context(sync_playwright())
            self._browser = driver.chromium.launch(
                executable_path=_program(),
                args=list(FLAGS),
                handle_sigint=False,  # the test closes it
                timeout=1000 * DEADLINE,
            )
            stack.callback(self._browser.close)
            self._stack = stack.pop_all()

    def __enter__(self):
        """Give itself."""
        return self

    def __exit__(self, kind, *_):
        """End it."""
        self.close(is_interrupted=kind is KeyboardInterrupt)

    def close(self, is_interrupted=False):
        """End it, and remove its files."""
        if is_interrupted or self._browser._dispatcher_fiber.dead:
            # Ctrl-C tore Playwright's loop: it would wait for answers for ever.
            self._stack.pop_all()
            driver = self._browser._impl_obj._connection._transport._proc
            driver.stdin.get_extra_info("pipe").close()  # it closes Chromium and ends
            last = threading.Timer(DEADLINE, os.kill, (driver.pid, signal.SIGKILL))
            last.start()
            with contextlib.suppress(ChildProcessError):  # its end was seen elsewhere
                os.waitid(os.P_PID, driver.pid, os.WEXITED | os.WNOWAIT)
            last.cancel()
        else:
            self._stack.close()

    def open(self, address, size=(1280, 800), phone=False, script=""):
        """Open a page in a window with its own cookies; give its `Page`.

        Args:
            address: Of the page, with http:// and all.
            size: Width and height in [px], if it is not a phone.
            phone: Whether it is a phone, with a touch screen.
            script: JavaScript that runs in the page before its own.
        """
        width, height = PHONE if phone else size
        window = self._browser.new_context(
            viewport={"width": width, "height": height},
            is_mobile=phone,
            has_touch=phone,
        )
        if script:
            window.add_init_script(script)
        return Page(window, address)
