"""RViz on a virtual screen, at moments of a motion."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import numpy as np
from support.rviz_window import different, view_of
from support.virtual_screen import VirtualScreen

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "test"))

from ports import free_port  # noqa: E402

SIZE = (1200, 900)
PAUSE = 0.7
"""Between two pictures that are compared, in [s]: the checker takes some of it."""

LONGEST = 60.0
"""Longest wait for a picture that stays, and for RViz, in [s]."""


def rviz_views(file: Path, times: Sequence[float]) -> list[np.ndarray]:
    """Show moments of a motion in RViz, with what the checker finds.

    Args:
        file: The motion.
        times: In [s].

    Returns:
        Pictures of the 3D view, each shape (height, width, 3), uint8.
    """
    screen, port = VirtualScreen(*SIZE), free_port()
    with TemporaryDirectory() as home:
        changes = {
            "DISPLAY": screen.display,
            "HOME": home,
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "ROS_MASTER_URI": f"http://localhost:{port}",
            "XDG_RUNTIME_DIR": home,
        }
        words = ["display.launch", "rviz:=true", "checks:=true", "rate:=50"]
        command = ["roslaunch", "-p", str(port), "g1_description", *words]
        with mock.patch.dict(os.environ, changes):
            launch = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            try:
                return _views(screen, file, times)
            finally:
                launch.send_signal(signal.SIGINT)
                launch.wait()
                screen.stop()


def _views(
    screen: VirtualScreen, file: Path, times: Sequence[float]
) -> list[np.ndarray]:
    """Stream the moments to the robot, and copy the screen at each."""
    import rosgraph

    from g1_description import Robot, Stream
    from g1_description.motion.motion import sample

    _wait(rosgraph.is_master_online)
    robot = Robot()
    motion = robot.read_motion(file)
    views = []
    with Stream(rate=50.0, robot=robot, timeout=LONGEST) as stream:
        for time_of_frame in times:
            found = sample(motion, np.array([time_of_frame]))
            stream.send(
                dict(zip(motion.joint_names, found.positions[0])), found.base_poses[0]
            )
            views.append(_still_view(screen))
    return views


def _wait(condition) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + LONGEST
    while not condition():
        if time.monotonic() > deadline:
            raise SystemExit("RViz does not show the robot")
        time.sleep(PAUSE)


def _still_view(screen: VirtualScreen) -> np.ndarray:
    """Wait for a 3D view that stays as it is."""
    last = screen.picture()

    def is_still() -> bool:
        nonlocal last
        before, last = last, screen.picture()
        rows, columns = view_of(last)
        part = last[rows, columns]
        return part.size > 0 and not different(before[rows, columns], part).any()

    time.sleep(PAUSE)
    _wait(is_still)
    return last[view_of(last)]
