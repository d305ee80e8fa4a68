"""A page of viser in a browser: what it shows, and hands for it."""

from __future__ import annotations

import io
import re
import time
from pathlib import Path

import numpy as np
from PIL import Image

DEADLINE = 300.0
"""Longest wait for anything in [s]: many times what it takes on a busy machine."""
PANEL = "[data-floating-window], .mantine-Notifications-root { visibility: hidden }"
"""CSS that hides what floats over the scene."""


class Page:
    """One page. ``problems`` are the errors of its console and its scripts.

    Labels and names are those that viser was given. Elements in a closed folder or
    in a tab that is not in front are not on the page; actions wait for them.
    ``raw`` is Playwright's page, for whatever has no method here.
    """

    def __init__(self, window, address):
        """Load it."""
        self._window = window
        window.set_default_timeout(1000 * DEADLINE)
        self.problems = []
        self.raw = window.new_page()
        self.raw.on("console", self._note_line)
        self.raw.on("pageerror", lambda error: self.problems.append(str(error)))
        self.raw.on("crash", lambda _: self.problems.append("the page crashed"))
        self.raw.goto(address)

    def _note_line(self, line):
        if line.type == "error":
            self.problems.append(f"{line.text} ({line.location['url']})")

    def close(self):
        """Close it and its window."""
        self._window.close()

    def wait_for(self, condition, what, timeout=DEADLINE):
        """Wait until a condition gives something true; give that back.

        Args:
            condition: Called again and again, while the page lives on.
            what: Completes "waited in vain for".
            timeout: Longest wait in [s] of wall time.
        """
        end = time.monotonic() + timeout
        while True:
            begin = time.monotonic()
            result = condition()
            if result:
                return result
            if begin > end:
                break
            # Pictures take all the processor there is, which the page needs, too.
            pause = min(max(0.02, time.monotonic() - begin), 0.5)
            self.raw.wait_for_timeout(1000 * pause)  # Playwright hands on events
        raise AssertionError(f"waited {timeout} s in vain for {what}; {self.problems}")

    # --- what is read ---------------------------------------------------------

    def text(self):
        """Give the text that is seen, lines as on the page."""
        return self.raw.inner_text("body")

    def picture(self):
        """Show the whole window: uint8, shape (height, width, 3), RGB."""
        return _pixels(self.raw.screenshot(animations="disabled"))

    def scene(self):
        """Show the 3D canvas, without the panel over it, like `picture`."""
        self.canvas().wait_for()
        return _pixels(
            self.raw.screenshot(clip=self.canvas().bounding_box(), style=PANEL)
        )

    def canvas(self):
        """Find the 3D canvas."""
        return self.raw.locator("canvas[data-engine]").first

    def still(self, timeout=DEADLINE):
        """Give the first `scene` that has more than one colour and stays as it is."""
        shots = [None]

        def same():
            shots.append(self.scene())
            old, new = shots[-2:]
            return new.min() < new.max() and old is not None and (old == new).all()

        self.wait_for(same, "a picture that stays", timeout)
        return shots[-1]

    # --- hands ----------------------------------------------------------------

    def press(self, name):
        """Press a button by its text."""
        self.raw.get_by_role("button", name=name, exact=True).click()

    def open_tab(self, name):
        """Bring a tab to the front."""
        self.raw.get_by_role("tab", name=name, exact=True).click()

    def toggle_folder(self, name):
        """Open a folder of the panel, or close it."""
        self.raw.locator(".mantine-Paper-root .mantine-Paper-root").filter(
            has_text=_exactly(name)
        ).first.click()

    def element(self, label):
        """Find what stands beside a label: a Playwright locator.

        Viser gives most elements the id that the label is for, but not fields of text.
        """
        return (
            self.raw.locator("label")
            .filter(has_text=_exactly(label))
            .locator("xpath=../../following-sibling::*[1]")
        )

    def slider(self, label):
        """Find a `Slider`."""
        return Slider(self, self.element(label))

    def is_checked(self, label):
        """Tell whether a checkbox is checked."""
        return self.element(label).get_by_role("checkbox").is_checked()

    def check(self, label, checked=True):
        """Check a checkbox, or uncheck it."""
        self.element(label).get_by_role("checkbox").set_checked(checked)

    def field(self, label):
        """Find the first field to type in beside a label: a Playwright locator."""
        return self.element(label).locator("input, textarea").first

    def choose(self, label, option):
        """Choose from a list."""
        self.field(label).click()
        self.raw.get_by_role("option", name=option, exact=True).click()

    def dismiss(self):
        """Close all notices, such as that of drawing in software."""
        notices = self.raw.locator(".mantine-Notification-closeButton")
        while notices.count():
            # At once: one that closes itself meanwhile could not be clicked.
            notices.evaluate_all("all => all.forEach(button => button.click())")
            self.raw.wait_for_timeout(300)

    def drag(self, start, end, steps=10):
        """Drag the mouse from one point (x, y) in [px] to another."""
        self.raw.mouse.move(*start)
        self.raw.mouse.down()
        self.raw.mouse.move(*end, steps=steps)
        self.raw.mouse.up()

    def download(self, action, folder):
        """Do what makes the page save a file; give the path of the file in a folder."""
        with self.raw.expect_download() as download:
            action()
        path = Path(folder) / download.value.suggested_filename
        download.value.save_as(str(path))
        return path


class Slider:
    """A slider with the field beside it."""

    def __init__(self, page, cell):
        """Keep where it is; nothing is asked of the page yet."""
        self._page = page
        self._thumb = cell.get_by_role("slider")
        self._track = cell.locator(".mantine-Slider-trackContainer")
        self._field = cell.locator("input[inputmode]")

    def value(self):
        """Read the value that it stands at."""
        return float(self._thumb.get_attribute("aria-valuenow"))

    def limits(self):
        """Read its least and greatest value."""
        names = ("aria-valuemin", "aria-valuemax")
        return tuple(float(self._thumb.get_attribute(name)) for name in names)

    def shown(self):
        """Read what its field shows."""
        return self._field.input_value()

    def drag(self, value):
        """Drag it with the mouse as near to a value as the pixels allow."""
        lower, upper = self.limits()
        self._track.hover(trial=True)  # scrolls, and waits until it rests
        box, thumb = self._track.bounding_box(), self._thumb.bounding_box()
        y = box["y"] + box["height"] / 2
        start = thumb["x"] + thumb["width"] / 2
        end = box["x"] + box["width"] * (value - lower) / (upper - lower)
        self._page.drag((start, y), (end, y))

    def tap(self):
        """Touch its middle."""
        self._track.tap()

    def type(self, value):
        """Type a value into its field, as one who pastes it."""
        # In one go: viser takes each key for a value, and so -0 of -0.5 for 0. By hand,
        # as `fill` is lost where the page has changed the field since; and again where
        # it changes the field after the click, which marks the old text.
        typed = ""
        while typed != str(value):
            self._field.click(click_count=3)
            self._page.raw.keyboard.insert_text(str(value))
            typed = self._field.input_value()
        self._field.press("Enter")
        self._field.blur()


def _exactly(text):
    return re.compile(f"^{re.escape(text)}$")


def _pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
