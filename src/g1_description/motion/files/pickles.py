"""Pickles of motions, also joblib's and torch's, read without running their code.

A pickle is a program. Only the names that today's writers need are resolved, to
replacements, and only numbers, text, plain containers and numpy's arrays of these come
out. Traps:

- joblib puts the bytes of an array behind its opcodes, since 1.2 after padding, so its
  files are no valid pickles. They may be compressed as a whole.
- Protocol 2 encodes bytes as text.
- numpy 2 renamed its core to ``numpy._core``, which numpy 1 cannot open.
- A file of torch.save is a zip of ``NAME/data.pkl``, a pickle of protocol 2, and
  ``NAME/data/KEY``, the numbers of each storage. A tensor is a view of a storage, by
  offset and strides, so it may be a few of its columns.
"""

from __future__ import annotations

import io
import pickle
import re
import zipfile
from collections.abc import Mapping
from typing import Any, Callable, cast

import numpy as np
from numpy.lib.stride_tricks import as_strided

from g1_description.errors import MotionError, cause

PICKLE = b"\x80"
"""First byte of pickles, except of the oldest protocols."""

DTYPE = re.compile(r"[<>=|]?[?biufOSU][0-9]{0,8}")
"""Names of dtypes: numbers, text, and objects, which wrap a dictionary in an npy."""


class Dtype:
    """Replaces ``np.dtype``, which accepts flags that crash numpy."""

    def __init__(self, name: str, *_: Any) -> None:
        if not DTYPE.fullmatch(name):
            raise MotionError("it has an array of an unknown dtype")
        self.dtype = np.dtype(name)

    def __setstate__(self, state: Any) -> None:
        """Set the byte order, the only state of such dtypes."""
        if state[1] in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(state[1])


class Array:
    """Replaces ``np.ndarray``; filled by ``__setstate__``."""

    value: Any = np.empty(0)

    def __setstate__(self, state: Any) -> None:
        """Set shape, dtype, order and bytes; of objects, the list of them."""
        _, shape, kind, is_fortran, content = state
        if kind.dtype.kind == "O":
            if type(content) is not list:
                raise MotionError("it has an array of objects that is not a list")
            self.value = content[0] if shape == () else content
            return
        array = np.frombuffer(content, kind.dtype)
        self.value = array.reshape(shape, order="F" if is_fortran else "C")


class Unpickler(pickle._Unpickler):  # type: ignore[name-defined, misc]
    """Resolves only the names that motions need.

    It is Python's own in Python, as joblib's is: arrays lie between the opcodes, and a
    damaged index of its memo takes no memory.
    """

    def __init__(self, data: bytes) -> None:
        self._stream = io.BytesIO(data)
        super().__init__(self._stream)
        self._names = self.names()

    def names(self) -> dict[str, Any]:
        """List the replacements of the allowed names.

        Functions are made for each pickle, as it may set their attributes.
        """
        read_array = self._following_array

        class JoblibArray(Array):
            """Replaces joblib's wrapper of an array, whose bytes follow in the file."""

            def __setstate__(self, state: Any) -> None:
                self.value = read_array(state)

        return {
            "numpy.core.multiarray._reconstruct": lambda *_: Array(),
            "numpy.core.multiarray.scalar": lambda kind, data: np.frombuffer(
                data, kind.dtype, 1
            )[0],
            "numpy.core.numeric._frombuffer": lambda *given: _from_buffer(*given),
            "numpy.ndarray": Array,
            "numpy.dtype": Dtype,
            "collections.OrderedDict": dict,
            "__builtin__.bytes": lambda *_: b"",  # without bytes, in protocol 2
            "_codecs.encode": lambda text, *_: text.encode("latin1"),
            "joblib.numpy_pickle.NumpyArrayWrapper": JoblibArray,
        }

    def find_class(self, module: str, name: str) -> Any:
        """Return the replacement of a name."""
        full = f"{module}.{name}".replace("numpy._core.", "numpy.core.")
        if full not in self._names:
            raise MotionError(
                f"it uses {module[:80]}.{name[:80]}, which is not allowed"
            )
        return self._names[full]

    def _following_array(self, state: Any) -> np.ndarray:
        """Read an array of joblib, which follows the opcode."""
        kind, shape = state["dtype"].dtype, state["shape"]
        if kind.kind == "O":
            raise MotionError("it has an array of objects")
        if state.get("numpy_array_alignment_bytes") is not None:
            self._stream.read(self._stream.read(1)[0])
        count = int(np.prod(shape, dtype=float))
        content = self._stream.read(count * kind.itemsize)
        array = np.frombuffer(content, kind, count if count else -1)
        return array.reshape(shape, order=state["order"])


