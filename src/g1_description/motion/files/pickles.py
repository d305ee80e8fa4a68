"""Pickles of motions, read without running code in them.

A pickle is a program. Only numbers, text, plain containers and numpy's arrays of
numbers are allowed.
"""

from __future__ import annotations

import io
import pickle
import pickletools
from typing import Any

import numpy as np

from g1_description.errors import MotionError, cause

PICKLE = b"\x80"
"""First byte of pickles, except of the oldest protocols."""

MAX_STEPS = 500_000
"""Largest number of opcodes. GMR's pickles have a hundred, or one per number in
lists."""

MAX_TEXT = 100_000_000
"""Largest size of all arrays in bytes in protocol 2, which encodes them as text."""

MAX_DTYPE = 16
"""Longest name of a dtype."""


class _Dtype:
    """Replaces ``np.dtype``, which accepts flags that crash numpy."""

    def __init__(self, name: str, *_: Any) -> None:
        if type(name) is not str or len(name) > MAX_DTYPE:
            raise MotionError("it has an invalid dtype")
        self.dtype = np.dtype(name)
        if self.dtype.kind not in "fiub":
            raise MotionError(f"it has an array of {self.dtype}")

    def __setstate__(self, state: tuple) -> None:
        """Set the byte order, the only state of numeric dtypes."""
        if state[1] in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(state[1])


class _Array:
    """Replaces ``np.ndarray``; filled by ``__setstate__``."""

    array = np.empty(0)

    def __init__(self, *_: Any) -> None:
        """Ignore the initial shape."""

    def __setstate__(self, state: tuple) -> None:
        """Set shape, dtype, order and bytes."""
        _, shape, kind, is_fortran, content = state
        array = np.frombuffer(content, kind.dtype)
        self.array = array.reshape(shape, order="F" if is_fortran else "C")


class _Unpickler(pickle.Unpickler):
    """Resolves only the names that motions need."""

    n_encoded = 0

    def find_class(self, module: str, name: str) -> Any:
        """Return the replacement of a name."""
        # Bound methods: a pickle may set attributes of a function or class.
        allowed = {
            "numpy.core.multiarray._reconstruct": _Array,
            "numpy.core.multiarray.scalar": self._scalar,
            "numpy.core.numeric._frombuffer": self._from_buffer,
            "numpy.ndarray": _Array,
            "numpy.dtype": _Dtype,
            "collections.OrderedDict": self._ordered_dict,
            "_codecs.encode": self._encoded,
        }
        # numpy 2 renamed its core.
        found = allowed.get(f"{module}.{name}".replace("numpy._core.", "numpy.core."))
        if found is None:
            raise MotionError(
                f"it uses {module[:80]}.{name[:80]}, which is not allowed"
            )
        return found

    def _scalar(self, kind: _Dtype, content: bytes) -> Any:
        return np.frombuffer(content, kind.dtype, 1)[0]

    def _from_buffer(self, content: Any, kind: _Dtype, shape: Any, order: str) -> Any:
        """Make an array of protocol 5."""
        array = _Array()
        array.__setstate__((1, shape, kind, order == "F", content))
        return array

    def _ordered_dict(self) -> dict:
        return {}

    def _encoded(self, text: str, _: str = "latin1") -> bytes:
        """Make bytes, which protocol 2 encodes as text."""
        self.n_encoded += len(text)
        if self.n_encoded > MAX_TEXT:
            raise MotionError("its encoded arrays are too large")
        return text.encode("latin1")


def _check_steps(data: bytes) -> None:
    """Refuse pickles that need much memory: many objects, or large memo indices."""
    for number, (step, argument, _) in enumerate(pickletools.genops(data)):
        if number == MAX_STEPS:
            raise MotionError(f"it has more than {MAX_STEPS} opcodes")
        if step.name.endswith("PUT") and int(argument or 0) > MAX_STEPS:
            raise MotionError(f"it has the memo index {argument}")


def read_pickle(data: bytes) -> dict[str, Any]:
    """Read a pickle of a dictionary.

    Raises:
        MotionError: If it is damaged or has other content.
    """
    if b"joblib.numpy_pickle" in data:
        raise MotionError(
            "The pickle was written by joblib; save it with pickle.dump or numpy.savez."
        )
    try:
        _check_steps(data)
        found = _Unpickler(io.BytesIO(data)).load()
    # Any error of numpy or Python on a damaged file.
    except Exception as error:
        raise MotionError(f"The pickle cannot be read: {cause(error)}.") from error
    if not isinstance(found, dict):
        raise MotionError(
            f"The pickle must contain a dict (got {type(found).__name__})."
        )
    return {
        name: value.array if isinstance(value, _Array) else value
        for name, value in found.items()
        if isinstance(name, str)
    }
