"""Pickles of motions, also joblib's, read without running code in them, and written.

A pickle is a program. Only the opcodes that today's writers need are obeyed, and only
numbers, text, plain containers and numpy's arrays of these come out. Traps:

- joblib puts the bytes of an array behind its opcodes, since 1.2 after padding, so its
  files are no valid pickles. They may be compressed as a whole.
- Protocol 2 encodes bytes as text.
- numpy 2 renamed its core to ``numpy._core``, which numpy 1 cannot open.
"""

from __future__ import annotations

import io
import pickle
import re
import struct
from collections.abc import Mapping
from typing import Any, Callable, cast

import numpy as np

from g1_description.errors import MotionError, cause

PICKLE = b"\x80"
"""First byte of pickles, except of the oldest protocols."""

MAX_STEPS = 2_000_000
"""Largest number of opcodes. GMR's pickles have a hundred; in MimicKit's, with one per
number, these are half an hour at 30 Hz."""

MAX_TEXT = 100_000_000
"""Most bytes of text, of scalars, and of arrays that protocol 2 encodes as text."""

MAX_ARGUMENTS = 10
"""Most arguments of a call."""

DTYPE = re.compile(r"[<>=|]?[?biufOSU][0-9]{0,8}")
"""Names of dtypes: numbers, text, and objects, which wrap a dictionary in an npy."""

_OPCODES = b"".join(
    (
        *(pickle.PROTO, pickle.FRAME, pickle.STOP, pickle.MARK, pickle.POP),
        *(pickle.POP_MARK, pickle.NONE, pickle.NEWTRUE, pickle.NEWFALSE),
        *(pickle.BININT, pickle.BININT1, pickle.BININT2, pickle.LONG1, pickle.LONG4),
        *(pickle.BINFLOAT, pickle.BINUNICODE, pickle.SHORT_BINUNICODE),
        *(pickle.BINUNICODE8, pickle.BINSTRING, pickle.SHORT_BINSTRING),
        *(pickle.BINBYTES, pickle.SHORT_BINBYTES, pickle.BINBYTES8),
        *(pickle.BYTEARRAY8, pickle.EMPTY_LIST, pickle.APPEND, pickle.APPENDS),
        *(pickle.EMPTY_DICT, pickle.SETITEM, pickle.SETITEMS, pickle.EMPTY_TUPLE),
        *(pickle.TUPLE, pickle.TUPLE1, pickle.TUPLE2, pickle.TUPLE3, pickle.GLOBAL),
        *(pickle.STACK_GLOBAL, pickle.REDUCE, pickle.NEWOBJ, pickle.BUILD),
        *(pickle.BINPUT, pickle.LONG_BINPUT, pickle.MEMOIZE, pickle.BINGET),
        *(pickle.LONG_BINGET, pickle.BINPERSID),
    )
)
"""What is written since protocol 2, without sets and registered extensions. Text of
older protocols is missing: a long number in it takes hours."""


class Dtype:
    """Replaces ``np.dtype``, which accepts flags that crash numpy."""

    def __init__(self, name: str) -> None:
        if type(name) is not str or not DTYPE.fullmatch(name):
            raise MotionError("it has an array of an unknown dtype")
        self.dtype = np.dtype(name)

    def build(self, state: Any, _: Unpickler) -> None:
        """Set the byte order, the only state of such dtypes."""
        if state[1] in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(state[1])


class Array:
    """Replaces ``np.ndarray``; filled by ``build``."""

    value: Any = np.empty(0)

    def build(self, state: Any, _: Unpickler) -> None:
        """Set shape, dtype, order and bytes; of objects, the list of them."""
        _, shape, kind, is_fortran, content = state
        if kind.dtype.kind == "O":
            if type(content) is not list:
                raise MotionError("it has an array of objects that is not a list")
            self.value = content[0] if shape == () else content
            return
        array = np.frombuffer(content, kind.dtype)
        self.value = array.reshape(shape, order="F" if is_fortran else "C")


class _JoblibArray(Array):
    """Replaces joblib's wrapper of an array, whose bytes follow in the file."""

    def build(self, state: Any, reader: Unpickler) -> None:
        """Read the array."""
        kind, shape = state["dtype"].dtype, state["shape"]
        if kind.kind == "O":
            raise MotionError("it has an array of objects")
        if state.get("numpy_array_alignment_bytes") is not None:
            reader.following(reader.following(1)[0])
        size = kind.itemsize
        for length in shape:
            if type(length) is not int or not 0 <= length <= reader.size:
                raise MotionError("it has an array of an impossible shape")
            size = min(size * length, reader.size + 1)
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

    def __missing__(self, opcode: int) -> Any:
        raise MotionError(f"it has the opcode {opcode:#04x}, which is not allowed")


