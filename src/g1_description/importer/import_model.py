"""The command import_model, which copies a robot and its meshes to a folder."""

from __future__ import annotations

import signal
import sys

from g1_description.command_line import refuse
from g1_description.errors import G1DescriptionError
from g1_description.importer.command import run
from g1_description.interrupts import ENDING_SIGNALS


def main() -> None:
    """Run the command, or exit with a message."""
    for number in ENDING_SIGNALS:  # the temporary folder is removed
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    try:
        print(run(sys.argv[1:]))
    except (G1DescriptionError, OSError) as error:
        refuse("import_model", error)
