"""Films as mp4, written by ffmpeg."""

from __future__ import annotations

import contextlib
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from g1_description.core.errors import InvalidValueError
from g1_description.core.files.atomic import write_whole


def write_video(
    path: Path, pictures: Iterable[np.ndarray], size: tuple[int, int], rate: float
) -> None:
    """Write a film.

    Args:
        path: The file.
        pictures: As uint8, shape (height, width, 3).
        size: Width and height in pixels, both even, as the format wants.
        rate: Pictures per second in [Hz].

    Raises:
        InvalidValueError: If it cannot be written; what was there stays.
    """
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "film.mp4"
        _encode(whole, pictures, size, rate, path.name)
        write_whole(path, whole.read_bytes())


def _encode(
    whole: Path,
    pictures: Iterable[np.ndarray],
    size: tuple[int, int],
    rate: float,
    name: str,
) -> None:
    """Let ffmpeg write a file; it is ended, whatever happens."""
    command = [
        *(imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-y"),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}"),
        *("-r", f"{rate}", "-i", "-", "-c:v", "libx264", "-pix_fmt", "yuv420p"),
        str(whole),
    ]
    with tempfile.TemporaryFile() as errors, subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=errors
    ) as encoder:
        try:
            for picture in pictures:
                encoder.stdin.write(np.ascontiguousarray(picture).tobytes())
        except BrokenPipeError:  # it has ended, and said why
            pass
        except BaseException:
            encoder.kill()
            raise
        finally:
            with contextlib.suppress(BrokenPipeError):
                encoder.stdin.close()
        if encoder.wait() or not whole.exists():
            errors.seek(0)
            lines = errors.read().decode("utf-8", "replace").strip().splitlines()
            problem = lines[-1] if lines else f"it ended with {encoder.returncode}"
            raise InvalidValueError(f"ffmpeg cannot write {name}: {problem}.")
