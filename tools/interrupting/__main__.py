"""Start, interrupt, look. Called by tools/interrupts."""

import argparse
import contextlib
import os
import random
import re
import shutil
import signal
import site
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from bench.figures import OWN_MODEL
from bench.nodes import Graph, free_port
from support.virtual_screen import VirtualScreen

from .cases import WITH_RVIZ, cases
from processes import (
    end_processes,
    marked_environment,
    marked_processes,
    new_mark,
    wait_for_end,
)

LATEST = 3.0
"""Of the moments of the interrupt, in [s] after the start."""
PATIENCE = 15.0
"""Time in [s] after which processes that do not end are killed."""
OURS = re.compile(r'File "[^"]*/(g1_description|gazebo_ros)/')
"""Our code in a traceback."""
TROUBLE = re.compile(
    "Traceback|Fatal Python error|Exception ignored|Segmentation fault|Aborted|"
    "core dumped|terminate called|KeyboardInterrupt"
)


NO_MASTER = "could not contact master"
"""What roslaunch says 10 s after its own master was interrupted in its start."""


def is_foreign(text, words):
    """Tell whether tracebacks are not ours: of roslaunch, or of Python, as it started.

    Args:
        text: All that was printed.
        words: The command.
    """
    is_python = "init_import_site" in text
    return is_python or (words[0] == "roslaunch" and not OURS.search(text))


class Try:
    """One interrupt."""

    def __init__(self, name, words, delay, more):
        """Start a command; interrupt it; wait for its end.

        Args:
            name: What it is called.
            words: The command.
            delay: Time from the start to the signal in [s].
            more: What it needs in its environment.
        """
        self.name, self.delay = name, delay
        mark = new_mark()
        with tempfile.TemporaryDirectory(prefix="g1_interrupts_") as folder:
            port = free_port()
            environment = {**os.environ, **more, "ROS_LOG_DIR": folder}
            if "tools/" in words[0]:
                environment["ROS_MASTER_URI"] = f"http://localhost:{port}"
            with tempfile.TemporaryFile() as output:
                process = subprocess.Popen(
                    [word.format(port=port) for word in words],
                    env=marked_environment(mark, environment),
                    start_new_session=True,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                )
                try:
                    self._interrupt(process, mark)
                finally:
                    end_processes(mark)
                self.code = process.wait()
                output.seek(0)
                texts = [output.read().decode(errors="replace")]
            logs = Path(folder).rglob("*-std*.log")
            texts += [log.read_text(errors="replace") for log in logs]
        self.text = "\n".join(texts)
        self.was_lost |= NO_MASTER in self.text
        self.is_foreign = is_foreign(self.text, words)

    def _interrupt(self, process, mark):
        """Send the signal; keep how long all took to end, and what did not."""
        time.sleep(self.delay)
        self.was_over, self.was_lost = process.poll() is not None, False
        begin = time.monotonic()
        if not self.was_over:
            os.killpg(process.pid, signal.SIGINT)
        wait_for_end(mark, PATIENCE)
        self.left = marked_processes(mark)
        if process.poll() is None and process.args[0] == "roslaunch":
            # It takes an interrupt of its own start for something else.
            self.was_lost, begin = True, time.monotonic()
            os.killpg(process.pid, signal.SIGINT)
            wait_for_end(mark, PATIENCE)
        self.elapsed = time.monotonic() - begin

    def faults(self, longest):
        """List what is wrong, in a few words each."""
        found = sorted({word.group() for word in TROUBLE.finditer(self.text)})
        if self.is_foreign:
            found = []
        if self.code < 0 and self.code != -signal.SIGINT:
            found.append(f"signal {-self.code}")
        if self.elapsed > longest and not self.was_lost:
            found.append(f"{self.elapsed:.1f} s")
        return found


@contextlib.contextmanager
def hidden_screen(home):
    """Give what RViz needs on a screen that nobody sees; None where there is no Xvfb.

    Args:
        home: Folder where it leaves its settings.
    """
    if not shutil.which("Xvfb"):
        yield None
        return
    screen = VirtualScreen(1200, 900)
    try:
        display = {"DISPLAY": screen.display, "LIBGL_ALWAYS_SOFTWARE": "1"}
        yield {**display, "HOME": str(home), "PYTHONUSERBASE": site.getuserbase()}
    finally:
        screen.stop()


def arguments():
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="tools/interrupts")
    parser.add_argument("--tries", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--longest", type=float, default=3.0)
    parser.add_argument("names", nargs="*", metavar="NAME")
    return parser.parse_args()


def chosen(known, names):
    """Give the cases that are named in part; all if there is no name."""
    found = {
        name: words
        for name, words in known.items()
        if not names or any(part in name for part in names)
    }
    if not found:
        sys.exit(f"tools/interrupts: no such name; there are {', '.join(known)}")
    return found


def attempts(known, number, seed):
    """Give names with delays in [s], all names equally often."""
    draw = random.Random(seed)
    names = []
    while len(names) < number:
        names += draw.sample(sorted(known), len(known))
    return [(name, draw.uniform(0.0, LATEST)) for name in names[:number]]


def report(tries, longest):
    """Print a table of all tries; give the number of those with a fault."""
    rows, bad = defaultdict(list), 0
    for one in tries:
        rows[one.name].append(one)
        bad += bool(one.faults(longest))
    names = (
        "tries",
        "over before",
        "lost by roslaunch, or its master",
        "traceback of Python or roslaunch",
    )
    print(f"\n| name | {' | '.join(names)} | longest end, s | exit codes | faults |")
    print(f"| --- |{5 * ' ---: |'} --- | --- |")
    for name, row in sorted(rows.items()):
        over = sum(one.was_over for one in row)
        codes = ", ".join(map(str, sorted({one.code for one in row})))
        faults = "; ".join(", ".join(o.faults(longest)) for o in row)
        slowest = max(one.elapsed for one in row)
        lost = sum(one.was_lost for one in row)
        foreign = sum(one.is_foreign and "Traceback" in one.text for one in row)
        cells = name, len(row), over, lost, foreign, f"{slowest:.1f}", codes
        cells = *cells, faults.strip("; ")
        print(f"| {' | '.join(map(str, cells))} |")
    print(f"\n{len(tries)} tries, {bad} with a fault")
    return bad


def main():
    """Interrupt what was asked for."""
    given, tries = arguments(), []
    # A shell that starts it in the background has it, and its children, ignore Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with contextlib.ExitStack() as stack:
        temporary = tempfile.TemporaryDirectory(prefix="g1_interrupts_")
        folder = Path(stack.enter_context(temporary))
        screen = stack.enter_context(hidden_screen(folder))
        known = chosen(cases(folder, screen is not None), given.names)
        with Graph() as graph, graph.launch(OWN_MODEL):
            graph.node("/robot_state_publisher")
            try:
                for name, delay in attempts(known, given.tries, given.seed):
                    more = screen if name.endswith(WITH_RVIZ) else {}
                    one = Try(name, known[name], delay, more)
                    tries.append(one)
                    if one.faults(given.longest):
                        print(f"\n=== {name} after {delay:.3f} s, code {one.code}:")
                        print(*one.faults(given.longest), *one.left.values(), sep=", ")
                        print(one.text[-6000:], flush=True)
            except KeyboardInterrupt:
                print("interrupted")
    return 1 if report(tries, given.longest) else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("tools/interrupts: interrupted")
