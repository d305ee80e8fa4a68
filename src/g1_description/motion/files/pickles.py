"""Pickles of motions, also joblib's, read without running code in them, and written.

A pickle is a program. Only the names that today's writers need are resolved, to
replacements, and only numbers, text, plain containers and numpy's arrays of these come
out. Traps:

- joblib puts the bytes of an array behind its opcodes, since 1.2 after padding, so its
  files are no valid pickles. They may be compressed as a whole.
- Protocol 2 encodes bytes as text.
- numpy 2 renamed its core to ``numpy._core``, which numpy 1 cannot open.
"""

from __future__ import annotations

import io
import pickle
import re
from collections.abc import Mapping
from typing import Any, Callable, cast

import numpy as np

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
            "numpy.core.multiarray.scalar": lambda *given: _scalar(*given),
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


def _scalar(kind: Dtype, content: bytes) -> Any:
    """Make a number or text of numpy."""
    return np.frombuffer(content, kind.dtype, 1)[0]


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
