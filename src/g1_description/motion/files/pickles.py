"""Pickles of motions, read without running what they say.

A pickle is a program. This one may make numbers, text, plain containers and numpy's
arrays of numbers, and call nothing but what makes these.
"""

from __future__ import annotations

import io
import pickle
import pickletools
from typing import Any

import numpy as np

from g1_description.errors import MotionError, cause

PICKLE = b"\x80"
"""Begins pickles of all protocols but the oldest."""

MAX_STEPS = 500_000
"""Most steps of a pickle. GMR's have a hundred, or one per number where they have lists
of numbers."""

MAX_TEXT = 100_000_000
"""Most bytes of all arrays in a pickle of protocol 2, which has them as text."""

MAX_DTYPE = 16
"""Longest name of a type of numbers."""


class _Dtype:
    """Stands for a type of numbers: ``np.dtype`` takes flags that crash numpy."""

    def __init__(self, name: str, *_: Any) -> None:
        if type(name) is not str or len(name) > MAX_DTYPE:
            raise MotionError("it has a type of numbers without a short name")
        self.dtype = np.dtype(name)
        if self.dtype.kind not in "fiub":
            raise MotionError(f"it has an array of {self.dtype}")

    def __setstate__(self, state: tuple) -> None:
        """Take the order of bytes, which is all that numbers have."""
        if state[1] in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(state[1])


class _Array:
    """Stands for an array until its content comes."""

    array = np.empty(0)

    def __init__(self, *_: Any) -> None:
        """Ignore the size that the pickle names first."""

    def __setstate__(self, state: tuple) -> None:
        """Take shape, type, order and bytes."""
        _, shape, kind, is_fortran, content = state
        array = np.frombuffer(content, kind.dtype)
        self.array = array.reshape(shape, order="F" if is_fortran else "C")


class _Unpickler(pickle.Unpickler):
    """Gives out only the names that motions need."""

    n_encoded = 0

    def find_class(self, module: str, name: str) -> Any:
        """Return what stands for a name."""
        # Methods, as a pickle may set attributes of a function or class.
        allowed = {
            "numpy.core.multiarray._reconstruct": _Array,
            "numpy.core.multiarray.scalar": self._scalar,
            "numpy.core.numeric._frombuffer": self._from_buffer,
            "numpy.ndarray": _Array,
            "numpy.dtype": _Dtype,
            "collections.OrderedDict": self._ordered_dict,
            "_codecs.encode": self._encoded,
        }
        # Numpy 2 has renamed its core.
        found = allowed.get(f"{module}.{name}".replace("numpy._core.", "numpy.core."))
        if found is None:
            raise MotionError(f"it asks for {module[:80]}.{name[:80]}")
        return found

    def _scalar(self, kind: _Dtype, content: bytes) -> Any:
        return np.frombuffer(content, kind.dtype, 1)[0]

    def _from_buffer(self, content: Any, kind: _Dtype, shape: Any, order: str) -> Any:
        """Make an array as protocol 5 has it."""
        array = _Array()
        array.__setstate__((1, shape, kind, order == "F", content))
        return array

    def _ordered_dict(self) -> dict:
        return {}

    def _encoded(self, text: str, _: str = "latin1") -> bytes:
        """Make bytes, which protocol 2 has as text."""
        self.n_encoded += len(text)
        if self.n_encoded > MAX_TEXT:
            raise MotionError("it has too much to encode")
        return text.encode("latin1")


def _check_steps(data: bytes) -> None:
    """Refuse what would take much memory: many objects, or a large table of them."""
    for number, (step, argument, _) in enumerate(pickletools.genops(data)):
        if number == MAX_STEPS:
            raise MotionError(f"it has more than {MAX_STEPS} steps")
        if step.name.endswith("PUT") and int(argument or 0) > MAX_STEPS:
            raise MotionError(f"it numbers an object {argument}")


def read_pickle(data: bytes) -> dict[str, Any]:
    """Read a pickle whose top level is a dictionary.

    Raises:
        MotionError: If it is damaged or holds something else.
    """
    if b"joblib.numpy_pickle" in data:
        raise MotionError(
            "The pickle was written by joblib; save it with pickle.dump or numpy.savez."
        )
    try:
        _check_steps(data)
        found = _Unpickler(io.BytesIO(data)).load()
    # Whatever a damaged file makes numpy and Python raise.
    except Exception as error:
        raise MotionError(f"The pickle cannot be read: {cause(error)}.") from error
    if not isinstance(found, dict):
        raise MotionError(f"The pickle holds no dictionary but {type(found).__name__}.")
    return {
        name: value.array if isinstance(value, _Array) else value
        for name, value in found.items()
        if isinstance(name, str)
    }
