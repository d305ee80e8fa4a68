"""Pickles of motions, as GMR writes them, read without running what they say.

A pickle is a program. Here it may build numbers, text, plain containers and numpy's
arrays; anything else it asks for is refused, and so is what would take long.
"""

from __future__ import annotations

import collections
import io
import pickletools
from collections.abc import Callable
from typing import Any

import numpy as np

from g1_description.errors import MotionError, cause

MAX_STEPS = 500_000
"""Most steps of a pickle. GMR's have a hundred, or one per number where they have lists
of numbers."""

MAX_TEXT = 100_000_000
"""Most bytes of all arrays in a pickle of protocol 2, which has them as text."""

MAX_DTYPE = 16
"""Longest name of a type of numbers."""

CUT = "it is cut short"

_CODES = {step.code: step for step in pickletools.opcodes}

_IGNORED = ("PROTO", "FRAME")

_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}

_INTEGERS = ("BININT", "BININT1", "BININT2", "LONG1", "LONG4")
_TEXTS = ("SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8")
_BYTES = ("SHORT_BINBYTES", "BINBYTES", "BINBYTES8", "BYTEARRAY8")
_VALUES = frozenset(("BINFLOAT", *_INTEGERS, *_TEXTS, *_BYTES))
"""Steps whose argument is an object."""

_EMPTY: dict[str, type] = {"EMPTY_TUPLE": tuple, "EMPTY_LIST": list, "EMPTY_DICT": dict}

_TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
"""Steps that make a tuple of so many objects."""

_PUTS = ("BINPUT", "LONG_BINPUT")
_GETS = ("BINGET", "LONG_BINGET")


class _RefusedError(Exception):
    """A pickle asks for what no motion needs."""


class _Dtype:
    """Stands for a type of numbers."""

    def __init__(self, name: str, *_: Any) -> None:
        if type(name) is not str or len(name) > MAX_DTYPE:
            raise _RefusedError("it has a type that is no text")
        self.dtype = np.dtype(name)
        if self.dtype.kind not in "fiub":
            raise _RefusedError(f"it has an array of {self.dtype}")

    def __setstate__(self, state: tuple) -> None:
        """Take the order of bytes, which is all that numbers have."""
        if state[1] in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(state[1])


class _Array:
    """Stands for an array until its content comes."""

    array = np.empty(0)

    def __init__(self, *_: Any) -> None:
        """Forget the size that the pickle names first."""

    def __setstate__(self, state: tuple) -> None:
        """Take shape, type, order and bytes."""
        _, shape, kind, is_fortran, content = state
        array = np.frombuffer(content, kind.dtype)
        self.array = array.reshape(shape, order="F" if is_fortran else "C")


def _from_buffer(content: bytes, kind: _Dtype, shape: tuple, order: str) -> _Array:
    """Make an array as protocol 5 has it."""
    array = _Array()
    array.__setstate__((1, shape, kind, order == "F", content))
    return array


def _scalar(kind: _Dtype, content: bytes) -> Any:
    """Make one number."""
    return np.frombuffer(content, kind.dtype, 1)[0]


_ALLOWED: dict[tuple[str, str], Any] = {
    **{
        (f"numpy.{core}.multiarray", name): value
        for core in ("core", "_core")
        for name, value in (("_reconstruct", _Array), ("scalar", _scalar))
    },
    **{
        (f"numpy.{core}.numeric", "_frombuffer"): _from_buffer
        for core in ("core", "_core")
    },
    ("numpy", "ndarray"): "numpy.ndarray",
    ("numpy", "dtype"): _Dtype,
    ("collections", "OrderedDict"): lambda: collections.OrderedDict(),
}
"""What a pickle may name, and what it gets."""


