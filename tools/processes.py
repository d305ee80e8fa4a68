"""Start processes so that each can be found and ended, however it hides.

roslaunch gives every node a session of its own, so process groups lose them.
What a process inherits for good is its environment: a mark in it tells ours
from everyone else's.
"""

import contextlib
import os
import signal
import time
import uuid

NAME = "G1_DESCRIPTION_RUN"


def new_mark():
    """Make a mark that no other run has."""
    return f"{NAME}={uuid.uuid4().hex}"


def marked_environment(mark, environment=None):
    """Copy an environment, by default this process's, with the mark put in."""
    name, value = mark.split("=")
    return {**(environment or os.environ), name: value}


def marked_processes(mark):
    """Find the processes that carry a mark.

    Returns:
        Command lines by process id; one that just ends is left out.
    """
    found = {}
    for entry in os.listdir("/proc"):
        if not entry.isdigit():
            continue
        try:
            with open(f"/proc/{entry}/environ", "rb") as file:
                if mark.encode() not in file.read().split(b"\0"):
                    continue
            with open(f"/proc/{entry}/cmdline", "rb") as file:
                found[int(entry)] = file.read().replace(b"\0", b" ").decode().strip()
        except OSError:
            pass
    return found


def wait_for_end(mark, timeout):
    """Wait until no marked process is left, or timeout [s] ends."""
    deadline = time.monotonic() + timeout
    while marked_processes(mark) and time.monotonic() < deadline:
        time.sleep(0.05)


def end_processes(mark):
    """End all marked processes: asked first, then killed."""
    for number, timeout in ((signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0)):
        for pid in marked_processes(mark):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)
        wait_for_end(mark, timeout)
