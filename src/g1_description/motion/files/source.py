"""A file that may contain a motion, as the format modules read it."""

from __future__ import annotations

import bz2
import io
import json
import lzma
import stat
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from types import ModuleType
from typing import IO, Any, Callable, Mapping

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.pickles import PICKLE, read_pickle, read_pickled
from g1_description.motion.files.torch_files import is_torch, read_torch
from g1_description.motion.motion import Motion
from g1_description.motion.paths import rate_in, split
from g1_description.text import MAX_NAME, listed

MAX_FILE_SIZE = 200_000_000
"""Largest file in bytes: two hours at 60 Hz as text, or a library of three."""

MAX_SIZE = 12_000_000
"""Largest array: half an hour of 30 bodies at 60 Hz."""

MAX_BYTES = 250_000_000
"""Largest array of an npz in bytes, decompressed."""

MAX_CONTENT = 200_000_000
"""Most bytes of a compressed file, decompressed."""

MAX_JSON = 10_000_000
"""Longest text in JSON, in characters: it has names, and no samples."""

MAX_DICTIONARY = 200_000_000
"""Most memory that xz may use, in bytes; a file says how much it needs."""

MAX_MEMBERS = 10_000
"""Most files in an npz or a file of torch."""

MAX_HEADER = 10_000
"""Longest header of an array in bytes; numpy parses it as Python."""

ZIP = b"PK\x03\x04"
ZIP_MEMBER = b"PK\x01\x02"
NPY_MAGIC = b"\x93NUMPY"

NPY = "npy"
"""Name of the array of an npy."""

COMPRESSED: Mapping[bytes, Callable[[], Any]] = {
    **dict.fromkeys((b"x\x01", b"x^", b"x\x9c", b"x\xda"), zlib.decompressobj),
    b"\x1f\x8b": partial(zlib.decompressobj, zlib.MAX_WBITS | 16),
    b"BZh": bz2.BZ2Decompressor,
    **dict.fromkeys(
        (b"\xfd7zXZ", b"]\x00\x00"),
        partial(lzma.LZMADecompressor, memlimit=MAX_DICTIONARY),
    ),
}
"""Decompressors by first bytes: of zlib, gzip, bz2, xz and lzma."""

GIT_LFS = "version https://git-lfs."

NOT_TEXT = {".npz": "npz file", ".pkl": "pickle", ".pickle": "pickle", ".bag": "rosbag"}
"""Extensions of binary formats: text in such files is never a table."""


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
            name: Of the array.
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
            names = _texts(names)
        if not isinstance(names, (list, tuple)) or not all(
            isinstance(item, str) for item in names
        ):
            raise MotionError(f"{name} must be a list of names.")
        return tuple(names)

    def holding(self, *keys: str) -> tuple[str, ...]:
        """List the names of dictionaries that have these keys."""
        if not isinstance(self._values, dict):
            return ()  # an npz, whose arrays stay unread
        if keys not in self._holding:  # each motion of a library asks for it
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

    def times(
        self, n_samples: int, name: str = "fps"
    ) -> tuple[np.ndarray, tuple[str, ...]]:
        """Compute times from a rate.

        Args:
            n_samples: Number of samples.
            name: Of the rate.

        Returns:
            Times in [s], shape (n_samples,), and a message if the rate is doubtful.
        """
        rate = self.numbers(name).ravel()
        if rate.size != 1 or not 0.0 < rate[0] < 1e6:
            raise MotionError(
                f"{name} must be one number greater than 0 (got {rate[:3].tolist()})."
            )
        fps, notes = rate[0], []
        if fps < 1.0 and n_samples > 1:
            notes.append(
                f"{name} is {fps:.6g}, i.e. one sample every {1.0 / fps:.6g} s. If "
                f"{fps:.6g} is the sample period in seconds, set {name} to "
                f"{1.0 / fps:.6g}."
            )
        return np.arange(n_samples) / fps, tuple(notes)


class _Npz(Arrays):
    """Arrays of an npz, read when they are asked for."""

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
            raise _damaged(error) from error
        raise MotionError(
            f"{name} has {size / 1e6:.0f} MB; the limit is {MAX_BYTES / 1e6:.0f} MB."
        )


