"""A terminal to run programs in."""

import os
import re
import select
import termios
import time

from waiting import DEADLINE

from .programs import Program


class Terminal:
    """A program of this package in a terminal of its own."""

    def __init__(self, name, *words):
        self._terminal, its = os.openpty()
        self._program = Program(name, *words, terminal=its)
        os.close(its)
        self.text = ""

    def wait(self, pattern):
        """Wait until it has printed something."""
        end = time.monotonic() + DEADLINE
        while not re.search(pattern, self.text):
            left = end - time.monotonic()
            assert left > 0.0, f"no {pattern!r} in {self.text!r}"
            if select.select([self._terminal], [], [], left)[0]:
                self._read()

    def _read(self):
        try:
            self.text += os.read(self._terminal, 65536).decode()
        except OSError:
            return False
        return True

    def press(self, key):
        self.text = ""
        os.write(self._terminal, key)

    def settings(self):
        """Give how the terminal is set, as termios has it."""
        return termios.tcgetattr(self._terminal)

    def end(self):
        """Wait for its end; return its exit code."""
        while self._read():
            pass
        self.settings_left = self.settings()
        return self.close()

    def close(self):
        """Close the terminal, and wait for the program's end; return its exit code."""
        os.close(self._terminal)
        return self._program.wait()
