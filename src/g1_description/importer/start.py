"""The command import_model, which copies a robot and its meshes to a folder."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Any

from g1_description.command_line import refuse
from g1_description.errors import G1DescriptionError
from g1_description.interrupts import ENDING_SIGNALS


def main() -> None:
    """Run the command, or exit with a message."""
    # trimesh mistakes an interrupt during its import for a missing library.
    _answer_signals(signal.SIG_DFL)
    from g1_description.importer.command import run

    _answer_signals(signal.default_int_handler)
    try:
        print(run(sys.argv[1:]))
    except (G1DescriptionError, OSError) as error:
        refuse("import_model", error)
    except KeyboardInterrupt:
        print("import_model: interrupted; nothing was written.", file=sys.stderr)
        sys.exit(130)


def _answer_signals(handler: Callable[..., Any] | signal.Handlers) -> None:
    """Set the handler of signals, except those that the parent ignores."""
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)
