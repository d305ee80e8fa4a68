"""Run for long, disturb, tell. Called by tools/soak."""

import argparse
import contextlib
import json
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from bench.graph import FAILURES

from . import report
from .record import Record
from .world import World

HOUR = 3600.0
KILLS = 6
MASTERS = 2
REST = 15.0
"""Time in [s] at the end in which nothing is disturbed."""


@dataclass(frozen=True)
class Plan:
    """When what is done; all in [s]."""

    length: float

    @property
    def part(self):
        """The part of an hour that this is, at most one."""
        return min(self.length / HOUR, 1.0)

    @property
    def reset_period(self):
        """Time between two resets: a minute in an hour."""
        return max(60.0 * self.part, 5.0)

    @property
    def command_period(self):
        """Time between two commands."""
        return max(5.0 * self.part, 1.0)

    @property
    def sample_period(self):
        """Time between two samples."""
        return max(10.0 * self.part, 1.0)

    def events(self):
        """List what is disturbed: times with names, in order."""
        length = self.length - REST
        number = max(KILLS, round(KILLS * self.length / HOUR))
        kills = [((n + 0.5) / number * length, "kill") for n in range(number)]
        share = 1.0 / (MASTERS + 1)
        masters = [((n + 1) * share * length, "master") for n in range(MASTERS)]
        return sorted(kills + masters)


def arguments():
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="tools/soak")
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--no-rviz", action="store_true")
    parser.add_argument("--page", type=Path, metavar="FILE")
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    if not given.hours >= 0.02:
        parser.error("--hours takes at least 0.02")
    return given


def disturb(world, record, kind):
    """Do one of the things that should hurt nobody."""
    if kind == "kill":
        world.kill_simulator()
    else:
        world.restart_master()
    record.note(kind)


def watch(world, record, plan):
    """Go through the plan, with a sample now and then."""
    events = plan.events()
    sample_at = begin = time.monotonic()
    while time.monotonic() < begin + plan.length:
        time.sleep(0.2)
        now = time.monotonic()
        if events and now >= begin + events[0][0]:
            disturb(world, record, events.pop(0)[1])
        world.browser.keep_up()
        world.player.keep_up()
        if now >= sample_at:
            sample_at += plan.sample_period
            record.sample()
    record.finish()


def run(given):
    """Give the ``Record`` of a run, also of one that was interrupted."""
    plan, record = Plan(HOUR * given.hours), None
    with World(not given.no_rviz) as world:
        try:
            world.begin(plan)
            record = Record(world, plan)
            watch(world, record, plan)
        except (KeyboardInterrupt, *FAILURES) as error:
            if record is None:
                raise
            record.say(f"ended early: {error!r}")
            record.ended_early = True
            with contextlib.suppress(*FAILURES):  # those that ended it
                record.finish()
    return record


def main():
    """Run, print, write."""
    given = arguments()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    record = run(given)
    result = report.summary(record)
    print("\n".join(report.tables(result)))
    if given.json:
        given.json.write_text(json.dumps({**record.told(), **result}, indent=1))
    if given.page:
        report.write_page(record, result, given.page)
    return 1 if result["faults"] or record.ended_early else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("tools/soak: interrupted")
