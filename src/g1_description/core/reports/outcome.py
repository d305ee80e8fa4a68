"""What became of a file of a motion that was to be checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

from g1_description.core.checks.verdict import FAILED, PASSED, WARNING, Verdict

NOT_READ, NOT_CHECKED = "not read", "not checked"
NO_MOTION = "not a motion"

RESULTS = (PASSED, WARNING, FAILED, NOT_READ, NOT_CHECKED, NO_MOTION)
"""What may become of a file."""


@dataclass(frozen=True)
class Outcome:
    """A verdict on the motion of a file, or why there is none."""

    file: str
    """As it was named, or as it was found in a folder that was."""

    verdict: Verdict | None = None

    problem: str = ""
    """A sentence on why there is no verdict."""

    without_verdict: str = NOT_CHECKED
    """The result where there is no verdict."""

    plot: bytes = b""
    """A picture as PNG; empty where none is wanted."""

    @property
    def result(self) -> str:
        """One of ``RESULTS``."""
        if self.verdict is not None:
            return self.verdict.severity
        return self.without_verdict

    def without_plot(self) -> Outcome:
        """Leave the picture out."""
        return replace(self, plot=b"")


def counted(results: Iterable[str]) -> dict[str, int]:
    """Count results: numbers by all of ``RESULTS``."""
    counts = Counter(results)
    return {result: counts[result] for result in RESULTS}
