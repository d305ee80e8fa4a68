"""Messages that are read several at once."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

PAUSE = 5e-4
"""Messages with longer than this between them, in [s], did not come together."""

_ends = threading.local()
"""When a connection's thread was last done with a message, for all who take it: two
that gather the same messages leave their connection alone once."""


def gathered(act: Callable[[bytes], None], period: float) -> Callable[[bytes], None]:
    """Let messages gather while nobody needs them.

    To wait for a message costs more than to take it, so after one that was waited for
    its connection is left alone for a while; the system keeps what comes meanwhile.

    Args:
        act: Takes a message.
        period: How long the connection is left alone, in [s].

    Returns:
        Does the same, and returns late.
    """

    def take(data: bytes) -> None:
        waited = time.monotonic() - getattr(_ends, "last", 0.0)
        act(data)
        if waited > PAUSE:
            time.sleep(period)
        _ends.last = time.monotonic()

    return take
