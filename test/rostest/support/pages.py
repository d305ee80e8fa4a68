"""The page of the robot that runs, as a launch file starts it."""

import os
import re
import signal
import subprocess
import threading
from contextlib import contextmanager

from support.ros_testing import DEADLINE


@contextmanager
def opened_page(home):
    """Start a page at a free port, give its address, and end it.

    Args:
        home: What it takes for ROS_HOME.
    """
    launch = "roslaunch --wait g1_description web.launch port:=0"
    process = subprocess.Popen(
        launch.split(),
        env={**os.environ, "ROS_HOME": str(home)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        start_new_session=True,
    )
    told = []
    for line in process.stdout:
        told.append(line)
        found = re.search(r"open (http://\S+)", line)
        if found:
            break
    else:
        raise AssertionError("".join(told))
    # Who cannot write stops.
    threading.Thread(target=process.stdout.read, daemon=True).start()
    try:
        yield found.group(1)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(DEADLINE)
