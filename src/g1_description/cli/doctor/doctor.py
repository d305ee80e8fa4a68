"""A command that names the first broken link between the master and the picture.

Only the standard library is imported here: this has to work where the rest is missing.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading

from g1_description.cli.doctor.faults import BROKEN, LINKS, Fault, Walked, fault
from g1_description.cli.doctor.walk import Walk
from g1_description.cli.robot_options import add_namespace
from g1_description.command_line import OneSentenceParser, say

WHOLE, FOUND, MISUSE = 0, 1, 2
"""Exit codes."""

TIMEOUT = 45.0
"""Longest walk in [s]: each question has a deadline of its own, this is the last."""


def parser() -> OneSentenceParser:
    """Make a parser of the command's arguments."""
    made = OneSentenceParser(
        prog="doctor",
        description="Walk from the master to the picture, and name the first broken "
        "link with the command that mends it. Nothing is changed. The exit code is 0 "
        "if all is whole, 1 if a link is broken, 2 if the command line is wrong.",
    )
    made.misuse = MISUSE
    made.add_argument("--json", action="store_true", help="print JSON")
    add_namespace(made)
    *_, last = LINKS
    made.add_argument(
        "--until",
        choices=[*LINKS],
        default=last,
        metavar="LINK",
        help=f"last link to look at: {', '.join(LINKS)}; default: {last}",
    )
    return made


def line(walked: Walked) -> str:
    """Write a line on a link."""
    remark = f" ({walked.remark})" if walked.remark else ""
    return f"{walked.state:13}  {walked.name:15}  {LINKS[walked.name]}{remark}"


def as_json(found: list[Walked]) -> str:
    """Write the walk as JSON."""
    wrong = fault_of(found)
    links = [
        {
            "name": one.name,
            "state": one.state,
            "about": LINKS[one.name],
            "remark": one.remark,
        }
        for one in found
    ]
    return json.dumps(
        {
            "whole": wrong is None,
            "fault": wrong and wrong.name,
            "sentence": wrong and wrong.sentence,
            "cure": wrong and wrong.cure,
            "links": links,
        },
        indent=2,
    )


def fault_of(found: list[Walked]) -> Fault | None:
    """Return the fault of the broken link, None if there is none."""
    return next((one.fault for one in found if one.fault is not None), None)


def walk(args: argparse.Namespace) -> list[Walked]:
    """Walk, and print each link unless JSON is wanted."""
    found: list[Walked] = []
    names = [*LINKS]
    chain = Walk(args.namespace, names[: names.index(args.until) + 1])
    timer = threading.Timer(TIMEOUT, _give_up, (chain, found, args.json))
    timer.daemon = True
    timer.start()
    for one in chain.run():
        found.append(one)
        if not args.json:
            say(line(one))
    timer.cancel()
    return found


def tell(found: list[Walked], wants_json: bool) -> None:
    """Print the verdict."""
    wrong = fault_of(found)
    if wants_json:
        say(as_json(found))
    elif wrong is None:
        say("\ndoctor: all links are whole.")
    else:
        say(f"\ndoctor: {wrong.sentence}\n        {wrong.cure}")


def _give_up(chain: Walk, found: list[Walked], wants_json: bool) -> None:
    """End the program where something does not answer that has no deadline."""
    wrong = fault("no_answer", link=chain.current, seconds=TIMEOUT)
    tell([*found, Walked(chain.current, BROKEN, wrong.name, wrong)], wants_json)
    os._exit(FOUND)


def main() -> None:
    """Run the command, and exit with its code."""
    # rospy, which would leave out remappings, may be what is missing.
    args = parser().parse_args([word for word in sys.argv[1:] if ":=" not in word])
    found = walk(args)
    tell(found, args.json)
    sys.exit(FOUND if fault_of(found) else WHOLE)
