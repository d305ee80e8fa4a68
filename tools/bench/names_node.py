#!/usr/bin/env python3
"""The stand-in, which tells of its memory.

For each line on its input it prints as JSON, in [MB]: the resident memory, what of it
its heap has in use and keeps free, and the resident memory once the heap is trimmed.
"""

import ctypes
import json
import sys
import threading
from pathlib import Path

from g1_description.gazebo.node import main

FIELDS = ("arena", "ordblks", "smblks", "hblks", "hblkhd")
FIELDS = (*FIELDS, "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")


class Heap(ctypes.Structure):
    """What glibc's mallinfo2 gives."""

    _fields_ = tuple((name, ctypes.c_size_t) for name in FIELDS)


def resident():
    """Give the resident memory in [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def tell(system):
    """Answer the lines on the input."""
    for line in sys.stdin:
        heap = system.mallinfo2()
        told = {
            "resident": resident(),
            "used": heap.uordblks / 1e6,
            "free": heap.fordblks / 1e6,
        }
        if line.strip() == "trim":
            system.malloc_trim(0)
            told["trimmed"] = resident()
        print(json.dumps(told), flush=True)


if __name__ == "__main__":
    libc = ctypes.CDLL(None)
    libc.mallinfo2.restype = Heap
    threading.Thread(target=tell, args=(libc,), daemon=True).start()
    main()
