"""Chromium that draws in software."""

from __future__ import annotations

import shutil
from contextlib import contextmanager

from .graph import MeasurementError

FLAGS = ("--no-sandbox", "--use-gl=swiftshader", "--enable-unsafe-swiftshader")


@contextmanager
def chromium():
    """Start a browser of Playwright's, and close it.

    Raises:
        MeasurementError: If there is none.
    """
    try:
        from playwright.sync_api import sync_playwright
    except ImportError as error:
        raise MeasurementError(f"no browser: {error}") from error
    with sync_playwright() as driver:
        program = shutil.which("chromium") or shutil.which("google-chrome")
        browser = driver.chromium.launch(executable_path=program, args=[*FLAGS])
        try:
            yield browser
        finally:
            browser.close()
