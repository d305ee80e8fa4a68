"""The pictures: what is opened, what is done on the page, and how it is kept."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import numpy as np
from PIL import Image
from support.browser import Browser
from support.browser_page import Page
from support.pages import opened_page

from .rviz import free_port, rviz_views

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
WEB = SCRIPTS / "web"

SHADES = 8
"""What colours are rounded to, of 256: files are half as large, and nobody sees it."""

START, ASIDE = (500, 750), 170
"""A point of the floor, and how far it is moved to the left, in [px]: the panel would
hide labels."""

TITLE = "g1_29dof"
"""What the panel's head says; it folds the panel."""

FOREARM = (452, 365), (475, 510)
"""Where the left forearm of the standing robot is in the picture, and where it is
dragged, in [px]."""

GAP, GREY = 24, 208
"""Between two pictures, in [px], and its colour."""

TIMEOUT = 300.0
"""Longest wait for a picture that stays, in [s]: without a GPU it takes long."""


@dataclass(frozen=True)
class Shot:
    """One picture."""

    file: str
    options: Sequence[str]
    """Of the command; names of motions are those of files in its folder."""

    act: Callable[[Page], None]
    """What is done on the page before."""

    phone: bool = False
    """Whether it is of a phone: with the panel folded, and open."""

    live: bool = False
    """Whether the page is of the display, which has a ROS master of its own."""

    times: Sequence[float] = ()
    """Times of the motion in [s] that an animation shows; empty: a picture."""


def _robot(page: Page) -> None:
    """Lift both arms, one with its sliders."""
    page.press("wave")
    page.open_tab("Left arm")
    page.slider("left_shoulder_pitch").type(-1.1)
    page.slider("left_elbow").type(0.3)


def _reach(page: Page) -> None:
    """Drag the left forearm to the floor with the mouse, between two keyframes."""
    page.toggle_folder("Reach")
    page.toggle_folder("Keyframes")
    page.press("Reset")
    page.still(TIMEOUT)
    page.raw.keyboard.press("k")
    page.raw.keyboard.press("g")
    page.still(TIMEOUT)
    mouse, ((x, y), (to_x, to_y)) = page.raw.mouse, FOREARM
    mouse.move(x, y)
    mouse.down()
    for share in np.linspace(0.1, 1.0, 10):
        mouse.move(x + share * (to_x - x), y + share * (to_y - y))
        page.still(TIMEOUT)
    mouse.up()
    page.raw.keyboard.press("k")
    page.still(TIMEOUT)


def _motion(page: Page) -> None:
    """Go to the first of the findings."""
    page.open_tab("Motion")
    _wait_for_findings(page, 1)
    page.raw.get_by_role("button", name="self collision").first.click()


def _history(page: Page) -> None:
    """Play a motion with faults, rewind to one of them, and check what was played."""
    play = [sys.executable, str(SCRIPTS / "play"), "faulty.csv"]
    motions = SCRIPTS.parent / "motions"
    subprocess.run(play, cwd=motions, check=True, stderr=subprocess.DEVNULL)
    page.open_tab("History")
    page.choose("Last seconds", "30")
    page.press("Check this range")
    _wait_for_findings(page, 1)
    page.raw.get_by_role("button", name="self collision").first.click()
    page.wait_for(lambda: "Past:" in page.text(), "the past")


def _folder(page: Page) -> None:
    """Open the second motion, and exclude it."""
    page.press("Next")
    page.press("Exclude")
    page.wait_for(lambda: "1 excluded" in page.text(), "the choice")
    page.open_tab("Motion")
    _wait_for_findings(page, 1)
    page.slider("Time").type(0.8)
    page.open_tab("Folder")


def _compare(page: Page) -> None:
    """Show the middle of two motions."""
    page.open_tab("Motion")
    _wait_for_findings(page, 2)
    page.slider("Time").type(1.0)


def _wait_for_findings(page: Page, count: int) -> None:
    """Wait until motions are judged."""

    def is_judged() -> bool:
        text = page.text()
        return text.count("Findings:") == count and "Being checked" not in text

    page.wait_for(is_judged, "the findings")


SHOTS = {
    "animation": Shot(
        "browser.gif",
        ("--motion", "faulty.csv"),
        _motion,
        times=tuple(np.arange(1.0, 3.6, 0.1)),
    ),
    "robot": Shot("browser.png", (), _robot),
    "reach": Shot("browser_reach.png", (), _reach),
    "history": Shot("browser_history.png", (), _history, live=True),
    "motion": Shot("browser_motion.png", ("--motion", "faulty.csv"), _motion),
    "compare": Shot(
        "browser_compare.png", ("--compare", "squat.csv", "faulty.csv"), _compare
    ),
    "folder": Shot("browser_folder.png", ("motions",), _folder),
    "phone": Shot("browser_phone.png", ("--motion", "faulty.csv"), _motion, phone=True),
}


