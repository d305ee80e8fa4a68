"""A file that may contain a motion, as the format modules read it."""

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
"""Largest file in bytes: more than an hour at 60 Hz as text."""

MAX_SIZE = 12_000_000
"""Largest array: half an hour of 30 bodies at 60 Hz."""

MAX_BYTES = 250_000_000
"""Largest array of an npz in bytes, decompressed."""

ZIP = b"PK"
GIT_LFS = "version https://git-lfs."

NOT_TEXT = {".npz": "npz file", ".pkl": "pickle", ".pickle": "pickle", ".bag": "rosbag"}
"""Extensions of binary formats: text in such files is never a table."""


class MotionSource:
    """A file and options for reading it; its content is read on first use.

    Raises:
        MotionError: If there is no such file; by each property if it is damaged.
    """

    def __init__(
        self, path: Path, rate: float | None = None, topic: str | None = None
    ) -> None:
        self.path, self.ending = path, path.suffix.lower()
        self.rate = rate
        """Samples per second of a file without times, in [Hz]; None: the usual one."""
        self.topic = topic
        """Topic of the joints in a bag; None: the usual one."""
        self.head = self._read(100)
        """The first bytes."""

    def _read(self, size: int) -> bytes:
        """Read the first bytes."""
        try:
            if not stat.S_ISREG(self.path.stat().st_mode):
                raise MotionError(f"{self.path} is not a file.")
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
                f"The file has {size / 1e6:.0f} MB; the limit is "
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
            raise MotionError("This is a Git LFS pointer: run git lfs pull.")
        if self.ending in NOT_TEXT:
            raise MotionError(f"Not a valid {NOT_TEXT[self.ending]}.")
        return text

    @cached_property
    def arrays(self) -> Mapping[str, Any]:
        """Arrays of an npz or a pickled dictionary; empty for other files."""
        if self.head.startswith(PICKLE):
            return read_pickle(self.data)
        if not self.head.startswith(ZIP):
            return {}
        try:
            return np.load(io.BytesIO(self.data), allow_pickle=False)
        # Any error of zipfile or numpy on a damaged file.
        except Exception as error:
            raise _damaged(error) from error

    def numbers(self, name: str, *shape: int | None) -> np.ndarray:
        """Read an array of finite numbers.

        Args:
            name: One of ``arrays``.
            shape: Required shape; None fits any number. Without sizes, any shape fits.
        """
        value = self._array(name)
        fits = isinstance(value, (np.ndarray, np.generic, int, float))
        array = np.asarray(value if fits else None)
        if array.dtype.kind not in "fiu":
            raise MotionError(f"{name} must contain numbers.")
        if array.size > MAX_SIZE:
            raise MotionError(
                f"{name} has {array.size} numbers; the limit is {MAX_SIZE}."
            )
        array = array.astype(float, copy=False)
        if not np.isfinite(array).all():
            raise MotionError(f"{name} must be finite, but has NaN or infinity.")
        if shape and not (
            array.ndim == len(shape)
            and all(size in (None, n) for size, n in zip(shape, array.shape))
        ):
            words = ", ".join("n" if size is None else str(size) for size in shape)
            raise MotionError(
                f"{name} must have the shape ({words}) (got {array.shape})."
            )
        return array

    def names(self, name: str) -> tuple[str, ...]:
        """Read a list of names."""
        names = self._array(name)
        is_list = isinstance(names, np.ndarray) and names.dtype.kind == "U"
        if not is_list or names.ndim != 1 or names.size > MAX_SIZE:
            raise MotionError(f"{name} must be a list of names.")
        return tuple(names.tolist())

    def times(self, n_samples: int) -> tuple[np.ndarray, tuple[str, ...]]:
        """Compute times from the rate ``fps``.

        Returns:
            Times in [s], shape (n_samples,), and a message if the rate is doubtful.
        """
        rate = self.numbers("fps").ravel()
        if rate.size != 1 or not 0.0 < rate[0] < 1e6:
            raise MotionError(
                f"fps must be one number greater than 0 (got {rate[:3].tolist()})."
            )
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
        # Any error of zipfile or numpy on a damaged file.
        except Exception as error:
            raise _damaged(error) from error
        raise MotionError(
            f"{name} has {size / 1e6:.0f} MB; the limit is {MAX_BYTES / 1e6:.0f} MB."
        )


def _damaged(error: Exception) -> MotionError:
    return MotionError(f"The npz file cannot be read: {cause(error)}.")
