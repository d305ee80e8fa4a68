"""What the stand-in keeps of long names.

A client asks for the state of a model with a name of a million characters, each time
another one, which the stand-in refuses and logs. "In use" is what its heap has given
to the program, by glibc's mallinfo2; "kept free" is what glibc has not returned to the
system. The last figure is the resident memory after malloc_trim, less that before the
first request: what is really held.
"""

import json
import subprocess
import sys
from pathlib import Path

from .nodes import Graph, MeasurementError, wait_for
from processes import marked_environment
from tcpros import Service

HERE = Path(__file__).resolve().parent
REQUESTS = 2000
LENGTH = 1_000_000
QUARTERS = 4
SERVICE = "/gazebo/get_model_state"


def run(bench):
    """Ask again and again, and look at the memory on the way."""
    number = bench.count(REQUESTS, 100)
    with bench.attempt(f"{number} requests with names of {LENGTH} characters"):
        begin, rows, end = measure(number // QUARTERS)
        report(bench, begin, rows, end)


def measure(number):
    """Ask so many times a quarter.

    Returns:
        What the node tells at the beginning, after each quarter, and once trimmed.
    """
    with Graph() as graph, Watched(graph) as node:
        wait_for(lambda: has_service(graph), "the stand-in")
        begin, rows = node.ask(), []
        service = Service(SERVICE)
        for quarter in range(QUARTERS):
            for index in range(number):
                service(f"{quarter}_{index}_{'x' * LENGTH}", "")
            rows.append(node.ask())
        return begin, rows, node.ask("trim")


def has_service(graph):
    """Tell whether the stand-in answers."""
    return SERVICE in dict(graph.master.getSystemState()[2])


def report(bench, begin, rows, end):
    """Keep the figures."""
    first, last = rows[0], rows[-1]
    bench.add("resident at the beginning", begin["resident"], "MB")
    bench.add("resident after a quarter", first["resident"], "MB")
    bench.add("resident at the end", last["resident"], "MB")
    bench.add("kept free by glibc at the end", last["free"], "MB")
    used = last["used"] - first["used"]
    bench.add("in use, grown from a quarter to the end", used, "MB", "< 1")
    grown = end["trimmed"] - begin["resident"]
    bench.add("resident once trimmed, grown in all", grown, "MB", "< 5")


class Watched:
    """A stand-in that tells of its memory."""

    def __init__(self, graph):
        """Start it; what it logs goes nowhere."""
        self._graph = graph
        self._process = subprocess.Popen(
            [sys.executable, HERE / "names_node.py"],
            env=marked_environment(graph.mark),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            bufsize=1,
        )

    def ask(self, word="tell"):
        """Give what it tells, the lines of its log left out."""
        self._process.stdin.write(f"{word}\n")
        for line in self._process.stdout:
            if line.startswith("{"):
                return json.loads(line)
        raise MeasurementError("the stand-in has ended")

    def __enter__(self):
        """Give itself."""
        return self

    def __exit__(self, *_):
        """End it."""
        self._process.terminate()
        self._process.communicate()
