"""Parts of libraries that viser needs and Ubuntu 20.04 lacks: numpy 1.17, Python 3.8.

viser asks for no version of numpy, but names types of ``numpy.typing`` of 1.20 in
annotations, by which it also converts arrays, and calls its ``broadcast_shapes``. The
package imports this module before any other of its own, so before viser.
"""

from __future__ import annotations

import sys
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np


class _NDArray:
    """Stands for an array with elements of some type."""

    def __class_getitem__(cls, element: Any) -> type:
        """Give the type of arrays with these elements."""
        return _array_of(element)


@lru_cache(maxsize=None)
def _array_of(element: Any) -> type:
    """Make a type that is the same for the same elements only: viser compares them."""
    return type("NDArray", (np.ndarray,), {})


def _typing() -> ModuleType:
    """Make the names of ``numpy.typing`` that annotations need."""
    module: Any = ModuleType("numpy.typing", "Made by g1_description for viser.")
    module.NDArray, module.ArrayLike, module.DTypeLike = _NDArray, Any, Any
    return module


def _broadcast_shapes(*shapes: Any) -> tuple[int, ...]:
    """Give the shape that arrays of these shapes have together.

    Args:
        shapes: Of one array each: numbers of elements, or one number.

    Raises:
        ValueError: If they do not go together.
    """
    # numpy's own broadcast takes 32 at most; elements of no size take no memory.
    together: tuple[int, ...] = ()
    for shape in shapes:
        arrays = np.empty(together, dtype=[]), np.empty(shape, dtype=[])
        together = np.broadcast(*arrays).shape
    return together


def complete(numpy: Any, modules: dict[str, Any]) -> None:
    """Add the names that are missing.

    Args:
        numpy: The module to complete.
        modules: Those that are imported, by name.
    """
    if not hasattr(numpy, "broadcast_shapes"):
        numpy.broadcast_shapes = _broadcast_shapes
        numpy.typing = modules["numpy.typing"] = _typing()


complete(np, sys.modules)
