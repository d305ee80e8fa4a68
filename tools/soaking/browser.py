#!/usr/bin/env python3
"""Stand for so many browsers.

Arguments: address of the page, how many, the link whose moves count. Opens the pages,
and then prints twice a second as JSON: the time in [s], bytes and moves of all so far.
"""

import json
import signal
import sys
import time
from contextlib import ExitStack

from page_client import PageClient

PERIOD = 0.5  # [s]


def node_of(page, link):
    """Wait for a link in the scene; a page may be open before its robot is there."""

    def found():
        return [name for name in page.nodes if name.endswith(f"/{link}")]

    return page.wait_for(found, link)[0]


def main():
    """Watch until somebody ends it."""
    # Who runs in the background of a shell would hand down that it is ignored.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    address, count, link = sys.argv[1:]
    with ExitStack() as stack:
        pages = [stack.enter_context(PageClient(address)) for _ in range(int(count))]
        for page in pages:
            page.wait_until_whole()
        node = node_of(pages[0], link)
        while not any(page.has_ended for page in pages):
            n_bytes = sum(page.bytes for page in pages)
            moves = sum(page.counts[node] for page in pages)
            print(json.dumps([time.monotonic(), n_bytes, moves]), flush=True)
            time.sleep(PERIOD)
        sys.exit(f"a page has ended: {[page.error for page in pages]}")


if __name__ == "__main__":
    main()