def _from_buffer(
    content: Any, kind: Dtype, shape: Any, order: str, axes: Any = None
) -> Array:
    """Make an array of protocol 5; with axes, numpy 2 transposes it."""
    array = Array()
    array.__setstate__((1, shape, kind, order == "F", content))
    if axes is not None:
        array.value = array.value.transpose(axes)
    return array


def read_pickled(data: bytes, reader: Callable[[bytes], Unpickler] = Unpickler) -> Any:
    """Read a pickle; arguments and errors are those of ``read_pickle``."""
    try:
        return _plain(reader(data).load(), {})
    # Any error of numpy or Python on a damaged file.
    except Exception as error:
        words = ("truncated", "exhausted", "smaller than requested")
        is_cut = any(word in str(error).lower() for word in words)
        if is_cut or isinstance(error, EOFError):
            raise MotionError("The pickle ends too early.") from error
        raise MotionError(f"The pickle cannot be read: {cause(error)}.") from error


def read_pickle(
    data: bytes, reader: Callable[[bytes], Unpickler] = Unpickler
) -> dict[str, Any]:
    """Read a pickle of a dictionary; items whose names are not text are left out.

    A list of dictionaries is read as a dictionary of these by their numbers.

    Args:
        data: The pickle; more may follow.
        reader: The unpickler, which resolves names.

    Raises:
        MotionError: If it is damaged or has other content.
    """
    found = read_pickled(data, reader)
    if isinstance(found, list) and found and all(type(d) is dict for d in found):
        found = {str(number): item for number, item in enumerate(found)}
    if not isinstance(found, dict):
        raise MotionError(
            f"The pickle must contain a dict (got {type(found).__name__})."
        )
    if not found:
        raise MotionError("The pickle has no items with names.")
    return found


_CONTAINERS = (Array, dict, list, tuple)


def _plain(value: Any, known: dict[int, Any]) -> Any:
    """Replace ``Array`` by its value, also in containers.

    ``known`` has results by the identity of what was read: it may be there many times.
    """
    if id(value) in known or not isinstance(value, _CONTAINERS):
        return known.get(id(value), value)
    found: Any
    if isinstance(value, Array):
        found = _plain(value.value, known)
    elif isinstance(value, dict):
        items = ((k, v) for k, v in value.items() if isinstance(k, str))
        found = {name: _plain(item, known) for name, item in items}
    else:
        found = [
            _plain(item, known) if isinstance(item, _CONTAINERS) else item
            for item in value
        ]
    known[id(value)] = found
    return found


def pickled(content: Mapping[str, Any]) -> bytes:
    """Write a pickle that numpy 1 and 2, and joblib, open.

    Args:
        content: Arrays, numbers and lists by name.
    """
    # Protocol 3 has names as text, and no frames; numpy 1 knows only the old name.
    data = pickle.dumps(dict(content), 3)
    return cast(bytes, data.replace(b"cnumpy._core.", b"cnumpy.core."))


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
        return read_pickle(data, lambda data: TorchUnpickler(data, storages))


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


class TorchUnpickler(Unpickler):
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
    if len(size) > 32 or not all(
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
