"""The page with a house around the robot, and with boxes that move."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from g1_description import Scene

from .browser import FRAMES, HAS_ROBOT, SIZE, TIMEOUT, page_of_motion
from .chromium import chromium
from .graph import Process

MODELS, PARTS, BOXES = 60, 6, 100
"""Models of the house, shapes of each, and boxes that the robot carries about."""

MESHES = Path(__file__).resolve().parents[2] / "meshes"


def objects(bench):
    """The page of a motion with and without objects, in a Chromium without a GPU.

    The objects are a house of 60 models, of which each has six shapes and a mesh, and
    100 boxes that move with the hands. Times are from opening the page to the robot;
    pictures are counted while the motion plays, in a window of 1280x800.
    """
    with TemporaryDirectory(prefix="bench_") as place, bench.attempt("the browser"):
        for name, scene in (("none", Scene()), ("house and boxes", house())):
            file = Path(place, "scene.yaml")
            scene.save(file)
            with page_of_motion("--scene", str(file)) as (address, pid):
                with chromium() as opened:
                    measure(bench, opened, address, name)
                bench.add(f"{name}: memory of web", Process(pid).memory(), "MB")


def measure(bench, opened, address, name):
    """Open the page, and play."""
    page = opened.new_page(viewport=SIZE)
    page.set_default_timeout(1e3 * TIMEOUT)
    page.goto(address, wait_until="commit")
    shown = page.wait_for_function(HAS_ROBOT, polling=100)
    bench.add(f"{name}: to the robot", shown.json_value() / 1e3, "s")
    page.wait_for_timeout(5e3)
    heap = page.evaluate("performance.memory.usedJSHeapSize")
    bench.add(f"{name}: memory of the page's scripts", heap / 1e6, "MB")
    bench.add(f"{name}: pictures at rest", page.evaluate(FRAMES, 5e3), "Hz")
    button = page.get_by_role("button", name="Play", exact=True).bounding_box()
    page.mouse.click(button["x"] + 20, button["y"] + 10)
    bench.add(f"{name}: pictures while it plays", page.evaluate(FRAMES, 5e3), "Hz")


def house():
    """Make a scene of models around the robot, and boxes in its hands."""
    rng = np.random.default_rng(1)
    scene, up = Scene(), np.array([0.0, 0.0, 0.8])
    meshes = sorted(MESHES.glob("*.stl"), key=lambda path: path.stat().st_size)[:8]
    for number in range(MODELS):
        angle = 2 * np.pi * number / MODELS
        at = 3.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
        for part in range(PARTS):
            size = rng.uniform(0.05, 0.4, 3)
            place = at + rng.uniform(-0.3, 0.3, 3) + [0, 0, 0.3]
            scene.box(f"model_{number}_{part}", size, place, color=rng.uniform(0, 1, 3))
        scene.mesh(f"model_{number}", meshes[number % len(meshes)], at + up)
    for number in range(BOXES):
        place = rng.uniform((-0.2, -0.5, 0.7), (0.8, 0.5, 1.7))
        scene.box(f"box_{number}", [0.05, 0.05, 0.05], place, mass=0.1)
        scene.attach(f"box_{number}", ("left_hand", "right_hand")[number % 2])
    return scene