class MotionSource:
    """A file and options for reading it; its content is read on first use.

    Raises:
        MotionError: If there is no such file; by each property if it is damaged.
    """

    def __init__(
        self,
        path: Path,
        rate: float | None = None,
        topic: str | None = None,
        order: str | None = None,
        joint_order: str | None = None,
    ) -> None:
        self.path, self.name = split(path)
        """The file or folder, and which of its motions; None: it must have one."""
        self.ending = self.path.suffix.lower()
        self.rate = rate
        """Samples per second of a file without times, in [Hz]; None: the usual one."""
        self.topic = topic
        """Topic of the joints in a bag; None: the usual one."""
        self.order = order
        """Of the base's quaternions: xyzw or wxyz; None: that of the format."""
        self.joint_order = joint_order
        """Of joints without names: mujoco or isaaclab; None: that of the format."""
        self.format: ModuleType | None = None
        """Its format, once it is found."""
        self.is_folder = self.path.is_dir()
        self.head = b"" if self.is_folder else self._read(100)
        """The first bytes."""
        self.is_zip = self.head.startswith(ZIP)

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
        if self.is_folder:
            return b""
        size = self.path.stat().st_size
        if size > MAX_FILE_SIZE:
            raise MotionError(
                f"The file has {size / 1e6:.0f} MB; the limit is "
                f"{MAX_FILE_SIZE / 1e6:.0f} MB."
            )
        return self._read(MAX_FILE_SIZE)

    @cached_property
    def content(self) -> bytes:
        """All bytes, decompressed if joblib compressed them."""
        for begin, decompressor in COMPRESSED.items():
            if self.head.startswith(begin):
                try:
                    return _decompressed(self.data, decompressor())
                except (OSError, EOFError, zlib.error, lzma.LZMAError) as error:
                    raise _damaged(error) from error
        return self.data

    @cached_property
    def text(self) -> str | None:
        """All text; None if the file is not text in UTF-8."""
        if self.is_folder or self.is_zip:
            return None
        try:
            text = self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            return None
        if text.startswith(GIT_LFS):
            raise MotionError("This is a Git LFS pointer: run git lfs pull.")
        if self.ending in NOT_TEXT:
            raise MotionError(f"Not a valid {NOT_TEXT[self.ending]}.")
        return text

    @property
    def whole(self) -> MotionSource:
        """The file without a choice of a motion, the same one for all its motions."""
        return _whole(self.path, self.path.stat().st_mtime_ns)

    @cached_property
    def arrays(self) -> Arrays:
        """Arrays of an npz, of torch or of a pickled dictionary, also if compressed.

        That of an npy is called ``NPY``. Empty for other files.
        """
        if self.name is not None:
            return self.whole.arrays
        content = self.content
        if content.startswith(PICKLE):
            return Arrays(read_pickle(content))
        try:
            if content.startswith(NPY_MAGIC):
                return _npy(content)
            is_zip = content.startswith(ZIP)
            if is_zip and content.count(ZIP_MEMBER) > MAX_MEMBERS:
                raise MotionError(f"The zip has more than {MAX_MEMBERS} files.")
            if is_zip and is_torch(content):
                return Arrays(read_torch(content))
            if is_zip and b".npy" in content:
                return _Npz(np.load(io.BytesIO(content), allow_pickle=False))
        except MotionError:
            raise
        # Any error of zipfile or numpy on a damaged file.
        except Exception as error:
            raise _damaged(error) from error
        return Arrays({})

    def chosen(self, names: Sequence[str]) -> str:
        """Choose one of the motions in the file.

        Args:
            names: Of all its motions.

        Raises:
            MotionError: If none is chosen and there are several, or it has no such one.
        """
        if self.name in names:
            return str(self.name)
        if self.name is not None:
            raise MotionError(f"There is no motion {self.name!r}; {listed(names)}.")
        if len(names) == 1:
            return names[0]
        if not names:
            raise MotionError("The file has no motions.")
        raise MotionError(
            f"The file has several motions: {listed(names)}. Choose one, such as "
            f"'{self.path.name}#{names[0][:MAX_NAME]}' (check and motion: --all)."
        )

    @property
    def told_rate(self) -> float | None:
        """The rate that the user or the name of the file tells, in [Hz]; None: none."""
        return self.rate or rate_in(self.path)

    def timed(self, motion: Motion, usual: float, why: str) -> Motion:
        """Give times to the samples of a file without a rate.

        Args:
            motion: With any times.
            usual: The rate of such files in [Hz], if neither the user nor the name of
                the file tells it.
            why: Whose rate that is, for the message.
        """
        rate, notes = self.rate, motion.notes
        if rate is None:
            named = rate_in(self.path)
            rate, why = (named, "as its name says") if named else (usual, why)
            notes = (f"The file has no times; assuming {rate:g} Hz, {why}.", *notes)
        times = np.arange(len(motion.times)) / rate
        return replace(motion, times=times, notes=notes, has_times=False)


@lru_cache(maxsize=1)
def _whole(path: Path, _: int) -> MotionSource:
    """Read a file of several motions once for all of them, unless it has changed."""
    return MotionSource(path)


def parsed(text: str | None, what: str) -> Arrays:
    """Read a dictionary in JSON.

    Args:
        text: The text; None: there is none.
        what: What it is, for the message.

    Raises:
        MotionError: If it is none.
    """
    if len(text or "") > MAX_JSON:
        raise MotionError(
            f"{what} has {len(text or '') / 1e6:.0f} million characters; the limit is "
            f"{MAX_JSON / 1e6:.0f}."
        )
    try:
        found = json.loads(text or "")
    except (ValueError, RecursionError) as error:
        raise MotionError(f"{what} is not valid JSON: {cause(error)}.") from error
    if not isinstance(found, dict):
        raise MotionError(f"{what} must be a dictionary.")
    return Arrays(found)


def _texts(array: np.ndarray) -> Any:
    """Return an array of text as a list; None if it is none."""
    try:
        return array.astype("U").tolist() if array.ndim == 1 else None
    except ValueError:  # not all numbers are characters
        return None


def _decompressed(data: bytes, decompressor: Any) -> bytes:
    """Decompress all data, up to a limit."""
    content: bytes = decompressor.decompress(data, MAX_CONTENT)
    if not decompressor.eof:
        if len(content) < MAX_CONTENT:
            raise MotionError("The compressed file ends too early.")
        raise MotionError(
            f"Decompressed, the file has more than {MAX_CONTENT / 1e6:.0f} MB, the "
            "limit."
        )
    return content


def _npy(content: bytes) -> Arrays:
    """Read an npy: an array, or a pickled dictionary."""
    found = _array(io.BytesIO(content))
    return Arrays(found if isinstance(found, dict) else {NPY: found})


def _array(stream: IO[bytes]) -> Any:
    """Read an array, or what is pickled in its place."""
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


def _damaged(error: Exception) -> MotionError:
    return MotionError(f"The file cannot be read: {cause(error)}.")
