"""A file that may contain a motion, as the format modules read it."""

from __future__ import annotations

import bz2
import io
import json
import lzma
import re
import stat
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, Callable, Mapping

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.arrays import (
    Arrays,
    NpzArrays,
    damaged,
    npy_arrays,
)
from g1_description.motion.files.pickles import (
    PICKLE,
    PICKLE_NAME,
    read_pickle,
    read_torch,
)
from g1_description.motion.motion import Motion
from g1_description.motion.paths import absent, rate_in, split
from g1_description.text import MAX_NAME, listed

MAX_FILE_SIZE = 200_000_000
"""Largest file in bytes: two hours at 60 Hz as text, or a library of three."""

MAX_CONTENT = 200_000_000
"""Most bytes of a compressed file, decompressed."""

MAX_JSON = 10_000_000
"""Longest text in JSON, in characters: it has names, and no samples."""

MAX_DICTIONARY = 200_000_000
"""Most memory that xz may use, in bytes; a file says how much it needs."""

MAX_MEMBERS = 10_000
"""Most files in an npz or a file of torch."""

BEGIN = 10_000
"""Characters in which the root element of XML must be."""

ZIP = b"PK\x03\x04"

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


@dataclass(frozen=True)
class ReadOptions:
    """How files are read; None leaves it to the file and its format."""

    rate: float | None = None
    """Samples per second of files without times, in [Hz]; None: the usual one."""

    topic: str | None = None
    """Topic of the joints in a bag."""

    order: str | None = None
    """Order of base quaternions, xyzw or wxyz."""

    format: str | None = None
    """Name of the format; None: found by content."""

    joint_order: str | None = None
    """Order of joints without names, mujoco or isaaclab."""


USUAL = ReadOptions()


class MotionSource:
    """A file and options for reading it; its content is read on first use.

    Raises:
        MotionError: If there is no such file; by each property if it is damaged.
    """

    def __init__(self, path: Path, options: ReadOptions = USUAL) -> None:
        self.path, self.name = split(path)
        """The file or folder, and which of its motions; None: it must have one."""
        self.ending = self.path.suffix.lower()
        self.options = options
        self.format = ""
        """Name of the format in which it was read."""
        self.is_settled = False
        """Whether its bodies say that it was read in the right order."""
        self.recognised: dict[str, bool] = {}
        """Whether formats recognise it, by name."""
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
        except FileNotFoundError as error:
            raise MotionError(absent(self.path)) from error
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
                    raise damaged(error) from error
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
        if text.startswith("version https://git-lfs."):
            raise MotionError("This is a Git LFS pointer: run git lfs pull.")
        return None if "\0" in text else text  # as the begin of a small database

    @cached_property
    def xml_root(self) -> str:
        """Local name of the root element of XML; empty: it is not XML."""
        text = (self.text or "")[:BEGIN].lstrip()
        while text.startswith(("<?", "<!")):
            end = "-->" if text.startswith("<!--") else ">"
            text = text.partition(end)[2].lstrip()
        found = re.match(r"<(?:[\w.-]+:)?([\w.-]+)", text)
        return found[1] if found else ""

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
            if content.startswith(b"\x93NUMPY"):
                return npy_arrays(content)
            is_zip = content.startswith(ZIP)
            if is_zip and content.count(b"PK\x01\x02") > MAX_MEMBERS:
                raise MotionError(f"The zip has more than {MAX_MEMBERS} files.")
            if is_zip and PICKLE_NAME.encode() in content:
                return Arrays(read_torch(content))
            if is_zip and b".npy" in content:
                return NpzArrays(np.load(io.BytesIO(content), allow_pickle=False))
        except MotionError:
            raise
        # Any error of zipfile or numpy on a damaged file.
        except Exception as error:
            raise damaged(error) from error
        return Arrays({})

    def chosen(self, names: Sequence[str]) -> str:
        """Choose one of the motions in the file.

        Args:
            names: Names of all its motions.

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

    def timed(self, motion: Motion, usual: float | None, why: str) -> Motion:
        """Give times to the samples of a file without a rate.

        Args:
            motion: With any times.
            usual: The rate of such files in [Hz], if neither the user nor the name of
                the file gives it; None: there is none.
            why: Owner of that rate, for the message.

        Raises:
            MotionError: If there is no rate.
        """
        rate, notes = self.options.rate, motion.notes
        if rate is None:
            named = rate_in(self.path)
            rate, why = (named, "as its name says") if named else (usual, why)
            if rate is None:
                raise MotionError("The array fps is missing: give the rate, --fps.")
            notes = (f"The file has no times; assuming {rate:g} Hz, {why}.", *notes)
        times = np.arange(len(motion.times)) / rate
        return replace(motion, times=times, notes=notes)


@lru_cache(maxsize=1)
def _whole(path: Path, _: int) -> MotionSource:
    """Read a file of several motions once for all of them, unless it has changed."""
    return MotionSource(path)


def parsed(text: str | None, label: str) -> Arrays:
    """Read a dictionary in JSON.

    Args:
        text: The text; None: there is none.
        label: Subject of the message.

    Raises:
        MotionError: If it is none.
    """
    if len(text or "") > MAX_JSON:
        raise MotionError(
            f"{label} has {len(text or '') / 1e6:.0f} million characters; the limit is "
            f"{MAX_JSON / 1e6:.0f}."
        )
    try:
        found = json.loads(text or "")
    except (ValueError, RecursionError) as error:
        raise MotionError(f"{label} is not valid JSON: {cause(error)}.") from error
    if not isinstance(found, dict):
        raise MotionError(f"{label} must be a dictionary.")
    return Arrays(found)


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
