"""Old libraries get what viser needs of newer ones, and new ones are left alone."""

from types import SimpleNamespace
from typing import List, get_type_hints

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import mutually_broadcastable_shapes

from g1_description.web.old_libraries import complete


@pytest.fixture(scope="module")
def old():
    """Give what stands for numpy 1.17, completed, and the modules beside it."""
    modules = {}
    numpy = SimpleNamespace()
    complete(numpy, modules)
    return numpy, modules


def test_types_can_be_named_in_annotations(old):
    numpy, modules = old
    types = modules["numpy.typing"]
    assert numpy.typing is types

    def move(by: List[types.NDArray[np.float64]], kind: types.DTypeLike) -> None: ...

    assert get_type_hints(move)["by"] == List[types.NDArray[np.float64]]


def test_arrays_of_different_elements_are_different(old):
    """By that viser chooses what it makes of an array; a float16 is too coarse."""
    arrays = old[1]["numpy.typing"].NDArray
    assert arrays[np.float32] == arrays[np.float32]
    assert arrays[np.float32] != arrays[np.float16]
    assert issubclass(arrays[np.float32], np.ndarray)


@given(mutually_broadcastable_shapes(num_shapes=3))
def test_shapes_go_together_as_hypothesis_says(old, shapes):
    assert old[0].broadcast_shapes(*shapes.input_shapes) == shapes.result_shape


def test_shapes_that_do_not_go_together_are_refused(old):
    with pytest.raises(ValueError, match="broadcast"):
        old[0].broadcast_shapes((2,), (3,))


def test_a_newer_numpy_stays_as_it_is():
    numpy = SimpleNamespace(broadcast_shapes=np.broadcast)
    modules = {}
    complete(numpy, modules)
    assert (vars(numpy), modules) == ({"broadcast_shapes": np.broadcast}, {})
