"""Joint commands: what of a message can be obeyed, and how commands add up."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence


def split_command(
    names: Sequence[str], positions: Sequence[float], joints: Collection[str]
) -> tuple[dict[str, float], list[str]]:
    """Separate what can be obeyed in a command from what cannot.

    Args:
        names: Joint names as they came.
        positions: Positions in [rad] or [m] as they came.
        joints: Names of the joints that exist and move.

    Returns:
        The positions to set by joint name, where the last of equal names wins,
        and a clause for each thing that is wrong with the rest.
    """
    pairs = list(zip(names, positions))
    unknown = [name for name, _ in pairs if name not in joints]
    not_finite = [
        f"{name} = {position}"
        for name, position in pairs
        if name in joints and not math.isfinite(position)
    ]
    complaints = []
    if not names:
        complaints.append("it names no joint")
    if len(names) > len(positions):
        complaints.append(f"no position for {listed(names[len(positions) :])}")
    if len(positions) > len(names):
        complaints.append(
            f"{len(positions)} positions for {len(names)} names, the rest is ignored"
        )
    if unknown:
        complaints.append(f"no movable joint is called {listed(unknown)}")
    if not_finite:
        complaints.append(f"not a finite position: {listed(not_finite)}")
    accepted = {
        name: float(position)
        for name, position in pairs
        if name in joints and math.isfinite(position)
    }
    return accepted, complaints


def listed(names: Iterable[str]) -> str:
    """Join names for a sentence, cut short where there are very many."""
    once = list(dict.fromkeys(names))
    shown = ", ".join(name[:80] if name else "''" for name in once[:8])
    return shown + (f" and {len(once) - 8} more" if len(once) > 8 else "")
