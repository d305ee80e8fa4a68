"""Programs, run in a folder of their own, with a deadline, and none left behind."""

import os
import socket
import subprocess
import time
from pathlib import Path

from .outcome import Outcome
from processes import (
    end_processes,
    marked_environment,
    marked_processes,
    new_mark,
    wait_for_end,
)

ROOT = Path(__file__).resolve().parents[2]
PLACE = Path(os.environ.get("G1_DESCRIPTION_PLACE", ROOT))
"""Where the environment and the workspace are; another Python has its own."""
BIN = PLACE / ".venv" / "bin"
WORKSPACE = PLACE / ".ws"
PACKAGE = ROOT / ".ws" / "src" / "g1_description"
"""The clone, as catkin sees it in both workspaces."""
LIMIT = 75 * 60.0
"""[s] for all parts together."""
PART_LIMIT = 1200.0
"""[s] for one program: several times what it takes on a machine with two cores."""


class Runner:
    """Runs programs in a folder of their own and leaves none behind."""

    def __init__(self, folder):
        """Take the environment of the built workspace.

        Args:
            folder: Where results, logs and ROS's own files go.
        """
        self.folder = folder
        folder.mkdir()
        self.mark = new_mark()
        self.is_stopped = False
        self.processor = 0.0
        self.deadline = time.monotonic() + LIMIT
        os.environ.update(
            ROS_HOSTNAME="localhost",
            ROS_HOME=f"{folder}/ros",
            ROS_LOG_DIR=f"{folder}/ros/log",
            ROS_MASTER_URI=f"http://localhost:{free_port()}",
        )
        for name in ("DISPLAY", "PYTHONPATH", "ROS_IP"):
            os.environ.pop(name, None)
        if PLACE != ROOT:  # tests are programs that take the first python3
            os.environ["PATH"] = f"{PLACE}/bin{os.pathsep}{os.environ['PATH']}"
        self.plain = dict(os.environ)
        underlay = Path("/opt/ros/noetic/setup.bash")
        if underlay.exists():
            self.plain = self.sourced(underlay)
        self.built = self.sourced(WORKSPACE / "devel" / "setup.bash")

    def sourced(self, setup):
        """Give the environment that a setup file makes."""
        text = subprocess.run(
            ["bash", "-c", '. "$1" && exec env -0', "bash", setup],
            env=self.plain,
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        ).stdout
        return dict(line.split("=", 1) for line in text.split("\0") if "=" in line)

    def start(self, command, environment=None, output=subprocess.DEVNULL, cwd=ROOT):
        """Start a program with the mark, in a session of its own."""
        return subprocess.Popen(
            [str(word) for word in command],
            cwd=cwd,
            env=marked_environment(self.mark, environment or self.built),
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )

    def run(self, command, environment=None, limit=PART_LIMIT):
        """Run a program to its end.

        Args:
            command: Program and arguments.
            environment: Its environment; None is that of the workspace.
            limit: Time it may take, in [s].

        Returns:
            Exit code and output; the code is None if it was out of time.
        """
        limit = max(0.0, min(limit, self.deadline - time.monotonic()))
        with open(self.folder / "output.txt", "w+", errors="replace") as output:
            process = self.start(command, environment, output)
            code = self.wait(process, limit)
            if code is None:
                end_processes(self.mark)
                self.wait(process, PART_LIMIT)
                output.write(f"\nout of time after {limit:.0f} s\n")
            output.seek(0)
            return code, output.read()

    def wait(self, process, limit):
        """Wait for a program's end, and add the processor time of it and its own.

        Returns:
            Its exit code; None if it has not ended in this time, in [s].
        """
        end = time.monotonic() + limit
        while time.monotonic() < end:
            pid, status, used = os.wait4(process.pid, os.WNOHANG)
            if pid:
                self.processor += used.ru_utime + used.ru_stime
                process.returncode = _exit_code(status)
                return process.returncode
            time.sleep(0.02)
        return None

    def check(self, command, environment=None, expected=""):
        """Run a program as one case: it must end well and print what is expected."""
        code, text = self.run(command, environment)
        outcome = Outcome()
        words = " ".join(str(word) for word in command)
        outcome.check(code == 0 and expected in text, f"{words}\n{text}")
        return outcome

    def stop(self):
        """End all it started, and run nothing more."""
        self.is_stopped, self.deadline = True, 0.0
        end_processes(self.mark)

    def leftover(self):
        """Take each process that is still there for a failure, and end it."""
        wait_for_end(self.mark, 5.0)
        left = marked_processes(self.mark)
        end_processes(self.mark)
        return Outcome(failed=[f"left behind: {line}" for line in left.values()])


def _exit_code(status):
    """Convert a wait status to an exit code, negative for a signal."""
    return -os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)


def free_port():
    """Find a TCP port that nobody listens on."""
    with socket.socket() as listener:
        listener.bind(("localhost", 0))
        return listener.getsockname()[1]
