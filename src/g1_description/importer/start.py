"""The start and the end of import_model, which a signal may end at any moment."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Any

from g1_description.errors import G1DescriptionError


def main() -> None:
    """Import a model, or say why not."""
    # trimesh takes an interrupt while it is imported for a library that is missing.
    _answer_signals(signal.SIG_DFL)
    from g1_description.importer.command import run

    _answer_signals(signal.default_int_handler)
    try:
        print(run(sys.argv[1:]))
    except G1DescriptionError as error:
        sys.exit(f"import_model: {error}")
    except OSError as error:
        place = error.filename or "output"
        sys.exit(f"import_model: {place}: {error.strerror}.")
    except KeyboardInterrupt:
        print("import_model: interrupted; nothing was written.", file=sys.stderr)
        sys.exit(130)


def _answer_signals(handler: Callable[..., Any] | signal.Handlers) -> None:
    """Set what signals do, but for those that whoever started this ignores."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)
