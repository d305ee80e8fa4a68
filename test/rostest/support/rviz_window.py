"""RViz on a screen of its own, and what is seen in its window."""

import contextlib
import os
import sys
import tempfile
import threading
from pathlib import Path
from unittest import mock

import numpy as np
import rospkg
import rospy

from .ros_testing import DEADLINE, REPOSITORY, Launch, wait_for, wait_slowly
from .virtual_screen import VirtualScreen, write_png

STARTS = 3
FRAME_RATE = "Frame Rate: 30"
"""In our configurations of RViz."""
BACKGROUND = (232, 236, 240)
COMPLAINTS = ((192, 32, 32), (192, 128, 0))
"""In which RViz writes the names of displays with errors, with warnings."""


def different(a, b):
    """Mark the pixels, shape (height, width), that clearly differ."""
    return np.abs(a.astype(int) - b).max(axis=2) > 10


def extent(mask):
    """Give the smallest slices of rows and columns that hold all that is marked."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return tuple(
        slice(i[0], i[-1] + 1) if i.size else slice(0, 0) for i in (rows, columns)
    )


def length(part):
    return part.stop - part.start


def view_of(picture):
    """Find the 3D view in a picture of the whole window.

    It is where rows and columns have much of its background; the panel that tells
    this colour has a bit of it as well.
    """
    mask = (picture == BACKGROUND).all(axis=2)
    much = [mask.sum(axis=axis, keepdims=True) > 100 for axis in (1, 0)]
    return extent(mask & much[0] & much[1])


def complaints_in(picture):
    """Count the pixels in colours that RViz has for errors and warnings only."""
    return sum((picture == colour).all(axis=2).sum() for colour in COMPLAINTS)


def seen_in(picture):
    """Put into words what may be wrong with a picture."""
    rows, columns = view_of(picture)
    size = f"a view of {length(columns)} x {length(rows)} pixels"
    return f"{size}, {complaints_in(picture)} pixels of complaints"


def dark(picture):
    """Mark the pixels of a robot's dark parts, such as head and feet."""
    return picture.max(axis=2) < 70


def has_view(picture):
    """Whether the window is there, with a large view."""
    rows, columns = view_of(picture)
    return length(rows) > 500 and length(columns) > 500


def is_calm(picture):
    """Whether the window is there, with a large view and no complaint."""
    return has_view(picture) and not complaints_in(picture)


def write_slower(config, folder):
    """Copy a configuration of ours with a lower frame rate: drawing costs processor.

    Returns:
        The copy.
    """
    text = (REPOSITORY / "rviz" / config).read_text()
    assert text.count(FRAME_RATE) == 1, config
    slower = Path(folder) / config
    slower.write_text(text.replace(FRAME_RATE, "Frame Rate: 5"))
    return slower


class RvizWindow:
    """A launch file's RViz; the parameter ~pictures says where pictures are kept."""

    def __init__(self, config, *launch):
        """Launch it.

        Args:
            config: Name of a configuration of this package.
            launch: A launch file of this package that takes `rvizconfig`, and more
                arguments.
        """
        with contextlib.ExitStack() as stack:
            self.screen = VirtualScreen(1200, 900)
            stack.callback(self.screen.stop)
            # RViz leaves its settings there.
            home = stack.enter_context(tempfile.TemporaryDirectory())
            environment = {
                "DISPLAY": self.screen.display,
                "HOME": home,
                "LIBGL_ALWAYS_SOFTWARE": "1",
                "ROS_LOG_DIR": rospkg.get_log_dir(),
                "XDG_RUNTIME_DIR": home,
            }
            file, *arguments = launch
            slower = f"rvizconfig:={write_slower(config, home)}"
            with mock.patch.dict(os.environ, environment):
                self._launch = self._start(file, slower, *arguments)
            stack.callback(self._launch.stop)
            self.view = None
            self._stack = stack.pop_all()

    def _start(self, *launch):
        """Launch RViz until it draws; on a busy machine it sometimes crashes before.

        Returns:
            The launch file that runs.
        """
        for _ in range(STARTS):
            running = Launch(*launch)
            try:
                if self._draws(running):
                    return running
            except AssertionError:
                running.stop()
                raise
            running.stop()
            print("RViz ended by itself before it drew anything.", file=sys.stderr)
        raise AssertionError(f"RViz ended by itself {STARTS} times")

    def _draws(self, launch):
        """Wait until RViz shows a view; tell whether it did not end before."""
        was_there = False

        def drawn_or_gone():
            nonlocal was_there
            is_there = "rviz" in launch.programs()
            is_gone, was_there = was_there and not is_there, is_there
            return is_gone or has_view(self.screen.picture())

        wait_slowly(drawn_or_gone, "RViz to draw a view")
        return has_view(self.screen.picture())

    def close(self):
        """End it, and remove its files."""
        self._stack.close()

    def picture_when(self, condition, what):
        """Wait for a picture that fulfils a condition and has come to rest."""
        pause = threading.Event()
        last = self.screen.picture()

        def fulfilled():
            nonlocal last
            before = last
            pause.wait(0.5)  # more than two frames
            last = self.screen.picture()
            at_rest = not different(before, last)[self.view or view_of(last)].any()
            return at_rest and condition(last)

        folder, name = Path(rospkg.get_test_results_dir()), "rviz_failure"
        try:
            wait_for(fulfilled, f"a picture of {what}", DEADLINE)
            folder, name = rospy.get_param("~pictures", ""), what.replace(" ", "_")
        except AssertionError as error:
            text = f"{error}; it shows {seen_in(last)}; see {name}.png in {folder}"
            if "rviz" not in self._launch.programs():
                text += "; RViz ended by itself"
            raise AssertionError(text) from None
        finally:
            if folder:
                write_png(Path(folder) / f"{name}.png", last)
        return last
