"""The table of observations in docs/gazebo_compatibility.md."""

from collections import Counter

from ..ros_testing import REPOSITORY

PAGE = REPOSITORY / "docs" / "gazebo_compatibility.md"
BEGIN, END = "<!-- tools/compatibility writes from here -->", "<!-- to here -->"
GROUPS = {
    "contract": "names, types and handshakes of all topics, services, parameters",
    "physics": "physics: falling, bouncing, sliding, spinning, collapsing",
    "services": "parallel calls, persistent connections",
    "last": "deleting the ground plane and the sun",
}


def table(outcomes):
    """Count outcomes by what they are about.

    Args:
        outcomes: "agrees", "in part", "deviates: number N" or "differs: ..." by case.

    Returns:
        Markdown.
    """
    groups = {}
    for name, outcome in sorted(outcomes.items()):
        groups.setdefault(name.split(".")[0], []).append(outcome)
    rows = [row(GROUPS.get(name, f"`{name}`"), groups[name]) for name in sorted(groups)]
    rows.append(row("all", list(outcomes.values())))
    head = [
        "| observed | cases | agree | in part | deviate | differ |",
        "| --- " * 6 + "|",
    ]
    return "\n".join([*head, *rows])


def row(name, outcomes):
    """Write one line."""
    counts = Counter(outcome.split(":")[0] for outcome in outcomes)
    numbers = sorted({o.split()[-1] for o in outcomes if o.startswith("deviates")})
    which = f" (number {', '.join(numbers)})" if numbers else ""
    return (
        f"| {name} | {len(outcomes)} | {counts['agrees']} | {counts['in part']} | "
        f"{counts['deviates']}{which} | {counts['differs']} |"
    )


def with_table(text, outcomes):
    """Put the table into the page's text."""
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    return f"{before}{BEGIN}\n\n{table(outcomes)}\n\n{END}{after}"
