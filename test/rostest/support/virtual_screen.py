"""A screen that nobody needs to have, and the pictures on it."""

import contextlib
import os
import struct
import subprocess
import tempfile
import zlib
from pathlib import Path

import numpy as np

DEADLINE = 300.0


class VirtualScreen:
    """An X server, Xvfb, on a display number that was free."""

    def __init__(self, width, height, *options):
        """Start it, and return when it takes clients.

        Args:
            width: [px]
            height: [px]
            options: More options of Xvfb.
        """
        self._stack = contextlib.ExitStack()
        with self._stack:
            folder = self._stack.enter_context(tempfile.TemporaryDirectory())
            self._memory = Path(folder) / "Xvfb_screen0"
            ours, its = os.pipe()
            with open(ours) as display, open(its, "w") as pipe:
                command = (
                    f"Xvfb -displayfd {its} -screen 0 {width}x{height}x24"
                    f" -fbdir {folder} -nocursor -nolisten tcp"
                )
                words = [*command.split(), *options]
                self._server = subprocess.Popen(words, pass_fds=[its])
                self._stack.callback(self._end)
                pipe.close()  # so that reading ends when the server fails
                number = display.readline().strip()
            if not number:
                raise RuntimeError("Xvfb did not start; it says why on its output")
            self.display = f":{number}"
            self._stack = self._stack.pop_all()

    def _end(self):
        self._server.terminate()
        try:
            self._server.wait(DEADLINE)
        except subprocess.TimeoutExpired:
            self._server.kill()
            self._server.wait()

    def stop(self):
        """End the server and remove its files."""
        self._stack.close()

    def picture(self):
        """Copy what is on the screen: uint8, shape (height, width, 3), RGB.

        Xvfb keeps the screen in a file in the format of xwd: a header of 32-bit
        words, a colour map of 12 bytes an entry, the rows.
        """
        data = self._memory.read_bytes()
        words = struct.unpack_from(">25I", data)
        header, width, height, little = words[0], words[4], words[5], not words[7]
        row, colours = words[12], words[19]
        pixels = np.frombuffer(
            data, np.uint8, count=row * height, offset=header + 12 * colours
        ).reshape(height, row // 4, 4)[:, :width]
        return pixels[:, :, 2::-1] if little else pixels[:, :, 1:]


def write_png(path, picture):
    """Write a picture for a person to look at.

    Args:
        path: The file; its folder is made.
        picture: uint8, shape (height, width, 3), RGB.
    """

    def chunk(kind, content):
        check = zlib.crc32(kind + content)
        return (
            struct.pack(">I", len(content)) + kind + content + check.to_bytes(4, "big")
        )

    height, width, _ = picture.shape
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    rows = b"".join(b"\0" + row.tobytes() for row in picture)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows, 9))
        + chunk(b"IEND", b"")
    )
