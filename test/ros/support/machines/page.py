"""A program: opens a page of the browser view and tells when it changes.

Usage: page.py ADDRESS. It writes a `RECORD` for each change of the scene.
"""

import site
import struct
import sys
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[4]
for folder in REPOSITORY.glob(".venv/lib/python3*/site-packages"):
    site.addsitedir(str(folder))
sys.path.insert(0, str(REPOSITORY / "tools"))

from page_client import PageClient  # noqa: E402

RECORD = struct.Struct("<dd")
"""When it was, on the monotonic clock in [s]; how many messages have come."""


def main():
    """Run until it is killed."""
    with PageClient(sys.argv[1]) as page:
        while not page.has_ended:
            seen = page.messages
            page.wait_for(lambda seen=seen: page.messages > seen, "news", 1e6)
            sys.stdout.buffer.write(RECORD.pack(time.monotonic(), page.messages))
            sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
