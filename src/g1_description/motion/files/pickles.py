"""Pickles of motions, also joblib's, read without running code in them.

A pickle is a program. Only numbers, text, plain containers and numpy's arrays of
numbers are allowed.
"""

from __future__ import annotations

import io
import pickle
import struct
from typing import Any, Callable

import numpy as np

from g1_description.errors import MotionError, cause

PICKLE = b"\x80"
"""First byte of pickles, except of the oldest protocols."""

MAX_STEPS = 1_000_000
"""Largest number of opcodes. GMR's pickles have a hundred, or one per number in
lists."""

MAX_TEXT = 100_000_000
"""Largest size of all arrays in bytes in protocol 2, which encodes them as text."""

MAX_DTYPE = 16
"""Longest name of a dtype."""


class Dtype:
    """Replaces ``np.dtype``, which accepts flags that crash numpy."""

    def __init__(self, name: str) -> None:
        if type(name) is not str or len(name) > MAX_DTYPE:
            raise MotionError("it has an invalid dtype")
        self.dtype = np.dtype(name)
        if self.dtype.kind not in "fiubO":
            raise MotionError(f"it has an array of {self.dtype}")

    def build(self, state: Any, _: Unpickler) -> None:
        """Set the byte order, the only state of numeric dtypes."""
        if state[1] in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(state[1])


class Array:
    """Replaces ``np.ndarray``; filled by ``build``."""

    value: Any = np.empty(0)

    def build(self, state: Any, _: Unpickler) -> None:
        """Set shape, dtype, order and bytes."""
        _, shape, kind, is_fortran, content = state
        if kind.dtype.kind == "O":  # npy files wrap a dictionary like this
            if shape != ():
                raise MotionError("it has an array of objects")
            (self.value,) = content
            return
        array = np.frombuffer(content, kind.dtype)
        self.value = array.reshape(shape, order="F" if is_fortran else "C")


class _JoblibArray(Array):
    """Replaces joblib's wrapper of an array, whose bytes follow in the file."""

    def build(self, state: Any, reader: Unpickler) -> None:
        """Read the array."""
        kind, shape = state["dtype"].dtype, tuple(map(int, state["shape"]))
        if kind.kind == "O":
            raise MotionError("it has an array of objects")
        if state.get("numpy_array_alignment_bytes") is not None:
            reader.following(reader.following(1)[0])
        size = kind.itemsize
        for length in shape:
            size *= length
        array = np.frombuffer(reader.following(size), kind)
        self.value = array.reshape(shape, order=state["order"])


class _Steps(dict):
    """Methods by opcode; refuses pickles that need many."""

    count = 0

    def __getitem__(self, opcode: int) -> Any:
        self.count += 1
        if self.count > MAX_STEPS:
            raise MotionError(f"it has more than {MAX_STEPS} opcodes")
        return super().__getitem__(opcode)


