"""Joint commands: which positions of a message can be obeyed."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from g1_description.core.text import listed


def split_command(
    names: Sequence[str], positions: Sequence[float], joints: Collection[str]
) -> tuple[dict[str, float], list[str]]:
    """Split a command into positions that can be obeyed and problems.

    Args:
        names: Joint names in the command.
        positions: Positions in [rad] or [m] in the command.
        joints: Names of the joints that exist and move.

    Returns:
        The positions to set by joint name, where the last of equal names wins, and a
        part of a sentence for each problem with the rest.
    """
    pairs = list(zip(names, positions))
    unknown = [name for name, _ in pairs if name not in joints]
    not_finite = [
        f"{name} = {position}"
        for name, position in pairs
        if name in joints and not math.isfinite(position)
    ]
    problems = []
    if not names:
        problems.append("it names no joint")
    if len(names) > len(positions):
        problems.append(f"no position for {listed(names[len(positions) :])}")
    if len(positions) > len(names):
        problems.append(
            f"{len(positions)} positions for {len(names)} names, the rest is ignored"
        )
    if unknown:
        problems.append(f"no movable joint is called {listed(unknown)}")
    if not_finite:
        problems.append(f"not a finite position: {listed(not_finite)}")
    accepted = {
        name: float(position)
        for name, position in pairs
        if name in joints and math.isfinite(position)
    }
    return accepted, problems