class Unpickler(pickle._Unpickler):  # type: ignore[name-defined, misc]
    """Resolves only the names that motions need.

    It is Python's own in Python, as joblib's arrays lie between the opcodes.
    """

    stack: list[Any]
    append: Callable[[Any], None]
    read: Callable[[int], bytes]
    pop_mark: Callable[[], list[Any]]

    def __init__(self, data: bytes) -> None:
        self._stream = io.BytesIO(data)
        self.size = len(data)
        """Number of bytes."""
        self._n_text = 0
        super().__init__(self._stream)
        own = {
            pickle.BUILD: Unpickler.load_build,
            pickle.REDUCE: Unpickler.load_reduce,
            pickle.NEWOBJ: Unpickler.load_reduce,
            pickle.SETITEM: Unpickler.load_setitem,
            pickle.SETITEMS: Unpickler.load_setitems,
            pickle.BINUNICODE: Unpickler.load_binunicode,
            pickle.BINUNICODE8: Unpickler.load_binunicode8,
            pickle.BYTEARRAY8: Unpickler.load_bytearray8,
        }
        usual = pickle._Unpickler.dispatch  # type: ignore[attr-defined]
        self.dispatch = _Steps(  # type: ignore[misc]
            {opcode: usual[opcode] for opcode in _OPCODES}
        )
        self.dispatch.update({opcode[0]: method for opcode, method in own.items()})
        self.allowed = self.names()

    def names(self) -> dict[str, Any]:
        """List what replaces the allowed names, mostly functions."""
        return {
            "numpy.core.multiarray._reconstruct": lambda *_: Array(),
            "numpy.core.multiarray.scalar": self._scalar,
            "numpy.core.numeric._frombuffer": self._from_buffer,
            "numpy.ndarray": lambda: Array(),
            "numpy.dtype": lambda name, *_: Dtype(name),
            "collections.OrderedDict": lambda: {},
            "__builtin__.bytes": lambda: b"",  # without bytes, in protocol 2
            "_codecs.encode": self._encoded,
            "joblib.numpy_pickle.NumpyArrayWrapper": lambda *_: _JoblibArray(),
        }

    def find_class(self, module: str, name: str) -> Any:
        """Return the replacement of a name."""
        full = f"{module}.{name}".replace("numpy._core.", "numpy.core.")
        if full not in self.allowed:
            raise MotionError(
                f"it uses {module[:80]}.{name[:80]}, which is not allowed"
            )
        return self.allowed[full]

    def load_reduce(self) -> None:
        """Call a replacement."""
        arguments = self.stack.pop()
        if type(arguments) is not tuple or len(arguments) > MAX_ARGUMENTS:
            raise MotionError("it has wrong arguments of a call")
        self.stack[-1] = self.stack[-1](*arguments)

    def load_build(self) -> None:
        """Set the state of an array; of nothing else."""
        state = self.stack.pop()
        found = self.stack[-1]
        if not isinstance(found, (Array, Dtype)):
            raise MotionError(f"it sets attributes of {type(found).__name__}")
        found.build(state, self)

    def load_setitem(self) -> None:
        """Add an item to a dictionary."""
        value, name = self.stack.pop(), self.stack.pop()
        self._add([name, value])

    def load_setitems(self) -> None:
        """Add items to a dictionary."""
        self._add(self.pop_mark())

    def _add(self, items: list[Any]) -> None:
        """Add items to a dictionary; numbers as names could be made to collide."""
        found = self.stack[-1]
        if type(found) is not dict:
            raise MotionError(f"it sets items of {type(found).__name__}")
        for name, value in zip(items[::2], items[1::2]):
            if isinstance(name, str):
                found[name] = value

    def load_binunicode(self) -> None:
        """Read text."""
        self._add_text(*struct.unpack("<I", self.read(4)))

    def load_binunicode8(self) -> None:
        """Read long text."""
        self._add_text(*struct.unpack("<Q", self.read(8)))

    def _add_text(self, size: int) -> None:
        self._count(size)
        self.append(str(self.read(size), "utf-8", "surrogatepass"))

    def _count(self, size: int) -> None:
        """Limit text, which needs up to four times its bytes."""
        self._n_text += size
        if self._n_text > MAX_TEXT:
            raise MotionError("its text, or arrays encoded as text, are too large")

    def load_bytearray8(self) -> None:
        """Read bytes; Python's own allocates their length before it looks."""
        (size,) = struct.unpack("<Q", self.read(8))
        if size > self.size:
            raise EOFError
        self.append(self.read(size))

    def following(self, size: int) -> bytes:
        """Read bytes that follow an opcode.

        Raises:
            EOFError: If there are fewer.
        """
        content = self._stream.read(size)
        if len(content) < size:
            raise EOFError
        return content

    def _from_buffer(
        self, content: Any, kind: Dtype, shape: Any, order: str, axes: Any = None
    ) -> Array:
        """Make an array of protocol 5; with axes, numpy 2 transposes it."""
        array = Array()
        array.build((1, shape, kind, order == "F", content), self)
        if axes is not None:
            array.value = array.value.transpose(axes)
        return array

    def _encoded(self, text: str, _: str = "latin1") -> bytes:
        """Make bytes, which protocol 2 encodes as text."""
        self._count(len(text))
        return text.encode("latin1")

    def _scalar(self, kind: Dtype, content: bytes) -> Any:
        """Make a number or text of numpy, which is a copy."""
        self._count(kind.dtype.itemsize)
        return np.frombuffer(content, kind.dtype, 1)[0]


def read_pickled(data: bytes, reader: Callable[[bytes], Unpickler] = Unpickler) -> Any:
    """Read a pickle; arguments and errors are those of ``read_pickle``."""
    try:
        return _plain(reader(data).load(), {})
    # Any error of numpy or Python on a damaged file.
    except Exception as error:
        is_cut = isinstance(error, (EOFError, struct.error))
        words = ("truncated", "exhausted")  # of Python's unpickler
        if is_cut or any(word in str(error) for word in words):
            raise MotionError("The pickle ends too early.") from error
        raise MotionError(f"The pickle cannot be read: {cause(error)}.") from error


def read_pickle(
    data: bytes, reader: Callable[[bytes], Unpickler] = Unpickler
) -> dict[str, Any]:
    """Read a pickle of a dictionary; items whose names are not text are left out.

    A list of dictionaries is read as a dictionary of these by their numbers.

    Args:
        data: The pickle; more may follow.
        reader: What resolves its names.

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
        found = {name: _plain(item, known) for name, item in value.items()}
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