class Unpickler(pickle._Unpickler):  # type: ignore[name-defined, misc]
    """Resolves only the names that motions need.

    It is Python's own in Python: joblib's arrays lie between the opcodes.
    """

    n_encoded = 0
    stack: list[Any]
    append: Callable[[Any], None]
    read: Callable[[int], bytes]

    def __init__(self, data: bytes) -> None:
        self._stream = io.BytesIO(data)
        self._size = len(data)
        super().__init__(self._stream)
        self.dispatch = _Steps(pickle._Unpickler.dispatch)  # type: ignore
        self.dispatch[pickle.BUILD[0]] = Unpickler.load_build
        self.dispatch[pickle.NEWOBJ[0]] = Unpickler.load_newobj
        self.dispatch[pickle.BYTEARRAY8[0]] = Unpickler.load_bytearray8

    def load_build(self) -> None:
        """Set the state of an array; of nothing else."""
        state = self.stack.pop()
        found = self.stack[-1]
        if not isinstance(found, (Array, Dtype)):
            raise MotionError(f"it sets attributes of {type(found).__name__}")
        found.build(state, self)

    def load_bytearray8(self) -> None:
        """Read bytes; Python's own allocates their length before it looks."""
        (size,) = struct.unpack("<Q", self.read(8))
        if size > self._size:
            raise MotionError(f"it has an array of {size} bytes")
        self.append(self.read(size))

    def following(self, size: int) -> bytes:
        """Read bytes that follow an opcode."""
        if not 0 <= size <= self._size:
            raise MotionError(f"it has an array of {size} bytes")
        content = self._stream.read(size)
        if len(content) < size:
            raise MotionError("it ends within an array")
        return content

    def allowed(self) -> dict[str, Callable[..., Any]]:
        """List what replaces the allowed names.

        Functions, as a pickle may set attributes of a class.
        """
        return {
            "numpy.core.multiarray._reconstruct": lambda *_: Array(),
            "numpy.core.multiarray.scalar": self._scalar,
            "numpy.core.numeric._frombuffer": self._from_buffer,
            "numpy.ndarray": lambda: Array(),
            "numpy.dtype": lambda name, *_: Dtype(name),
            "collections.OrderedDict": lambda: {},
            "_codecs.encode": self._encoded,
            "joblib.numpy_pickle.NumpyArrayWrapper": lambda *_: _JoblibArray(),
        }

    def find_class(self, module: str, name: str) -> Any:
        """Return the replacement of a name."""
        # numpy 2 renamed its core.
        full = f"{module}.{name}".replace("numpy._core.", "numpy.core.")
        found = self.allowed().get(full)
        if found is None:
            raise MotionError(
                f"it uses {module[:80]}.{name[:80]}, which is not allowed"
            )
        return found

    def _instantiate(self, what: Any, arguments: Any) -> None:
        self.append(what(*arguments))

    def load_newobj(self) -> None:
        """Make an object; Python's own needs a class."""
        arguments = self.stack.pop()
        self.stack[-1] = self.stack[-1](*arguments)

    def _scalar(self, kind: Dtype, content: bytes) -> Any:
        return np.frombuffer(content, kind.dtype, 1)[0]

    def _from_buffer(self, content: Any, kind: Dtype, shape: Any, order: str) -> Any:
        """Make an array of protocol 5."""
        array = Array()
        array.build((1, shape, kind, order == "F", content), self)
        return array

    def _encoded(self, text: str, _: str = "latin1") -> bytes:
        """Make bytes, which protocol 2 encodes as text."""
        self.n_encoded += len(text)
        if self.n_encoded > MAX_TEXT:
            raise MotionError("its encoded arrays are too large")
        return text.encode("latin1")


def read_pickle(data: bytes, kind: type[Unpickler] = Unpickler) -> dict[str, Any]:
    """Read a pickle of a dictionary.

    Raises:
        MotionError: If it is damaged or has other content.
    """
    try:
        found = plain(kind(data).load())
    # Any error of numpy or Python on a damaged file.
    except Exception as error:
        raise MotionError(f"The pickle cannot be read: {cause(error)}.") from error
    if not isinstance(found, dict):
        raise MotionError(
            f"The pickle must contain a dict (got {type(found).__name__})."
        )
    return {name: value for name, value in found.items() if isinstance(name, str)}


def plain(value: Any, known: dict[int, Any] | None = None) -> Any:
    """Replace ``Array`` by its value in dictionaries and lists.

    Args:
        value: What was read.
        known: The results by the identity of what was read: it may be there many times.
    """
    known = {} if known is None else known
    if id(value) in known or not isinstance(value, (Array, dict, list)):
        return known.get(id(value), value)
    found: Any
    if isinstance(value, Array):
        found = plain(value.value, known)
    elif isinstance(value, dict):
        found = {name: plain(item, known) for name, item in value.items()}
    else:
        found = [plain(item, known) for item in value]
    known[id(value)] = found
    return found
