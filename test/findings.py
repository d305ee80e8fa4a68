"""Findings, verdicts and results of files, for tests."""

from hypothesis import strategies as st

from g1_description.checks.report import FIGURES, RESULTS, FileResult
from g1_description.checks.rules import RULES
from g1_description.checks.verdict import Finding, Verdict, sorted_findings

NAMES = [rule.name for rule in RULES]
NUMBERS = st.floats(-1e307, 1e307)
TIMES = st.floats(0.0, 1e4)
# Without NUL, which csv of Python 3.8 does not read; messages quote it.
WORDS = st.text(
    st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"),
    min_size=1,
    max_size=12,
)
INTERVALS = st.lists(st.tuples(TIMES, TIMES), max_size=3).map(tuple)


def findings(checks):
    return st.builds(
        Finding,
        check=st.sampled_from(checks),
        severity=st.sampled_from(["failed", "warning"]),
        subject=st.lists(WORDS, max_size=2).map(tuple),
        worst=NUMBERS,
        bound=st.just(-1e308),  # all sizes are above it: more is worse
        unit=WORDS,
        first_time=TIMES,
        worst_time=TIMES,
        share=st.floats(0.0, 1.0),
        intervals=INTERVALS,
        text=WORDS,
        points=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=2).map(tuple),
    )


@st.composite
def verdicts(draw):
    """Draw a verdict of any checks."""
    checked = draw(st.sets(st.sampled_from(NAMES), min_size=1))
    skipped = {name: draw(WORDS) for name in NAMES if name not in checked}
    found = draw(st.lists(findings(sorted(checked)), max_size=5))
    return Verdict(
        draw(WORDS),
        sorted_findings(found),
        tuple(sorted(checked)),
        skipped,
        draw(st.dictionaries(st.sampled_from(list(FIGURES)), NUMBERS)),
        draw(st.dictionaries(WORDS, INTERVALS, max_size=2)),
        draw(st.lists(WORDS, max_size=2).map(tuple)),
    )


OUTCOMES = st.builds(FileResult, WORDS, verdicts()) | st.builds(
    FileResult, WORDS, st.none(), WORDS, st.sampled_from(RESULTS[3:])
)


def finding(**changes):
    values = {
        **{"check": "position", "severity": "failed", "subject": ("elbow",)},
        **{"worst": 0.5, "bound": 0.1, "unit": "rad", "first_time": 1.25},
        **{"worst_time": 2.0, "share": 0.5, "intervals": ((1.25, 2.0),), "text": "far"},
    }
    return Finding(**{**values, **changes})
