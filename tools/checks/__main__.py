"""Choose parts, run them beside each other, print what came of them, and count."""

import fnmatch
import queue
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from .outcome import Outcome
from .parts import QUICK, parts
from .runner import LIMIT, Runner

AT_A_TIME = 4
"""Parts that run beside each other: on two cores, as rostests wait most of the time."""
SLOWEST = 10
"""Cases that are named for the time they take."""


def chosen(names, patterns):
    """Choose the parts that the user named; all if none is.

    Raises:
        SystemExit: If there is no such part.
    """
    if not patterns:
        return names
    for pattern in patterns:
        if not any(matches(name, pattern) for name in names):
            sys.exit(f"tools/test: no part '{pattern}'; there are {' '.join(names)}")
    return [name for name in names if any(matches(name, p) for p in patterns)]


def matches(name, pattern):
    """Tell whether a part is meant by what the user wrote."""
    return fnmatch.fnmatch(name, pattern) or name.startswith(f"{pattern}/")


def run_part(runner, name, function):
    """Run one part and print its line.

    Args:
        runner: What runs it.
        name: Its name.
        function: Of a runner; gives the outcome.
    """
    start, runner.processor = time.monotonic(), 0.0
    outcome = attempt(runner, function)
    outcome.processor = runner.processor
    outcome.times = [(seconds, f"{name}: {case}") for seconds, case in outcome.times]
    if not runner.is_stopped:
        print_part(name, outcome, time.monotonic() - start)
    return outcome


def attempt(runner, function):
    """Run one part, and end what it leaves behind."""
    if time.monotonic() > runner.deadline:
        return Outcome(failed=[f"not run: {LIMIT / 60:.0f} minutes are over"])
    outcome = function(runner)
    outcome.add(runner.leftover())
    return outcome


def run_beside_each_other(runners, found):
    """Run parts in their order, as many at a time as there are runners.

    Args:
        runners: One for each part that runs at the same time.
        found: Functions of a runner by the parts' names.

    Returns:
        The outcomes of all, added up.
    """
    idle = queue.Queue()
    for runner in runners:
        idle.put(runner)

    def run_on_the_next(part):
        runner = idle.get()
        try:
            return run_part(runner, *part)
        finally:
            idle.put(runner)

    total = Outcome()
    with ThreadPoolExecutor(len(runners)) as pool:
        try:
            for outcome in pool.map(run_on_the_next, found.items()):
                total.add(outcome)
        except KeyboardInterrupt:
            # Another one must not keep it from ending what it started.
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_IGN)
            for runner in runners:
                runner.stop()
            raise
    return total


def print_part(name, outcome, seconds):
    """Print a part's line, and all that is known of its failures."""
    word = "FAILED" if outcome.failed else "ok"
    spent = f"({seconds:.1f} s, {outcome.processor:.1f} s of processor)"
    lines = [f"{word:6} {name:20} {outcome} {spent}"]
    if outcome.failed:
        lines += [*outcome.failed, outcome.details]
    print("\n".join(lines), flush=True)


def print_slowest(times):
    """Name the cases that took longest."""
    for seconds, name in sorted(times, reverse=True)[:SLOWEST]:
        print(f"{seconds:6.1f} s {name}")


def print_skipped(lines):
    """Name what was skipped, in one line per test for all its parameters."""
    counts = Counter(re.sub(r"\[[^]]*\]:", ":", line) for line in lines)
    for line, count in counts.items():
        print(f"skipped {line}{f' ({count} cases)' if count > 1 else ''}")


def main():
    """Run what was asked for."""
    is_quick = sys.argv[1:] == ["quick"]
    available = parts(is_quick)
    patterns = [n for n in QUICK if n in available] if is_quick else sys.argv[1:]
    names = chosen(list(available), patterns)
    found = {name: available[name] for name in names}
    # Also where SIGINT is ignored, as under nohup: so the programs here do not.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="g1_test_") as folder:
        runners = [Runner(Path(folder) / str(number)) for number in range(AT_A_TIME)]
        try:
            total = run_beside_each_other(runners, found)
        except KeyboardInterrupt:
            sys.exit("tools/test: interrupted")
        finally:
            for runner in runners:
                runner.stop()
    print_slowest(total.times)
    print_skipped(total.skipped)
    minutes, seconds = divmod(round(time.monotonic() - start), 60)
    print(f"{total} ({minutes}:{seconds:02} min, {total.processor:.0f} s of processor)")
    sys.exit(1 if total.failed else 0)


main()
