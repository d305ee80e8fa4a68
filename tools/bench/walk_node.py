#!/usr/bin/env python3
"""The bridge's node; it prints the calls of its own functions when it ends.

A walk is what one message causes in one thread: it begins where rospy calls a function
of this package and ends where that function returns. The thread that calls the
service never returns, so there a walk ends with each request. Comprehensions belong
to the function around them and do not count.
"""

import json
import sys
import threading
from collections import Counter

from rospy.impl.tcpros_service import ServiceProxy

from g1_description.bridge.node import main

PACKAGE = "g1_description."
REQUEST = ServiceProxy.call.__code__


class Recorder:
    """Counts walks; to be used as the profiler of threads.

    A walk is a tuple of ``module:function``, a member for each call, in order.
    """

    def __init__(self, package=PACKAGE, request=REQUEST):
        """Begin with none.

        Args:
            package: What the names of the modules that count begin with.
            request: Code of the function whose call ends a walk.
        """
        self.walks = Counter()
        self._package, self._request = package, request
        self._of_thread = threading.local()

    def __call__(self, frame, event, argument):
        """Take an event of the profiler."""
        if event not in ("call", "return"):
            return
        mine = vars(self._of_thread)
        path = mine.setdefault("path", [])
        code, module = frame.f_code, frame.f_globals.get("__name__", "")
        if event == "call" and code is self._request and mine.get("depth"):
            self._end(path)
        if not module.startswith(self._package):
            return
        mine["depth"] = mine.get("depth", 0) + (1 if event == "call" else -1)
        is_part = code.co_name.startswith("<") and code.co_name != "<lambda>"
        if event == "call" and not is_part:
            path.append(f"{module[len(self._package) :]}:{code.co_name}")
        if not mine["depth"]:
            self._end(path)

    def _end(self, path):
        """Count a walk, and begin the next."""
        self.walks[tuple(path)] += 1
        path.clear()


def run():
    """Run the node, and print the walks as JSON: how often, and which calls."""
    recorder = Recorder()
    threading.setprofile(recorder)
    main()
    threading.setprofile(None)
    walks = [[count, path] for path, count in recorder.walks.copy().items()]
    print(json.dumps(walks))
    sys.stdout.flush()


if __name__ == "__main__":
    run()