class _Machine:
    """Takes the steps that picklers of protocol 2 and later need for a motion."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._stack: list[Any] = []
        self._below: list[list[Any]] = []
        """The stacks under each mark."""
        self._memo: dict[int, Any] = {}
        self._n_encoded = 0

    def run(self, data: bytes) -> Any:
        """Return the object that a pickle makes.

        Raises:
            Exception: Of whatever kind, if it is damaged or asks for something else.
        """
        stream = io.BytesIO(data)
        for _ in range(MAX_STEPS):
            code = stream.read(1).decode("latin-1")
            step = _CODES.get(code)
            if step is None:
                raise _RefusedError(f"it has a step {code!r}" if code else CUT)
            if step.name == "STOP":
                return self._stack.pop()
            if step.name not in _STEPS:
                raise _RefusedError(f"it has a step {step.name}")
            self._take(step.name, step.arg.reader(stream) if step.arg else None)
        raise _RefusedError(f"it has more than {MAX_STEPS} steps")

    def _take(self, name: str, argument: Any) -> None:
        """Take a step."""
        if name in _VALUES:
            self._stack.append(argument)
        elif name in _CONSTANTS:
            self._stack.append(_CONSTANTS[name])
        elif name in _EMPTY:
            self._stack.append(_EMPTY[name]())
        elif name in _TUPLES:
            self._stack.append(
                tuple([self._stack.pop() for _ in range(_TUPLES[name])][::-1])
            )
        elif name in _PUTS:
            self._memo[argument] = self._stack[-1]
        elif name in _GETS:
            if argument not in self._memo:
                raise _RefusedError("it uses an object that it has not kept")
            self._stack.append(self._memo[argument])
        elif name not in _IGNORED:
            _ACTIONS[name](self, argument)

    def _mark(self, _: Any) -> None:
        self._below.append(self._stack)
        self._stack = []

    def _marked(self) -> list[Any]:
        """Return what came since the last mark."""
        found, self._stack = self._stack, self._below.pop()
        return found

    def _memoize(self, _: Any) -> None:
        self._memo[len(self._memo)] = self._stack[-1]

    def _tuple(self, _: Any) -> None:
        found = tuple(self._marked())
        self._stack.append(found)

    def _append(self, _: Any) -> None:
        value = self._stack.pop()
        self._stack[-1].append(value)

    def _appends(self, _: Any) -> None:
        found = self._marked()
        self._stack[-1].extend(found)

    def _setitem(self, _: Any) -> None:
        value, key = self._stack.pop(), self._stack.pop()
        self._set([key, value])

    def _setitems(self, _: Any) -> None:
        self._set(self._marked())

    def _set(self, found: list[Any]) -> None:
        """Fill the dictionary on top; a key of nested tuples is looked up for ever."""
        for key in found[::2]:
            if type(key) not in (str, int, float):
                kind = type(key).__name__
                raise _RefusedError(f"it has a dictionary with a {kind} as key")
        self._stack[-1].update(zip(found[::2], found[1::2]))

    def _global(self, argument: str) -> None:
        self._name(*argument.split(" ", 1))

    def _stack_global(self, _: Any) -> None:
        name, module = self._stack.pop(), self._stack.pop()
        self._name(module, name)

    def _name(self, module: str, name: str) -> None:
        """Give what may be named."""
        if type(module) is not str or type(name) is not str:
            raise _RefusedError("it asks for something without a name")
        found = _ALLOWED.get((module, name))
        if (module, name) == ("_codecs", "encode"):
            found = self._encoded
        if module.startswith("joblib."):
            raise _RefusedError(
                "it was written by joblib; save it with pickle.dump or numpy.savez"
            )
        if found is None:
            raise _RefusedError(f"it asks for {module[:80]}.{name[:80]}")
        self._stack.append(found)

    def _reduce(self, _: Any) -> None:
        arguments, function = self._stack.pop(), self._stack.pop()
        if type(arguments) is not tuple:
            raise _RefusedError("it calls something without arguments")
        self._stack.append(function(*arguments))

    def _build(self, _: Any) -> None:
        state = self._stack.pop()
        if not isinstance(self._stack[-1], (_Array, _Dtype)):
            raise _RefusedError("it sets the state of what has none")
        self._stack[-1].__setstate__(state)

    def _encoded(self, text: str, encoding: str = "latin1") -> bytes:
        """Make bytes, which protocol 2 has as text."""
        self._n_encoded += len(text)
        if self._n_encoded > MAX_TEXT:
            raise _RefusedError("it has too much to encode")
        return text.encode("latin1")


_ACTIONS: dict[str, Callable[[_Machine, Any], None]] = {
    "MARK": _Machine._mark,
    "MEMOIZE": _Machine._memoize,
    "TUPLE": _Machine._tuple,
    "APPEND": _Machine._append,
    "APPENDS": _Machine._appends,
    "SETITEM": _Machine._setitem,
    "SETITEMS": _Machine._setitems,
    "GLOBAL": _Machine._global,
    "STACK_GLOBAL": _Machine._stack_global,
    "REDUCE": _Machine._reduce,
    "BUILD": _Machine._build,
}

_STEPS = {
    *_IGNORED,
    *_VALUES,
    *_CONSTANTS,
    *_EMPTY,
    *_TUPLES,
    *_PUTS,
    *_GETS,
    *_ACTIONS,
}


def read_gmr_pickle(data: bytes) -> dict[str, Any]:
    """Read a pickle whose top level is a dictionary.

    Args:
        data: The file.

    Raises:
        MotionError: If it is damaged or holds something else.
    """
    try:
        found = _Machine().run(data)
    # Whatever a hostile file makes numpy and Python raise.
    except Exception as error:
        raise MotionError(f"The pickle cannot be read: {cause(error)}.") from error
    if not isinstance(found, dict):
        raise MotionError(f"The pickle holds no dictionary but {type(found).__name__}.")
    return {
        name: value.array if isinstance(value, _Array) else value
        for name, value in found.items()
        if isinstance(name, str)
    }
