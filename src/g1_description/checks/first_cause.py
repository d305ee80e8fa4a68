"""Why a robot fell, or strayed from its commands: which event explains which."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Callable

import numpy as np

from g1_description.checks.events import (
    Event,
    command_jumps,
    infeasible_commands,
    lags,
    late_commands,
    loads,
    lost_contacts,
    low_gains,
    pushed,
    saturations,
    slips,
    starts_high,
    unbalanced,
    weak_motors,
)
from g1_description.checks.run import ASTRAY, ERROR, TURNED, Run
from g1_description.motion.history_chunks import Stretch
from g1_description.motion.tracking import FallLimits
from g1_description.text import listed

FAILURE = "failure"
"""Name of the failure, which all events may explain."""

MEMORY = 2.0
"""How long a moment has consequences, in [s]."""

SOON = 0.1
"""Means over the window of accelerations begin up to this time too early, in [s]."""


@dataclass(frozen=True)
class Cause:
    """A row of the table: an event, its evidence, and what it explains."""

    name: str
    about: str
    """The evidence, for the documentation."""

    find: Callable[[Run], Iterator[Event]]
    explains: tuple[str, ...]
    """Names of the later events that need no other cause; failures are always."""

    lasts: bool = False
    """Whether it explains all that comes later; else for ``MEMORY`` only."""

    subject: str = "joint"
    """What its subjects are, if it has any."""


@dataclass(frozen=True)
class Explanation:
    """A failure with what led to it."""

    failure: Event
    chain: tuple[Event, ...]
    """The first cause, then what led to the failure in order of time; empty if
    unknown."""

    unknown: str = ""
    """Which events were not looked for, since the states lack what shows them."""

    def __str__(self) -> str:
        """Write the first cause, the other events, and what is unknown, in lines."""
        return "\n  ".join(filter(None, [self.first, *self.later, self.unknown]))

    @property
    def first(self) -> str:
        """The failure and its first cause in a line."""
        text = self.failure.text
        text = f"T{text[1:]}" if text.startswith("the ") else text
        begin = f"{text} at {self.failure.time:.3f} s."
        if not self.chain:
            return f"{begin} The first cause is not known."
        cause = self.chain[0]
        return f"{begin} First cause, at {cause.time:.3f} s: {cause.text}."

    @property
    def note(self) -> str:
        """The first cause and the other events in a line."""
        later = "; ".join(self.later)
        return f"{self.first} Other events: {later}." if later else self.first

    @property
    def later(self) -> list[str]:
        """The first event of each kind after the first cause, as a line."""
        kinds: dict[str, list[Event]] = {}
        for event in self.chain[1:]:
            kinds.setdefault(event.name, []).append(event)
        lines = []
        for name, (event, *more) in kinds.items():
            noun = CAUSE[name].subject + ("s" if len(more) > 1 else "")
            lines.append(
                f"{event}, and {len(more)} more {noun}" if more else f"{event}"
            )
        return lines


def failure_text(found: Explanation | None, states: Stretch) -> str:
    """Write an explanation, or which failures the states do not have."""
    if found is not None:
        return str(found)
    bases = states.base_poses if _has_values(states.base_poses) else None
    base_targets = None if bases is None else states.commanded_bases
    known = {
        "the robot does not fall": bases,
        f"no joint is {ERROR} rad off its command": states.commanded,
        f"the base is not {ASTRAY} m or {TURNED} rad off its command": base_targets,
    }
    *first, last = [text for text, of in known.items() if _has_values(of)] or [""]
    text = f"{', '.join(first)}, and {last}" if first else last
    missing = {"the base": bases, "commands": states.commanded}
    names = listed(name for name, of in missing.items() if not _has_values(of))
    lines = [
        f"Nothing failed: {text}." if text else "Nothing is known to have failed.",
        f"Not known: {names}." if names else "",
    ]
    if bases is not None:
        row = int((~np.isnan(bases).any(axis=1)).argmax())
        lean = np.arccos(np.clip(1.0 - 2.0 * (bases[row, 3:5] ** 2).sum(), -1.0, 1.0))
        if lean > FallLimits.lean:
            time = 1e-9 * states.stamps[row]
            lines.append(
                f"The base leans by {np.degrees(lean):.0f} degrees already in the "
                f"first state, at {time:.3f} s; an earlier fall is not looked at."
            )
    return "\n  ".join(filter(None, lines))


def _has_values(array: np.ndarray | None) -> bool:
    """Return whether something of an array is known."""
    return array is not None and not np.isnan(array).all()


def explain(run: Run) -> Explanation:
    """Find out why a robot failed."""
    failure = Event(FAILURE, run.end, (), run.failure)
    found = [event for cause in CAUSES for event in cause.find(run)]
    events = sorted((e for e in found if e.time <= run.end), key=lambda e: e.time)
    chain, newest = [], [failure]
    while newest:  # what led to the failure, from its end
        newest = [
            event
            for event in events
            if event not in chain and any(_explains(event, other) for other in newest)
        ]
        chain += newest
    chain = [event for event in events if event in chain]
    firsts: dict[tuple[str, tuple[str, ...]], Event] = {}
    first = next((event for event in chain if not _is_explained(event, chain)), None)
    for event in [first or chain[0], *chain] if chain else ():
        firsts.setdefault((event.name, event.subject), event)
    return Explanation(failure, (*firsts.values(),), run.unknown)


def _is_explained(event: Event, others: Sequence[Event]) -> bool:
    """Return whether another event explains an event; of two, the later one does not.

    Args:
        event: The event.
        others: In order of time, it among them.
    """
    at = others.index(event)
    return any(
        _explains(other, event) and (number < at or not _explains(event, other))
        for number, other in enumerate(others)
        if number != at
    )


def _explains(event: Event, later: Event) -> bool:
    """Return whether an event explains another one that is not before it."""
    cause = CAUSE[event.name]
    after = later.time - event.time
    in_time = after >= -SOON and (cause.lasts or after <= MEMORY)
    return in_time and later.name in (FAILURE, *cause.explains)


SYMPTOMS = ("lag", "saturation", "lost_contact", "slip", "unbalanced")

CAUSES = (
    Cause(
        "late_commands",
        "a stream of commands pauses for more than 0.1 s and five of its periods",
        late_commands,
        ("command_jump", "push", "low_gain", "infeasible_commands", *SYMPTOMS),
        subject="sender",
    ),
    Cause(
        "command_jump",
        "a command changes by 0.15 rad within 0.04 s, and by much less around it",
        command_jumps,
        ("push", "low_gain", "infeasible_commands", *SYMPTOMS),
    ),
    Cause(
        "starts_high",
        "no link is in contact at first, the lowest is above 0.02 m, and it drops",
        starts_high,
        ("push", "low_gain", "infeasible_commands", *SYMPTOMS),
        lasts=True,
    ),
    Cause(
        "push",
        "motion and efforts fit only with a force on the root link, 0.12 of the weight",
        pushed,
        ("low_gain", *SYMPTOMS),
        subject="link",
    ),
    Cause(
        "load",
        "motion and efforts fit only with 15 N or more in a hand",
        loads,
        ("low_gain", "push", *SYMPTOMS),
        lasts=True,
        subject="link",
    ),
    Cause(
        "weak_motor",
        "an effort below its limit stays the same while the tracking error changes",
        weak_motors,
        ("low_gain", "push", *SYMPTOMS),
        lasts=True,
    ),
    Cause(
        "low_gain",
        "a joint lags by 0.1 rad while its motor gives less than half of its limit",
        low_gains,
        ("push", *SYMPTOMS),
        lasts=True,
    ),
    Cause(
        "infeasible_commands",
        "the commanded motion has a finding of `contact_forces`",
        infeasible_commands,
        SYMPTOMS,
    ),
    Cause(
        "saturation",
        "a motor is at its limit while the tracking error changes",
        saturations,
        ("lag", "lost_contact", "unbalanced"),
    ),
    Cause("lag", "a joint lags by 0.1 rad", lags, ("lost_contact", "unbalanced")),
    Cause(
        "slip",
        "a foot in contact moves along the floor by more than 0.02 m",
        slips,
        ("lost_contact", "unbalanced", "lag", "saturation"),
        subject="link",
    ),
    Cause(
        "lost_contact",
        "a foot leaves the floor, and is not meant to",
        lost_contacts,
        ("unbalanced", "lag", "saturation"),
        subject="link",
    ),
    Cause(
        "unbalanced",
        "the centre of mass leaves the support polygon and does not come back",
        unbalanced,
        ("lost_contact", "lag", "saturation", "slip"),
    ),
)

CAUSE = {cause.name: cause for cause in CAUSES}
"""The rows by name."""
