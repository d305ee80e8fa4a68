"""A file that may hold a motion, as the modules of formats look at it."""

from __future__ import annotations

import io
import stat
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.pickles import PICKLE, read_pickle

MAX_FILE_SIZE = 100_000_000
"""No motion has more, in bytes: an hour at 60 Hz, written as text, has less."""

MAX_SIZE = 12_000_000
"""Most numbers of an array: half an hour of 30 bodies at 60 Hz."""

MAX_BYTES = 250_000_000
"""Most bytes of an array in an npz, unpacked."""

ZIP = b"PK"
GIT_LFS = "version https://git-lfs."

NOT_TEXT = {".npz": "npz file", ".pkl": "pickle", ".pickle": "pickle", ".bag": "rosbag"}
"""What files with these endings are, whose text is never a table."""


class MotionSource:
    """A file and how it is to be read; its content is read when it is first used.

    Raises:
        MotionError: If there is no such file, and by each property if it is damaged.
    """

    def __init__(
        self, path: Path, rate: float | None = None, topic: str | None = None
    ) -> None:
        self.path, self.ending = path, path.suffix.lower()
        self.rate = rate
        """Samples per second of a file without times, in [Hz]; None: the usual one."""
        self.topic = topic
        """Topic of a bag with the joints; None: the usual one."""
        self.head = self._read(100)
        """The first bytes."""

    def _read(self, size: int) -> bytes:
        """Read the first bytes."""
        try:
            if not stat.S_ISREG(self.path.stat().st_mode):
                raise MotionError(f"{self.path} is no file.")
            with self.path.open("rb") as file:
                return file.read(size)
        except (OSError, ValueError) as error:
            problem = getattr(error, "strerror", None) or error
            raise MotionError(f"{self.path} cannot be read: {problem}.") from error

    @cached_property
    def data(self) -> bytes:
        """All bytes."""
        size = self.path.stat().st_size
        if size > MAX_FILE_SIZE:
            raise MotionError(
                f"The file has {size / 1e6:.0f} MB; a motion has at most "
                f"{MAX_FILE_SIZE / 1e6:.0f} MB."
            )
        return self._read(MAX_FILE_SIZE)

    @cached_property
    def text(self) -> str | None:
        """All text; None if the file is not text in UTF-8."""
        try:
            text = self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            return None
        if text.startswith(GIT_LFS):
            raise MotionError("The file itself is in Git LFS: run git lfs pull.")
        if self.ending in NOT_TEXT:
            raise MotionError(f"Not a whole {NOT_TEXT[self.ending]}.")
        return text

    @cached_property
    def arrays(self) -> Mapping[str, Any]:
        """What an npz or a pickle of a dictionary holds; of other files nothing."""
        if self.head.startswith(PICKLE):
            return read_pickle(self.data)
        if not self.head.startswith(ZIP):
            return {}
        try:
            return np.load(io.BytesIO(self.data), allow_pickle=False)
        # Whatever a damaged file makes zipfile and numpy raise.
        except Exception as error:
            raise _damaged(error) from error

    def numbers(self, name: str, *shape: int | None) -> np.ndarray:
        """Read an array of finite numbers.

        Args:
            name: One of ``arrays``.
            shape: What it must be; None fits any number. Without, any shape will do.
        """
        value = self._array(name)
        fits = isinstance(value, (np.ndarray, np.generic, int, float))
        array = np.asarray(value if fits else None)
        if array.dtype.kind not in "fiu":
            raise MotionError(f"{name} holds no numbers.")
        if array.size > MAX_SIZE:
            raise MotionError(
                f"{name} has {array.size} numbers; a motion has at most {MAX_SIZE}."
            )
        array = array.astype(float, copy=False)
        if not np.isfinite(array).all():
            raise MotionError(f"{name} has numbers that are not finite.")
        if shape and not (
            array.ndim == len(shape)
            and all(size in (None, n) for size, n in zip(shape, array.shape))
        ):
            words = ", ".join("n" if size is None else str(size) for size in shape)
            raise MotionError(f"{name} has the shape {array.shape}, not ({words}).")
        return array

    def names(self, name: str) -> tuple[str, ...]:
        """Read a list of names."""
        names = self._array(name)
        is_list = isinstance(names, np.ndarray) and names.dtype.kind == "U"
        if not is_list or names.ndim != 1 or names.size > MAX_SIZE:
            raise MotionError(f"{name} holds no list of names.")
        return tuple(names.tolist())

    def times(self, n_samples: int) -> tuple[np.ndarray, tuple[str, ...]]:
        """Make times of the rate ``fps``.

        Returns:
            Times in [s], shape (n_samples,), and a message if the rate is doubtful.
        """
        rate = self.numbers("fps").ravel()
        if rate.size != 1 or not 0.0 < rate[0] < 1e6:
            raise MotionError(f"fps is {rate[:3].tolist()}; one rate is expected.")
        fps, notes = rate[0], []
        if fps < 1.0 and n_samples > 1:
            notes.append(
                f"fps is {fps:.6g}, i.e. one sample every {1.0 / fps:.6g} s. If "
                f"{fps:.6g} is the sample period in seconds, set fps to "
                f"{1.0 / fps:.6g}."
            )
        return np.arange(n_samples) / fps, tuple(notes)

    def _array(self, name: str) -> Any:
        """Read an array or another value."""
        if isinstance(self.arrays, dict):
            return self.arrays[name]
        try:
            size = self.arrays.zip.getinfo(f"{name}.npy").file_size  # type: ignore[attr-defined]
            if size <= MAX_BYTES:
                return self.arrays[name]
        # Whatever a damaged file makes zipfile and numpy raise.
        except Exception as error:
            raise _damaged(error) from error
        raise MotionError(
            f"{name} has {size / 1e6:.0f} MB; an array of a motion has at most "
            f"{MAX_BYTES / 1e6:.0f} MB."
        )


def _damaged(error: Exception) -> MotionError:
    return MotionError(f"The npz file cannot be read: {cause(error)}.")
