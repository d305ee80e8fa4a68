"""Films as mp4, written by ffmpeg."""

from __future__ import annotations

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
        try:
            writer = imageio_ffmpeg.write_frames(
                str(whole), size, fps=rate, codec="libx264", macro_block_size=2
            )
            writer.send(None)
            for picture in pictures:
                writer.send(np.ascontiguousarray(picture))
            writer.close()
            content = whole.read_bytes()
        except (OSError, RuntimeError, subprocess.SubprocessError) as error:
            problem = str(error).strip().splitlines()[-1]
            raise InvalidValueError(
                f"ffmpeg cannot write {path.name}: {problem}."
            ) from error
    write_whole(path, content)