def take(browser: Browser, shot: Shot, folder: Path, file: Path) -> None:
    """Take a picture.

    Args:
        browser: The browser.
        shot: Which.
        folder: Where the motions are.
        file: Where the picture goes.
    """
    views = rviz_views(folder / shot.options[-1], shot.times) if shot.times else []
    served = _displayed() if shot.live else _served(shot.options, folder)
    with served as address:
        page = browser.open(f"{address}?fixedDpr=1", phone=shot.phone)
        page.still(TIMEOUT)
        page.dismiss()
        if not shot.phone:
            _move_aside(page)
        else:  # which starts with a folded panel
            page.raw.get_by_text(TITLE).first.click()
        shot.act(page)
        page.raw.mouse.move(1, 1)
        page.still(TIMEOUT)
        if shot.times:
            _animate(page, shot.times, views, file)
            page.close()
            return
        pictures = [page.picture()]
        if shot.phone:
            pictures.insert(0, _folded(page))
        page.close()
    _rounded(_beside(pictures)).save(file, optimize=True)


def _animate(
    page: Page, times: Sequence[float], views: Sequence[np.ndarray], file: Path
) -> None:
    """Write an animation of the page at half its size, with RViz beside it."""
    frames = []
    for time, view in zip(times, views):
        page.slider("Time").type(round(float(time), 3))
        page.still(TIMEOUT)
        picture = Image.fromarray(page.picture())
        half = picture.resize((picture.width // 2, picture.height // 2))
        beside, height = Image.fromarray(view), half.height
        beside = beside.resize((height * beside.width // beside.height, height))
        frames.append(Image.new("RGB", (half.width + 2 + beside.width, height)))
        frames[-1].paste(half, (0, 0))
        frames[-1].paste(beside, (half.width + 2, 0))
    all_frames = np.concatenate([np.asarray(frame)[::2] for frame in frames])
    colors = Image.fromarray(all_frames).quantize(256)
    first, *others = [frame.quantize(palette=colors, dither=0) for frame in frames]
    first.save(file, save_all=True, append_images=others, duration=100, loop=0)


def _move_aside(page: Page) -> None:
    """Drag the view to the left with the right button."""
    mouse, (x, y) = page.raw.mouse, START
    mouse.move(x, y)
    mouse.down(button="right")
    mouse.move(x - ASIDE, y, steps=10)
    mouse.up(button="right")


def _rounded(pixels: np.ndarray) -> Image.Image:
    """Make a picture of few colours."""
    near = (pixels.astype(int) + SHADES // 2) // SHADES * SHADES
    return Image.fromarray(near.clip(0, 255).astype(np.uint8)).quantize(256)


def _folded(page: Page) -> np.ndarray:
    """Fold the panel, and show the page."""
    page.raw.get_by_text(TITLE).first.click()
    page.still(TIMEOUT)
    return page.picture()


def _beside(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Put pictures of one height beside each other, with a gap."""
    gap = np.full((pictures[0].shape[0], GAP, 3), GREY, np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)]
    return np.concatenate(parts[1:], axis=1)


@contextmanager
def _displayed() -> Iterator[str]:
    """Launch the display and its page, with a master of their own; give the address."""
    port = str(free_port())
    master = {"ROS_MASTER_URI": f"http://localhost:{port}"}
    with TemporaryDirectory() as home, mock.patch.dict(os.environ, master):
        launch = subprocess.Popen(
            [
                "roslaunch",
                "-p",
                port,
                "g1_description",
                "display.launch",
                "rviz:=false",
            ],
            stdout=subprocess.DEVNULL,
        )
        try:
            with opened_page(home) as address:
                yield address
        finally:
            launch.send_signal(signal.SIGINT)
            launch.wait()


@contextmanager
def _served(options: Sequence[str], folder: Path) -> Iterator[str]:
    """Run the command; give its address."""
    command = [sys.executable, str(WEB), "--port", "0", *options]
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, encoding="utf-8"
    )
    try:
        line = process.stdout.readline()
        if "http://" not in line:
            raise SystemExit(f"the page did not open: {line}")
        yield line.split()[-1]
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()
