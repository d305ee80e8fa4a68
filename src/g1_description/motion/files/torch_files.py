"""Files of torch.save, read without torch: tensors of numbers, by name.

A file is a zip of ``NAME/data.pkl``, a pickle of protocol 2, and ``NAME/data/KEY``, the
numbers of each storage. A tensor is a view of a storage, by offset and strides, so it
may be a few of its columns.
"""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided

from g1_description.errors import MotionError
from g1_description.motion.files.pickles import Unpickler, read_pickle

PICKLE_NAME = "/data.pkl"
"""Member by which a zip of torch.save is recognised."""

STORAGES = {
    "Float": "<f4",
    "Double": "<f8",
    "Half": "<f2",
    "Long": "<i8",
    "Int": "<i4",
    "Short": "<i2",
    "Char": "i1",
    "Byte": "u1",
    "Bool": "?",
}
"""Types of numbers by the names of torch's storages."""

MAX_AXES = 32


def read_torch(content: bytes) -> dict[str, Any]:
    """Read the dictionary in a file of torch.save.

    Raises:
        MotionError: If it is damaged or has other content.
        zipfile.BadZipFile: If it is no zip.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = [name for name in archive.namelist() if name.endswith(PICKLE_NAME)]
        if not names:
            raise MotionError("The file of torch has no data.pkl.")
        folder = names[0][: -len(PICKLE_NAME)]
        storages = _Storages(archive, folder, len(content))
        data = storages.member("data.pkl")
        return read_pickle(data, lambda data: _Unpickler(data, storages))


class _Storages:
    """Numbers in the file, read when they are requested."""

    def __init__(self, archive: zipfile.ZipFile, folder: str, size: int) -> None:
        self._archive, self._folder = archive, folder
        self._known: dict[str, np.ndarray] = {}
        self._left = size

    def member(self, name: str) -> bytes:
        """Read a member; all have at most the size of the file, as torch packs none."""
        info = self._archive.getinfo(f"{self._folder}/{name}")
        self._left -= info.file_size
        if self._left < 0:
            raise MotionError("The file of torch claims more data than it has.")
        return self._archive.read(info)

    def numbers(self, key: str, kind: str) -> np.ndarray:
        """Read a storage."""
        if key not in self._known:
            self._known[key] = np.frombuffer(self.member(f"data/{key}"), kind)
        return self._known[key]


class _Unpickler(Unpickler):
    """Also resolves tensors."""

    def __init__(self, data: bytes, storages: _Storages) -> None:
        super().__init__(data)
        self._storages = storages

    def names(self) -> dict[str, Any]:
        """List replacements of the allowed names."""
        kinds = {f"torch.{name}Storage": kind for name, kind in STORAGES.items()}
        return {
            **super().names(),
            **kinds,
            "torch._utils._rebuild_tensor_v2": lambda *given: _tensor(*given),
            "torch._utils._rebuild_parameter": lambda tensor, *_: tensor,
            "torch.Size": lambda numbers: _size(numbers),
        }

    def find_class(self, module: str, name: str) -> Any:
        """Return the replacement of a name; ProtoMotions' enumeration becomes None."""
        if name == "StateConversion":
            return lambda *_: None
        return super().find_class(module, name)

    def persistent_load(self, pid: Any) -> np.ndarray:
        """Return the numbers of a storage."""
        tag, kind, key, _, count = pid
        if tag != "storage" or kind not in STORAGES.values() or type(key) is not str:
            raise MotionError("it has an unknown storage")
        return self._storages.numbers(key, kind)[:count]


def _size(numbers: Any) -> tuple[int, ...]:
    """Return a shape; a tensor could be a view of one number, a billion times."""
    if type(numbers) is not tuple:
        raise MotionError("it has a size that is not a tuple")
    return numbers


def _tensor(storage: Any, offset: Any, size: Any, stride: Any, *_: Any) -> np.ndarray:
    """Make a view of a storage."""
    if not isinstance(storage, np.ndarray) or len(size) != len(stride):
        raise MotionError("it has a tensor without a storage")
    numbers = (offset, *size, *stride)
    if len(size) > MAX_AXES or not all(
        type(number) is int and 0 <= number <= 2**40 for number in numbers
    ):
        raise MotionError("it has a tensor of an impossible shape")
    if 0 in size:
        return np.empty(size, storage.dtype)
    last = offset + sum((n - 1) * step for n, step in zip(size, stride))
    if last >= len(storage):
        raise MotionError("it has a tensor that is larger than its storage")
    steps = [step * storage.itemsize for step in stride]
    found: np.ndarray = as_strided(storage[offset:], size, steps, writeable=False)
    return found
