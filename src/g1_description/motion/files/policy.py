"""The reference motion inside a tracking policy in ONNX (BeyondMimic, mjlab).

The outputs ``joint_pos``, ``body_pos_w`` and ``body_quat_w`` are rows of arrays that
the graph gathers by the time step. Traps:

- The arrays are initializers or constants of any name: they are found by going back
  from the outputs.
- Names of joints and bodies are in the metadata: Isaac Lab's order from
  whole_body_tracking, MuJoCo's from mjlab. Quaternions are w x y z.
- There is no rate; such policies run at 50 Hz.

ONNX is protobuf: a message is a row of fields, each a number or bytes, which may be a
message in turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Union

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.array_formats import TRACKED, read_arrays
from g1_description.motion.files.arrays import Arrays
from g1_description.motion.files.format import Format
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.text import listed

BEGIN = b"\x08"
"""First byte: the field of the version."""

POSITIONS, VELOCITIES = "joint_pos", "joint_vel"
PLACES, TURNS = "body_pos_w", "body_quat_w"

MAX_FIELDS = 500_000
"""Most fields of a file that are looked at; a policy has some thousands."""

MAX_DEPTH = 20
"""Most nodes between an output and its array."""

FORWARDING = ("Gather", "Identity", "Cast", "Reshape", "Squeeze", "Unsqueeze", "Slice")
"""Operations that take their numbers from their first input."""

TYPES = {1: "<f4", 10: "<f2", 11: "<f8"}
"""Types of numbers of a tensor."""

# Numbers of fields in ONNX's messages.
MODEL_GRAPH, MODEL_METADATA = 7, 14
GRAPH_NODE, GRAPH_INITIALIZER, GRAPH_OUTPUT = 1, 5, 12
NODE_INPUT, NODE_OUTPUT, NODE_TYPE, NODE_ATTRIBUTE = 1, 2, 4, 5
ATTRIBUTE_TENSOR = 5
TENSOR_SHAPE, TENSOR_TYPE, TENSOR_FLOATS, TENSOR_NAME = 1, 2, 4, 8
TENSOR_BYTES, TENSOR_DOUBLES, TENSOR_PLACE = 9, 10, 14

Field = Union[int, memoryview]


def recognise(source: MotionSource) -> bool:
    """Return whether a file is an ONNX model, by its ending or its outputs."""
    if source.ending in FORMAT.endings:
        return True
    return source.head.startswith(BEGIN) and TURNS.encode() in source.data


def read(source: MotionSource, robot: Description) -> Motion:
    """Read the reference motion.

    Raises:
        MotionError: If the model is damaged, or has no such motion.
    """
    model = _Model(memoryview(source.data))
    names = {key: model.names(key) for key in ("joint_names", "body_names")}
    found = Arrays({**model.references(), **names})
    return read_arrays(source, found, robot, TRACKED, "wxyz")


class _Model:
    """The parts of a model that lead to its reference motion."""

    def __init__(self, data: memoryview) -> None:
        self._n_fields = 0
        self._metadata: dict[str, str] = {}
        self._tensors: dict[str, memoryview] = {}
        self._nodes: dict[str, tuple[str, str]] = {}
        self._outputs: list[str] = []
        for field, value in self._fields(data):
            if field == MODEL_METADATA:
                pair = dict(self._fields(value))
                self._metadata[_text(pair.get(1))] = _text(pair.get(2))
            for part, content in self._fields(value) if field == MODEL_GRAPH else ():
                if part == GRAPH_NODE:
                    self._add_node(content)
                elif part == GRAPH_INITIALIZER:
                    name = dict(self._fields(content)).get(TENSOR_NAME)
                    self._tensors[_text(name)] = _bytes(content)
                elif part == GRAPH_OUTPUT:
                    self._outputs.append(_text(dict(self._fields(content)).get(1)))

    def _add_node(self, data: Field) -> None:
        """Note where a node takes its numbers from, or the tensor of a constant."""
        inputs, outputs, kind = [], [], ""
        tensor = None
        for field, value in self._fields(data):
            if field == NODE_INPUT:
                inputs.append(_text(value))
            elif field == NODE_OUTPUT:
                outputs.append(_text(value))
            elif field == NODE_TYPE:
                kind = _text(value)
            elif field == NODE_ATTRIBUTE:
                tensor = dict(self._fields(value)).get(ATTRIBUTE_TENSOR, tensor)
        if kind == "Constant" and outputs and tensor is not None:
            self._tensors[outputs[0]] = _bytes(tensor)
        elif inputs and outputs:
            self._nodes[outputs[0]] = kind, inputs[0]

    def names(self, key: str) -> tuple[str, ...]:
        """Read a list of names in the metadata."""
        if key not in self._metadata:
            raise MotionError(f"The metadata of the policy lack {key}.")
        return tuple(name.strip() for name in self._metadata[key].split(","))

    def references(self) -> dict[str, np.ndarray]:
        """Read the arrays that outputs are gathered from, by output."""
        missing = [n for n in (POSITIONS, PLACES, TURNS) if n not in self._outputs]
        if missing:
            raise MotionError(
                "The policy has no reference motion: it has the outputs "
                f"{listed(self._outputs) or 'none'}, but not {listed(missing)}."
            )
        names = (POSITIONS, VELOCITIES, PLACES, TURNS)
        return {name: self._array(name) for name in names if name in self._outputs}

    def _array(self, output: str) -> np.ndarray:
        """Follow an output back to its array."""
        name = output
        for _ in range(MAX_DEPTH):
            if name in self._tensors:
                return self._numbers(output, self._tensors[name])
            kind, name = self._nodes.get(name, ("", ""))
            if kind not in FORWARDING:
                break
        raise MotionError(f"The output {output} is not taken from an array.")

    def _numbers(self, label: str, data: memoryview) -> np.ndarray:
        """Read a tensor."""
        shape: list[int] = []
        kind, content = 1, [b""]
        for field, value in self._fields(data):
            if field == TENSOR_SHAPE:
                shape += [value] if isinstance(value, int) else _numbers(value)
            elif field == TENSOR_TYPE and isinstance(value, int):
                kind = value
            elif field in (TENSOR_FLOATS, TENSOR_DOUBLES, TENSOR_BYTES):
                content.append(bytes(_bytes(value)))
            elif field == TENSOR_PLACE and value:
                raise MotionError(
                    f"The numbers of {label} are in another file, which is not read."
                )
        if kind not in TYPES:
            raise MotionError(f"{label} must contain floating-point numbers.")
        try:
            return np.frombuffer(b"".join(content), TYPES[kind]).reshape(shape)
        except ValueError as error:
            raise MotionError(f"The numbers of {label} are damaged.") from error

    def _fields(self, data: Field) -> Iterator[tuple[int, Field]]:
        """Yield the fields of a message, with their numbers."""
        data = _bytes(data)
        at = 0
        while at < len(data):
            self._n_fields += 1
            if self._n_fields > MAX_FIELDS:
                raise MotionError(f"The model has more than {MAX_FIELDS} fields.")
            key, at = _number(data, at)
            kind = key & 7
            if kind == 0:
                value, at = _number(data, at)
                yield key >> 3, value
                continue
            if kind == 2:
                size, at = _number(data, at)
            else:
                size = {1: 8, 5: 4}.get(kind, len(data))
            if size > len(data) - at:
                raise MotionError("Not a valid ONNX model.")
            yield key >> 3, data[at : at + size]
            at += size


def _number(data: memoryview, at: int) -> tuple[int, int]:
    """Read a number of variable length; return where it ends, too."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(data):
            break
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise MotionError("Not a valid ONNX model.")


def _numbers(data: memoryview) -> list[int]:
    """Read a few numbers in a row."""
    found: list[int] = []
    at = 0
    while at < len(data) and len(found) < MAX_DEPTH:
        value, at = _number(data, at)
        found.append(value)
    return found


def _bytes(value: Any) -> memoryview:
    """Check that a field has bytes."""
    if not isinstance(value, memoryview):
        raise MotionError("Not a valid ONNX model.")
    return value


def _text(value: Any) -> str:
    """Read text; empty if it is missing."""
    return "" if value is None else bytes(_bytes(value)).decode("utf-8", "replace")


FORMAT = Format(
    "policy",
    recognise,
    read,
    (".onnx",),
    order="wxyz",
    assumed_rate=50.0,
    rate_of="the rate of such policies",
)
