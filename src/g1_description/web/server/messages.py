"""Which messages of a browser viser gets: those that its page needs, well formed.

viser takes any message it knows from anybody: one opens a tunnel to the internet, one
buffers uploads without a limit, one sets attributes of its own objects. What it cannot
read ends its connection with a traceback.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Dict, Union

import msgspec
from typing_extensions import Annotated, Literal, get_type_hints
from viser import infra

from g1_description.core.errors import PageServerError

ALLOWED = (
    "ViewerCameraMessage",
    "GuiUpdateMessage",
    "GuiButtonHoldMessage",
    "GuiFormSubmitMessage",
    "GuiFormDirtyMessage",
    "CommandTriggerMessage",
    "SceneNodeClickMessage",
    "SceneNodeDragMessage",
    "ScenePointerMessage",
    "TransformControlsUpdateMessage",
    "TransformControlsDragStartMessage",
    "TransformControlsDragEndMessage",
    "GetRenderResponseMessage",
    "LocalStorageGetItemResponseMessage",
    "FileTransferPartAck",
)
"""The others are not for browsers to send."""

MAX_SIZE = 64 * 2**10
"""Largest message but a picture, in bytes; the page's own have some hundred."""

PICTURE = "GetRenderResponseMessage"

WHOLE = Annotated[float, msgspec.Meta(ge=-(2**53), le=2**53)]
"""viser rounds what should be whole: zoomed pages have sizes with fractions."""

OVERRIDES = {("GuiUpdateMessage", "updates"): Dict[Literal["value"], Any]}
"""A person changes values. Any other name would be set on viser's own object."""


class MessageFilter:
    """Tells which messages pass."""

    def __init__(self) -> None:
        """Find out what viser's messages consist of."""
        classes = {cls.__name__: cls for cls in infra.Message.get_subclasses()}
        forms = tuple(_form(name, classes[name]) for name in ALLOWED)
        self._decoder = msgspec.msgpack.Decoder(Union[forms])

    def passes(self, data: bytes) -> bool:
        """Tell whether a message may go on to viser.

        Args:
            data: A message as it came.

        Raises:
            PageServerError: If it is none at all.
        """
        try:
            message = self._decoder.decode(data)
        except msgspec.ValidationError:
            return False
        except (msgspec.DecodeError, RecursionError, ValueError):
            raise PageServerError("a browser sent what is no message") from None
        return len(data) <= MAX_SIZE or type(message).__name__ == PICTURE


def _form(name: str, cls: type) -> Any:
    """Make the type that a message of a class must fit."""
    hints = get_type_hints(cls)
    fields = []
    for field in dataclasses.fields(cls):
        hint = WHOLE if hints[field.name] is int else hints[field.name]
        hint = OVERRIDES.get((name, field.name), hint)
        default = () if field.default is dataclasses.MISSING else (field.default,)
        fields.append((field.name, hint, *default))
    return msgspec.defstruct(
        name, fields, tag=name, tag_field="type", forbid_unknown_fields=True
    )
