"""The page in a browser that draws in software, on a machine that is busy."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np

from .chromium import chromium
from .graph import MeasurementError, free_port, wait_for
from .html import MOTION, ROOT

SIZE = {"width": 1280, "height": 800}
TABS = ("View", "Motion")
TIMEOUT = 300.0  # [s] for anything
DARK = 90
"""The robot has colours below this, of 255, and nothing else in the scene has."""

HAS_ROBOT = f"""() => {{
  const canvas = document.querySelector("canvas[data-engine]");
  if (!canvas || canvas.width < 400) return false;
  const small = new OffscreenCanvas(64, 40).getContext("2d");
  small.drawImage(canvas, 0, 0, 64, 40);
  const {{ data }} = small.getImageData(0, 0, 64, 40);
  let dark = 0;
  for (let k = 0; k < data.length; k += 4) {{
    dark += data[k + 3] === 255 && data[k] < {DARK} && data[k + 1] < {DARK};
  }}
  return dark > 10 && performance.now();
}}"""
"""JavaScript that gives the time since navigation once the robot is drawn."""

FRAMES = """(time) => new Promise((done) => {
  const info = window.__viserTestpoints.rendererInfo.render;
  const before = info.frame, begin = performance.now();
  setTimeout(() => {
    done(1e3 * (info.frame - before) / (performance.now() - begin));
  }, time);
})"""
"""JavaScript that counts the pictures of some time."""


def browser(bench):
    """The page of `web --motion` in Chromium that draws in software.

    All cores are kept busy by other programs. From opening the page to the robot, for
    a click on a tab while the motion plays, and pictures per second meanwhile, in a
    window of 1280x800.
    """
    with bench.attempt("the page in a browser"):
        for busy in (False, True):
            cores = os.cpu_count() * busy
            with page_of_motion() as (address, _), burners(cores), chromium() as opened:
                measure(bench, opened, address, ", all cores busy" * busy)


def measure(bench, opened, address, when):
    """Open the page, play, and click on tabs."""
    first, clicks, frames = [], [], []
    for _ in range(bench.length(3, 1)):
        page = opened.new_page(viewport=SIZE)
        page.set_default_timeout(1e3 * TIMEOUT)
        page.goto(address, wait_until="commit")
        shown = page.wait_for_function(HAS_ROBOT, polling=100)
        first.append(shown.json_value() / 1e3)
        page.wait_for_timeout(2e3)
        button = page.get_by_role("button", name="Play", exact=True).bounding_box()
        page.mouse.click(button["x"] + 20, button["y"] + 10)
        frames.append(page.evaluate(FRAMES, 5e3))
        tabs = {n: page.get_by_role("tab", name=n).bounding_box() for n in TABS}
        for name in TABS * 2:
            begin = time.monotonic()
            page.mouse.click(tabs[name]["x"] + 20, tabs[name]["y"] + 10)
            page.get_by_role("tab", name=name, selected=True).wait_for()
            clicks.append(time.monotonic() - begin)
        page.close()
    bench.add(f"to the robot{when}, median", np.median(first), "s")
    bench.add(f"pictures while it plays{when}, median", np.median(frames), "Hz")
    bench.add_times(f"a click on a tab while it plays{when}", clicks)


@contextmanager
def page_of_motion(*options):
    """Run the command with further options; give its address and its process."""
    port = free_port()
    command = [sys.executable, str(ROOT / "scripts" / "web"), "--motion", str(MOTION)]
    with subprocess.Popen([*command, *options, "--port", str(port)]) as process:
        try:
            wait_for(lambda: is_open(port) or process.poll() is not None, "the page")
            if process.poll() is not None:
                raise MeasurementError("web has ended")
            yield f"http://127.0.0.1:{port}/", process.pid
        finally:
            process.terminate()


@contextmanager
def burners(count):
    """Keep cores busy."""
    command = [sys.executable, "-c", "while True: pass"]
    running = [subprocess.Popen(command) for _ in range(count)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def is_open(port):
    """Tell whether somebody listens."""
    with socket.socket() as caller:
        return not caller.connect_ex(("127.0.0.1", port))
