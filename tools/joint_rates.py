"""Measure how fast joints accelerate in motions; see tools/joint_rates."""

import argparse
from pathlib import Path

import numpy as np

from g1_description import Robot
from g1_description.checks.rules.limits import derivatives

PERCENTILES = (50.0, 99.0, 99.9, 100.0)


def row(label, values):
    """Print the percentiles of values with any shape; NaN are unknown."""
    known = np.abs(values[np.isfinite(values)])
    found = np.percentile(known, PERCENTILES)
    print(f"{label:44}{known.size:9d}" + "".join(f"{v:11.1f}" for v in found))


def main():
    """Print a row for each motion, and those of all together."""
    parser = argparse.ArgumentParser(prog="tools/joint_rates", description=__doc__)
    parser.add_argument("motions", nargs="+", type=Path, metavar="FILE")
    parser.add_argument(
        "--fps",
        type=float,
        help="of files without times",
    )
    args = parser.parse_args()
    robot = Robot()
    motions = [robot.read_motion(path, rate=args.fps) for path in args.motions]
    found = [derivatives(motion) for motion in motions]
    for number, what in enumerate(("acceleration, rad/s^2", "jerk, rad/s^3")):
        heads = "".join(f"{f'{p:g} %':>11}" for p in PERCENTILES)
        print(f"{what:44}{'samples':>9}{heads}")
        for path, rates in zip(args.motions, found):
            row(path.name, rates[number])
        if len(found) > 1:
            row("all", np.concatenate([rates[number].ravel() for rates in found]))


if __name__ == "__main__":
    main()
