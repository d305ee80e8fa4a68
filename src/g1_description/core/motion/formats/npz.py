"""The arrays of npz files, read without trust in what the file says of itself."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Collection

import numpy as np

from g1_description.core.errors import MotionError, cause

MAX_BYTES = 100_000_000
"""No array of a motion has more, in bytes."""

MAX_ALL_BYTES = 300_000_000
"""All arrays that are read have no more, in bytes."""

MAX_MEMBERS = 1000
"""Most files in an npz."""

_MEMBER = b"PK\x01\x02"
"""Begins what a zip file says of each of its files."""

MAX_HEADER = 65_536
"""Longest header of an array, in bytes."""

TEXTS = ("joint_names",)
"""Arrays that hold text; all others hold numbers."""

MAX_TEXT = 1_000_000
"""No array of text has more, in bytes."""

_READERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_npz(data: bytes, wanted: Collection[str]) -> dict[str, np.ndarray | None]:
    """Read some arrays of an npz file.

    Args:
        data: The file.
        wanted: Names of the arrays to read.

    Returns:
        The wanted arrays by name; what else the file has is None.

    Raises:
        MotionError: If the file is damaged, or an array is too large or holds objects.
    """
    if data.count(_MEMBER) > MAX_MEMBERS:
        raise MotionError(f"The npz has more than {MAX_MEMBERS} files.")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = _members(archive)
            if not members:
                raise MotionError(_without_arrays(archive))
            size = sum(members[name].file_size for name in wanted if name in members)
            _check_size("The npz", size, MAX_ALL_BYTES)
            return {
                name: _array(archive, info, name) if name in wanted else None
                for name, info in members.items()
            }
    except MotionError:
        raise
    # Whatever a damaged file makes zipfile and numpy raise.
    except Exception as error:
        raise MotionError(f"The npz file is damaged: {cause(error)}.") from error


def _members(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Name the arrays of a file."""
    return {
        info.filename[: -len(".npy")]: info
        for info in archive.infolist()
        if info.filename.endswith(".npy")
    }


def _without_arrays(archive: zipfile.ZipFile) -> str:
    """Say what a zip file without arrays is."""
    if any(name.endswith("/data.pkl") for name in archive.namelist()):
        return "A PyTorch file; convert it to npz or CSV."
    return "A zip file without arrays: not an npz."


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str) -> np.ndarray:
    """Read one array."""
    if info.flag_bits & 1:
        raise MotionError(f"The array {name} is encrypted.")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise MotionError(f"The array {name} is compressed as numpy does not.")
    _check_size(f"The array {name}", info.file_size, MAX_BYTES)
    content = archive.read(info)
    head = io.BytesIO(content[:MAX_HEADER])
    try:
        read = _READERS[np.lib.format.read_magic(head)]
        shape, is_fortran, dtype = read(head)
    except (ValueError, KeyError, SyntaxError, TypeError, RecursionError) as error:
        raise MotionError(f"The array {name} has a damaged header.") from error
    if name in TEXTS:
        if dtype.kind != "U" or len(content) > MAX_TEXT:
            raise MotionError(f"The array {name} holds no names.")
    elif dtype.hasobject or dtype.kind not in "fiub":
        raise MotionError(f"The array {name} holds no numbers.")
    size = dtype.itemsize
    for length in shape:
        size *= int(length)
    if size != len(content) - head.tell():
        raise MotionError(
            f"The array {name} should have {size} bytes by its header and has "
            f"{len(content) - head.tell()}."
        )
    array = np.frombuffer(content, dtype, offset=head.tell())
    return array.reshape(shape, order="F" if is_fortran else "C")


def _check_size(what: str, size: int, most: int) -> None:
    """Refuse a size in bytes."""
    if size > most:
        raise MotionError(
            f"{what} has {size / 1e6:.0f} MB; a motion's has at most "
            f"{most / 1e6:.0f} MB."
        )
