"""Let a Python program's clock be off; the folder of this file is put on its path.

libfaketime of Debian 12 does not do that: if it leaves the monotonic clock alone, sleep
of Python 3.11 fails, and if it does not, waiting does not end.
"""

import os
import time

OFFSET = float(os.environ["CLOCK_OFFSET"])  # [s]
_time, _time_ns = time.time, time.time_ns


def _shifted():
    return _time() + OFFSET


def _shifted_ns():
    return _time_ns() + round(1e9 * OFFSET)


time.time, time.time_ns = _shifted, _shifted_ns
