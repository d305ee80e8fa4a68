"""Pickles of motions, as GMR writes them, read without running what they say.

A pickle is a program. Here it may build numbers, text, plain containers and numpy's
arrays; anything else it asks for is refused.
"""

from __future__ import annotations

import collections
import io
import pickle
import pickletools
from typing import Any

import numpy as np

from g1_description.core.errors import MotionError

MAX_MEMO = 1_000_000
"""Most objects that a pickle may keep: it names a place for each, and Python makes
room up to there."""


MAX_TEXT = 50_000_000
"""Longest bytes of an array in a pickle of protocol 2."""

_PUTS = ("PUT", "BINPUT", "LONG_BINPUT")


class _Dtype:
    """Stands for a type of numbers."""

    def __init__(self, name: str, *_: Any) -> None:
        if type(name) is not str:
            raise pickle.UnpicklingError("it has a type that is no text")
        self.dtype = np.dtype(name)
        if self.dtype.kind not in "fiub":
            raise pickle.UnpicklingError(f"it has an array of {self.dtype}")

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


def _encoded(text: str, encoding: str = "latin1") -> bytes:
    """Make bytes, which protocol 2 has as text."""
    if type(text) is not str or len(text) > MAX_TEXT:
        raise pickle.UnpicklingError("it has too much to encode")
    return text.encode("latin1")


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
    ("_codecs", "encode"): _encoded,
}
"""What a pickle may name, and what it gets."""


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """Give what may be named."""
        try:
            return _ALLOWED[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"it asks for {module}.{name}") from None


def read_gmr_pickle(data: bytes) -> dict[str, Any]:
    """Read a pickle whose top level is a dictionary.

    Args:
        data: The file.

    Raises:
        MotionError: If it is damaged or holds something else.
    """
    try:
        _check_memo(data)
        found = _Unpickler(io.BytesIO(data)).load()
    except MotionError:
        raise
    # Whatever a hostile file makes numpy and pickle raise.
    except Exception as error:
        problem = (str(error) or type(error).__name__).splitlines()[0][:200]
        raise MotionError(f"The pickle cannot be read: {problem}.") from error
    if not isinstance(found, dict):
        raise MotionError(f"The pickle holds no dictionary but {type(found).__name__}.")
    return {
        name: value.array if isinstance(value, _Array) else value
        for name, value in found.items()
        if isinstance(name, str)
    }


def _check_memo(data: bytes) -> None:
    """Refuse places in the memo for which Python would need too much room."""
    for code, argument, _ in pickletools.genops(data):
        if code.name in _PUTS and int(argument or 0) > MAX_MEMO:
            raise MotionError(
                f"The pickle keeps an object at place {argument}; there may be "
                f"{MAX_MEMO}."
            )
