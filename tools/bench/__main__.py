"""Measure what was asked for. Called by tools/benchmark."""

import argparse
import signal
import sys
import time
from pathlib import Path

from . import (
    bridge,
    browser,
    checker,
    checks,
    collisions,
    commands,
    foot,
    growth,
    live,
    loading,
    names,
    poses,
    rates,
    report,
    soak,
    standin,
    start_up,
    streaming,
    tracking,
    transforms,
    walk,
    worlds,
)
from .figures import OWN_MODEL, Bench

PARTS = {
    "bridge": bridge,
    "live": live,
    "growth": growth,
    "standin": standin,
    "commands": commands,
    "walk": walk,
    "loading": loading,
    "start_up": start_up,
    "worlds": worlds,
    "tracking": tracking,
    "collisions": collisions,
    "checks": checks,
    "checker": checker,
    "browser": browser,
    "poses": poses,
    "names": names,
    "streaming": streaming,
    "rates": rates,
    "foot": foot,
    "tf": transforms,
    "soak": soak,
}
NAMED = [name for name in PARTS if name != "soak"]
BUSY = ("browser", "checks", "poses", "names", "rates", "foot", "tf")
USUAL = [name for name in NAMED if name not in BUSY]


def parts_of(text):
    """Read a list of parts."""
    names = text.split(",")
    for name in names:
        if name not in NAMED:
            parts = ", ".join(NAMED)
            raise argparse.ArgumentTypeError(f"no part '{name}'; there are {parts}")
    return names


def arguments():
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="tools/benchmark")
    parser.add_argument("--only", type=parts_of, metavar="PART[,PART]")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--soak", type=float, metavar="SECONDS")
    parser.add_argument("--model", type=Path, metavar="FILE")
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument("--page", metavar="FILE")
    given = parser.parse_args()
    if given.soak is not None and not given.soak >= 10.0:
        parser.error("--soak takes at least 10 s")
    if given.model and not given.model.is_file():
        parser.error(f"there is no model {given.model}")
    return given


def measure(bench, names):
    """Run parts, and print what was measured even if one of them is interrupted."""
    try:
        for name in names:
            bench.part, start = name, time.monotonic()
            PARTS[name].run(bench)
            bench.say(f"took {time.monotonic() - start:.0f} s")
    finally:
        if bench.figures or bench.left_out:
            report.print_table(bench, report.command_line())


def main():
    """Measure, print, write."""
    given = arguments()
    bench = Bench((given.model or OWN_MODEL).resolve(), given.quick, given.soak)
    names = given.only or ([] if given.soak else USUAL)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    measure(bench, [*names, *(["soak"] if given.soak else [])])
    if given.json:
        report.write_json(bench, report.command_line(), given.json)
    if given.page:
        texts = {name: part.__doc__ for name, part in PARTS.items()}
        report.write_page(bench, report.command_line(), given.page, texts)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("tools/benchmark: interrupted")
