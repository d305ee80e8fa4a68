"""Write the checks' table of docs/checks.md, and their lines of config/checks.yaml.

Usage: .venv/bin/python tools/rule_pages.py, after a rule has changed.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "src"))

from g1_description.checks.rules import RULES  # noqa: E402

TABLE = r"(\| check \| what is found \| needs \|\n\| --- \| --- \| --- \|\n)(\|.*\n)+"
LEVELS = r"(?ms)^\w+: \{warning.*^\w+: \{warning[^\n]*\n"


def number(value):
    """Write a threshold as YAML has it."""
    text = "null" if value is None else repr(float(value))
    return text.replace("1e-", "1.0e-")  # YAML 1.1 takes 1e-06 for a text


def pages():
    """Return the text that each file should have, by its path."""
    rows, lines = [], []
    for rule in RULES:
        row = f"| `{rule.name}` | {rule.about} | {rule.requires}"
        rows.append(f"{row.rstrip()} |\n")
        warning, failure = number(rule.level.warning), number(rule.level.failure)
        line = f"{rule.name}: {{warning: {warning}, failure: {failure}}}"
        worse = "; less is worse" if rule.lower_is_worse else ""
        lines.append(f"{line:51} # {rule.limit}{worse}\n")
    texts = {
        "docs/checks.md": (TABLE, lambda found: found[1] + "".join(rows)),
        "config/checks.yaml": (LEVELS, lambda _: "".join(lines)),
    }
    return {
        ROOT / name: re.sub(pattern, text, (ROOT / name).read_text(), count=1)
        for name, (pattern, text) in texts.items()
    }


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text)
