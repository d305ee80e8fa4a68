"""Programs of this package, as processes of a test."""

import fcntl
import os
import subprocess
import termios

from .ros_testing import DEADLINE, program


class Program(subprocess.Popen):
    """A program in a session of its own; what it prints is text in pipes."""

    def __init__(self, name, *words, output=None, terminal=None, environment=None):
        """Start it.

        Args:
            name: Its name in this package.
            words: Its arguments.
            output: Descriptor of what takes all that it prints, instead of pipes.
            terminal: Descriptor of its terminal, instead of all that.
            environment: More variables.
        """
        printed = terminal or output or subprocess.PIPE
        super().__init__(
            [program(name), *map(str, words)],
            stdin=terminal or subprocess.DEVNULL,
            stdout=printed,
            stderr=printed,
            env={**os.environ, **(environment or {})},
            text=True,
            start_new_session=True,
            preexec_fn=take_terminal if terminal else None,
        )

    def wait(self, timeout=DEADLINE):
        return super().wait(timeout)

    def communicate(self, timeout=DEADLINE):
        """Wait for its end; give the rest of what it prints, and of its errors."""
        return super().communicate(timeout=timeout)


def take_terminal():
    """Let the terminal's keys reach the program as signals."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def run(name, *words, **options):
    """Run a program to its end; give its exit code, what it prints and its errors."""
    started = Program(name, *words, **options)
    output, errors = started.communicate()
    return subprocess.CompletedProcess(words, started.returncode, output, errors)
