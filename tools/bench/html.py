"""The page of a motion as one file: its size, and how soon a browser shows it."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from g1_description.motion.motion import sample
from g1_description.render.page import motion_page

from .chromium import chromium

ROOT = Path(__file__).resolve().parents[2]
MOTION = ROOT / "motions" / "faulty.csv"
SECONDS, RATE = 10.0, 50.0
FIRST = """() => new Promise((done) => requestAnimationFrame(() => setTimeout(() => {
  viewer.draw(1);
  viewer.scene.gl.readPixels(0, 0, 1, 1, 6408, 5121, new Uint8Array(4));
  done(performance.now());
})))"""
"""JavaScript that answers with the time since navigation once a picture is drawn."""

FRAMES = """(time) => new Promise((done) => {
  const draw = viewer.draw.bind(viewer);
  let count = 0;
  viewer.draw = (quality) => { count += 1; draw(quality); };
  viewer.play(true);
  setTimeout(() => { viewer.play(false); done((1000 * count) / time); }, time);
})"""
"""JavaScript that counts pictures per second while the motion plays."""


def html(bench):
    """The page of `check --html` for 10 s at 50 Hz, in Chromium that draws in software.

    From opening the file to its first picture, and pictures per second while it plays,
    in a window of 1280x800.
    """
    motion = _motion(bench.robot)
    verdict = bench.robot.check(motion)
    begin = time.monotonic()
    text = motion_page(bench.robot.description, motion, verdict, "faulty.csv")
    bench.add("written in", time.monotonic() - begin, "s")
    bench.add("size", len(text.encode()) / 1e6, "MB", "<= 6")
    with bench.attempt("browser"), TemporaryDirectory(prefix="bench_") as place:
        file = Path(place, "page.html")
        file.write_text(text, encoding="utf-8")
        with chromium() as browser:
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.set_default_timeout(120_000)
            first = []
            for _ in range(bench.length(5, 2)):
                page.goto("about:blank")
                page.goto(file.as_uri())
                first.append(page.evaluate(FIRST) / 1e3)
            bench.add("to the first picture, median", np.median(first), "s", "<= 3")
            bench.add("pictures while it plays", page.evaluate(FRAMES, 4000), "Hz")


def _motion(robot):
    """Stretch a motion of the package to 10 s at 50 Hz."""
    motion = robot.read_motion(MOTION)
    times = np.arange(int(SECONDS * RATE) + 1) / RATE
    now = sample(motion, np.minimum(times * motion.duration / SECONDS, motion.duration))
    return replace(
        motion,
        times=times,
        positions=now.positions,
        velocities=None,
        base_poses=now.base_poses,
    )
