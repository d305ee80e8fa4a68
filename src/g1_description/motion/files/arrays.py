"""Arrays of a file by name, and other values in their place."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import IO, Any, Mapping

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.pickles import read_pickled
from g1_description.motion.motion import Motion
from g1_description.text import MAX_NAME

MAX_SIZE = 12_000_000
"""Largest array: half an hour of 30 bodies at 60 Hz."""

MAX_BYTES = 250_000_000
"""Largest array of an npz in bytes, decompressed."""

MAX_HEADER = 10_000
"""Longest header of an array in bytes; numpy parses it as Python."""

LONGEST_PERIOD = 0.1
"""Rates up to this are periods, in [s]: nobody records fewer than 10 samples a second,
but readers of OmniRetarget take ``fps`` for a period."""

NPY = "npy"
"""Name of the array of an npy."""


class Arrays(Mapping[str, Any]):
    """Arrays and other values of a file, by name.

    Raises:
        MotionError: By each method if a value is missing, or is not as required.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = values
        self._holding: dict[tuple[str, ...], tuple[str, ...]] = {}

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> Any:
        if name not in self._values:
            raise MotionError(f"The array {name} is missing.")
        return self._values[name]

    def numbers(self, name: str, *shape: int | None) -> np.ndarray:
        """Read an array of finite numbers.

        Args:
            name: Name of the array.
            shape: Required shape; None fits any number. Without sizes, any shape fits.
        """
        value = self[name]
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
        names = self[name]
        if isinstance(names, np.ndarray) and names.dtype.kind in "US":
            with suppress(ValueError):  # not all numbers are characters
                names = names.astype("U").tolist()
        if not isinstance(names, (list, tuple)) or not all(
            isinstance(item, str) for item in names
        ):
            raise MotionError(f"{name} must be a list of names.")
        return tuple(names)

    def holding(self, *keys: str) -> tuple[str, ...]:
        """List the names of dictionaries that have these keys."""
        if not isinstance(self._values, dict):
            return ()  # an npz, whose arrays stay unread
        if keys not in self._holding:  # each motion of a library requests it
            self._holding[keys] = tuple(
                name
                for name, value in self._values.items()
                if isinstance(value, dict) and {*keys} <= {*value}
            )
        return self._holding[keys]

    def inside(self, name: str) -> Arrays:
        """Return the arrays of a dictionary that has this name.

        Raises:
            MotionError: If it is none.
        """
        found = self[name]
        if not isinstance(found, dict):
            raise MotionError(f"{name} must be a dictionary of arrays.")
        return Arrays(found)

    def timed(self, motion: Motion, name: str = "fps") -> Motion:
        """Give times to the samples of a motion.

        Args:
            motion: With any times.
            name: Name of the rate; one of at most 0.1 is taken for the period of the
                samples, with a message. Without it the motion has no times.
        """
        if name not in self or self[name] is None:
            return replace(motion, has_times=False)
        n_samples = len(motion.times)
        rate = self._number(name).ravel()
        if rate.size != 1 or not 0.0 < rate[0] < 1e6:
            raise MotionError(
                f"{name} must be one number greater than 0 (got {rate[:3].tolist()})."
            )
        fps, note = rate[0], ""
        if fps <= LONGEST_PERIOD and n_samples > 1:
            period, fps = fps, float(f"{1.0 / fps:.6g}")
            note = (
                f"{name} is {period:.6g}, which is taken for the period of the samples "
                f"in seconds: {fps:g} Hz. Set {name} to {fps:g}."
            )
        elif fps < 1.0 and n_samples > 1:
            note = (
                f"{name} is {fps:.6g}, i.e. one sample every {1.0 / fps:.6g} s. If "
                f"{fps:.6g} is the sample period in seconds, set {name} to "
                f"{1.0 / fps:.6g}."
            )
        notes = (*motion.notes, note) if note else motion.notes
        return replace(motion, times=np.arange(n_samples) / fps, notes=notes)

    def _number(self, name: str) -> np.ndarray:
        """Read a number, which some files have as text."""
        with suppress(TypeError, ValueError):
            if isinstance(self[name], str) and len(self[name]) < MAX_NAME:
                return np.array(float(self[name]))
        return self.numbers(name)


class NpzArrays(Arrays):
    """Arrays of an npz, read when they are requested."""

    def __contains__(self, name: object) -> bool:
        return name in self._values.files  # type: ignore[attr-defined]

    def __getitem__(self, name: str) -> Any:
        try:
            size = self._values.zip.getinfo(f"{name}.npy").file_size  # type: ignore[attr-defined]
            if size <= MAX_BYTES:
                with self._values.zip.open(f"{name}.npy") as file:  # type: ignore[attr-defined]
                    return _array(file)
        except MotionError:
            raise
        # Any error of zipfile or numpy on a damaged file.
        except Exception as error:
            raise damaged(error) from error
        raise MotionError(
            f"{name} has {size / 1e6:.0f} MB; the limit is {MAX_BYTES / 1e6:.0f} MB."
        )


def npy_arrays(content: bytes) -> Arrays:
    """Read an npy: an array, or a pickled dictionary."""
    found = _array(io.BytesIO(content))
    return Arrays(found if isinstance(found, dict) else {NPY: found})


def _array(stream: IO[bytes]) -> Any:
    """Read an array, or the value pickled in its place."""
    begin = stream.read(12)
    last = 10 if begin[6:7] == b"\x01" else 12
    if int.from_bytes(begin[8:last], "little") > MAX_HEADER:
        raise MotionError(f"The header of an array has more than {MAX_HEADER} bytes.")
    content = io.BytesIO(begin + stream.read())
    version = np.lib.format.read_magic(content)
    header = np.lib.format.read_array_header_1_0
    if version != (1, 0):
        header = np.lib.format.read_array_header_2_0
    if header(content)[2].hasobject:
        return read_pickled(content.read())
    content.seek(0)
    return np.load(content, allow_pickle=False)


def damaged(error: Exception) -> MotionError:
    """Describe an error of a library on a damaged file."""
    if "not a zip file" in str(error) or "EOF: reading array" in str(error):
        return MotionError("The file ends too early.")
    return MotionError(f"The file cannot be read: {cause(error)}.")
