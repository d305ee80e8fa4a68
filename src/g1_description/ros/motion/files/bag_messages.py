"""What the messages of a bag's topics say, and when."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from g1_description.core.errors import MotionError, WireFormatError
from g1_description.ros.wire.motions import READERS, MessageReader

from .bag_records import Bag, Message, Topic


def kind_of(topic: Topic) -> str:
    """Return the kind of a topic's messages; empty if no motion is made of them."""
    return READERS[topic.md5][0] if topic.md5 in READERS else ""


def read_messages(
    bag: Bag, topics: Collection[Topic]
) -> Iterator[tuple[Message, list[Any]]]:
    """Read the messages of some topics; what each says is a list.

    Raises:
        MotionError: If one is no whole message.
    """
    reader = MessageReader()
    for message in bag.messages(topics):
        try:
            reader.start(message.data)
            yield message, READERS[message.topic.md5][1](reader)
        except WireFormatError as error:
            raise MotionError(f"On {message.topic.name}: {error}") from error


def rising(stamps: np.ndarray) -> tuple[np.ndarray, bool]:
    """Choose the samples whose stamps rise, until they go back.

    Args:
        stamps: In [ns], shape (n,).

    Returns:
        Their numbers, of equal stamps the last one; and whether time goes back.
    """
    back = np.flatnonzero(np.diff(stamps) < 0)
    whole = stamps[: back[0] + 1] if back.size else stamps
    return np.flatnonzero(np.append(np.diff(whole) > 0, True)), bool(back.size)
