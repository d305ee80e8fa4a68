"""The figures as a table for people, as JSON, and as a page."""

import json
import os
import platform
import sys
from pathlib import Path

CAUTION = (
    "Virtual machines are up to three times slower at some hours than at others. "
    "Ratios of one run tell more than times, and targets were set for a fast hour."
)
"""What to bear in mind with all figures."""


def machine():
    """Describe the machine in a few words."""
    facts = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    names = [line.split(":")[1].strip() for line in facts if "model name" in line]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"


def facts(bench, command):
    """List what the figures depend on, by name."""
    return {
        "machine": machine(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "seed": bench.seed,
        "command": command,
    }


def verdict(figure):
    """Say in a word whether a target is reached."""
    return {True: "yes", False: "NO", None: ""}[figure.reached]


def summary(bench):
    """Count the targets in a sentence."""
    targets = [figure for figure in bench.figures if figure.target]
    reached = sum(figure.reached for figure in targets)
    return f"{reached} of {len(targets)} targets are reached."


def print_table(bench, command):
    """Print all on the terminal."""
    print()
    for name, fact in facts(bench, command).items():
        print(f"{name}: {fact}")
    part = None
    for figure in bench.figures:
        if figure.part != part:
            part = figure.part
            print(f"\n{part}")
        value = f"{figure.words:>10} {figure.unit:4} {figure.target:8}"
        print(f"  {figure.name:58} {value} {verdict(figure)}".rstrip())
    for part, text in bench.left_out:
        print(f"\nleft out of {part}: {text}")
    print(f"\n{summary(bench)}")


def write_json(bench, command, file):
    """Write all for programs."""
    figures = [
        {
            "part": figure.part,
            "name": figure.name,
            "value": figure.value,
            "unit": figure.unit,
            "target": figure.target,
            "reached": figure.reached,
        }
        for figure in bench.figures
    ]
    left_out = [{"part": part, "text": text} for part, text in bench.left_out]
    content = {**facts(bench, command), "figures": figures, "left_out": left_out}
    Path(file).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def write_page(bench, command, file, texts):
    """Write all as markdown.

    Args:
        bench: What was measured.
        command: The command that did.
        file: Where to.
        texts: How each part measures, by its name.
    """
    lines = ["# Performance", "", f"<!-- {command} writes this page. -->", ""]
    known = facts(bench, command)
    lines += ["| | |", "| --- | --- |"]
    lines += [f"| {name} | {fact} |" for name, fact in known.items()]
    lines += ["", f"{summary(bench)} {CAUTION}"]
    for part in dict.fromkeys(figure.part for figure in bench.figures):
        lines += ["", f"## {part}", "", texts[part].strip(), "", *table(bench, part)]
    if bench.left_out:
        lines += ["", "## Left out", ""]
        lines += [f"- {part}: {text}" for part, text in bench.left_out]
    Path(file).write_text("\n".join(lines) + "\n", encoding="utf-8")


def table(bench, part):
    """Give the lines of a part's table."""
    lines = ["| figure | measured | target | reached |", "| --- | ---: | --- | --- |"]
    for figure in bench.figures:
        if figure.part == part:
            cells = figure.name, f"{figure.words} {figure.unit}".strip()
            cells += figure.target, verdict(figure)
            lines.append(f"| {' | '.join(cells)} |".replace("  ", " "))
    return lines


def command_line(tool="tools/benchmark"):
    """Give the command as it was typed."""
    return " ".join([tool, *sys.argv[1:]])
