"""The command collision_pairs, which writes a file of allowed collisions.

It needs nothing of ROS.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from g1_description.choices import DEFAULT
from g1_description.collisions.allowed_pairs import (
    REASONS,
    USER,
    AllowedPairs,
    allowed_pairs_text,
    read_allowed_pairs,
    with_pairs,
    write_allowed_pairs,
)
from g1_description.collisions.find_pairs import NEAR, SAMPLES, find_allowed_pairs
from g1_description.command_line import (
    argument,
    exit_with_error,
    option,
    parse,
    say,
    within,
)
from g1_description.errors import G1DescriptionError
from g1_description.robot.load import read_description

MAX_SEED = 2**32 - 1

ABOUT = """\
Pairs of links that are not checked for collisions, each with the reason. The file was
written by

  rosrun g1_description collision_pairs {model} --samples {samples} --seed {seed}

which puts all joints at random positions inside their limits. A pair is called "never"
if it was never nearer than {near:g} mm. That does not prove that it cannot touch:
a contact in more than {share:.2g} % of all configurations is missed with a probability
of 5 %. Delete a line to have the pair checked. Lines with "user" are kept when
the file is written again. The file serves any robot whose links are all in it.
"""


@dataclass(frozen=True)
class PairsOptions:
    """Find pairs of links that need no check for collisions.

    They are connected by a joint, or overlap always, at zero, or never. Prints them as
    YAML.
    """

    model: str = argument(
        "a profile, or a URDF or xacro file, as for model:= of the launch files",
        str,
        nargs="?",
        default=DEFAULT,
        metavar="MODEL",
    )
    samples: int = option(
        "random configurations", SAMPLES, within(1, MAX_SEED, int), metavar="N"
    )
    seed: int = option(
        "seed of the random numbers", 0, within(0, MAX_SEED, int), metavar="S"
    )
    out: Path | None = option(
        "write to this file instead; its pairs with reason 'user' are kept",
        None,
        Path,
        names=("-o", "--out"),
        metavar="FILE",
    )


def show_progress(done: int, total: int) -> None:
    """Show the progress on a terminal."""
    if sys.stderr.isatty():
        end = "\n" if done >= total else ""
        share = 100 * done // total
        print(f"\rcollision_pairs: {share:3d} %", end=end, file=sys.stderr, flush=True)


def summary(allowed: AllowedPairs) -> str:
    """Count the pairs of each reason."""
    counts = Counter(pair.reason for pair in allowed.pairs)
    listed = ", ".join(f"{counts[reason]} {reason}" for reason in REASONS)
    return f"{len(allowed.links)} links; allowed pairs: {listed}."


def run(args: PairsOptions) -> None:
    """Find the pairs, and write or print them.

    Raises:
        G1DescriptionError: If that fails; then nothing is written.
    """
    kept = read_allowed_pairs(args.out).pairs if args.out and args.out.exists() else ()
    robot = read_description(args.model)
    allowed = find_allowed_pairs(robot, args.samples, args.seed, show_progress)
    allowed = with_pairs(allowed, [pair for pair in kept if pair.reason == USER])
    about = ABOUT.format(
        model=args.model,
        samples=args.samples,
        seed=args.seed,
        near=1e3 * NEAR,
        share=300.0 / max(args.samples, 1),
    )
    if args.out:
        write_allowed_pairs(args.out, allowed, about)
        say(f"{args.out}: {summary(allowed)}")
    else:
        say(allowed_pairs_text(allowed, about).rstrip("\n"))


def main() -> None:
    """Run the command line."""
    args = parse(PairsOptions, "collision_pairs")
    try:
        run(args)
    except (G1DescriptionError, OSError) as error:
        exit_with_error("collision_pairs", error)
