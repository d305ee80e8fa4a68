"""What Chromium shows of a page, and when; for the part ``browser``."""

import re
import sys
import time
from contextlib import contextmanager
from pathlib import Path

from websockets.exceptions import WebSocketException

from .nodes import MeasurementError, wait_for

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1] / "test" / "ros"))
from support.browser import Browser, missing  # noqa: E402

PROBE = HERE / "probe.js"
QUIET = 0.5
"""Time without a change, in [s], after which a page is at rest; and three frames."""
AT_ONCE = 40
"""Pixels of the probe's 64000 that an arm changes at least."""
NEAR = 0.002  # [rad] the slider's step and a bit
FINISHED = 4.0  # [s] without a new picture, after which there will be none
TIMEOUT = 300.0  # [s]
PAUSE = 20  # [ms] between two questions to a page


@contextmanager
def pages_told():
    """Tell of pages that fail as of all that can't be measured."""
    failures = (AssertionError, WebSocketException)
    if not missing():
        from playwright.sync_api import Error

        failures = (*failures, Error)
    try:
        yield
    except failures as error:
        raise MeasurementError(str(error).splitlines()[0]) from error


def check_installed():
    """Make sure that there is a browser.

    Raises:
        MeasurementError: If there is none.
    """
    if missing():
        raise MeasurementError(missing())


class WatchedPage:
    """A page whose drawing is watched; times are those of ``time.monotonic``."""

    def __init__(self, browser, address, size):
        """Open it; the resolution of the scene stays as it is.

        Args:
            browser: The ``Browser``.
            address: Of the page.
            size: Width and height in [px].
        """
        self.opened = time.monotonic()
        script = PROBE.read_text(encoding="utf-8")
        self.page = browser.open(f"{address}?fixedDpr=1", size, script=script)
        self._offset, self.clock_error = self._clock()

    def _clock(self):
        """Find what to add to the page's times, and its largest error, in [s]."""
        offsets = []
        for _ in range(20):
            begin = time.monotonic()
            told = 1e-3 * self.ask("performance.now()")
            end = time.monotonic()
            offsets.append((end - begin, 0.5 * (begin + end) - told))
        width, offset = min(offsets)
        return offset, 0.5 * width

    def ask(self, script, argument=None):
        """Evaluate JavaScript in the page."""
        return self.page.raw.evaluate(script, argument)

    def wait_for(self, script, argument=None, what="the page"):
        """Wait until JavaScript gives something; give that back."""
        end = time.monotonic() + TIMEOUT
        while time.monotonic() < end:
            found = self.ask(script, argument)
            if found is not None and found is not False:
                return found
            self.page.raw.wait_for_timeout(PAUSE)
        raise MeasurementError(f"waited {TIMEOUT:.0f} s in vain for {what}")

    def time_of(self, script, argument=None, what="the page"):
        """Wait until JavaScript gives a time of the page's; give that in [s]."""
        return self.at(self.wait_for(script, argument, what))

    def at(self, moment):
        """Give the time in [s] of a time of the page's in [ms]."""
        return 1e-3 * moment + self._offset

    def rest(self):
        """Wait until nothing changes for a while, and forget what did."""
        self.wait_for(f"g1probe.rests({1e3 * QUIET})", what="a picture that stays")
        self.ask("g1probe.forget()")

    def finish(self):
        """Wait until all has been drawn."""
        last = [0, time.monotonic()]

        def finished():
            count, frames = self.ask("[g1probe.shots.length, g1probe.frames]")
            if count != last[0]:
                last[:] = count, time.monotonic()
            return frames > 2 and time.monotonic() > last[1] + FINISHED

        wait_for(finished, "a whole picture")


def seen_in_page(bench, address, size, link, commands):
    """Send commands, one after the other, and wait until a page shows each.

    Args:
        bench: What is measured.
        address: Of the page.
        size: Of the window in [px].
        link: Words in the panel: the folder and the slider.
        commands: Iterable of functions that send a command, and its value in [rad].

    Returns:
        From command to scene, and from command to slider, each in [s].
    """
    folder, label = link
    scene, slider = [], []
    with Browser() as browser:
        page = WatchedPage(browser, address, size)
        page.page.toggle_folder(folder)
        thumb = page.page.element(label).get_by_role("slider")
        thumb.evaluate("thumb => g1probe.watch(thumb)")
        for send, value in commands:
            page.rest()
            begin = send()
            changed = f"g1probe.changed({AT_ONCE})"
            scene.append(page.time_of(changed, what="a scene") - begin)
            turned = f"g1probe.turned({value}, {NEAR})"
            slider.append(page.time_of(turned, what="a slider") - begin)
        bench.say(f"problems of the page: {page.page.problems or 'none'}")
    return scene, slider


def first_pictures(address, size, runs):
    """Open a page in a fresh browser, again and again.

    Returns:
        Times in [s] from opening to the first picture with the robot.
    """
    times = []
    for _ in range(runs):
        with Browser() as browser:
            times.append(_first_picture(browser, address, size))
    return times


def _first_picture(browser, address, size):
    """Time one opening."""
    page = WatchedPage(browser, address, size)
    page.finish()
    page.ask("g1probe.keep('whole')")
    page.page.open_tab("View")
    page.page.check("Visual shapes", False)
    page.finish()
    page.ask("g1probe.keep('empty')")
    seen, pixels = page.ask("g1probe.seen('whole', 'empty')")
    page.page.check("Visual shapes", True)
    page.finish()
    if seen is None or pixels < 10 * AT_ONCE:
        raise MeasurementError(f"no robot was seen ({pixels} pixels of it)")
    return page.at(seen) - page.opened


def address_of(program):
    """Wait for the address that a program prints."""

    def printed():
        program.check()
        return re.search(r"open (http://\S+)", program.output())

    return wait_for(printed, "an address")[1]
