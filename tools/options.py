"""Rows of pages, lists of the completion and doc="" of launch files, from the code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from g1_description.cli.check_options import CheckOptions
from g1_description.cli.collision_pairs import PairsOptions
from g1_description.cli.doctor import DoctorOptions
from g1_description.cli.play import PlayOptions
from g1_description.cli.pose import PoseOptions
from g1_description.cli.record import RecordOptions
from g1_description.cli.snapshot import SnapshotOptions
from g1_description.cli.web import WebOptions
from g1_description.command_line import arguments_of, default_text
from g1_description.importer.command import ImportOptions

ROOT = Path(__file__).resolve().parents[1]

COMMANDS: dict[str, tuple[str, type[Any]]] = {
    "check": ("checks.md", CheckOptions),
    "collision_pairs": ("checks.md", PairsOptions),
    "doctor": ("doctor.md", DoctorOptions),
    "import_model": ("import.md", ImportOptions),
    "play": ("motions.md", PlayOptions),
    "pose": ("poses.md", PoseOptions),
    "record": ("motions.md", RecordOptions),
    "snapshot": ("pictures.md", SnapshotOptions),
    "web": ("browser.md", WebOptions),
}
"""The page that lists a command's options, and their dataclass."""

LAUNCH_FILES = ("display", "bridge", "checks", "view", "replay", "web")
"""The first of these that declares an argument says what it means."""

OWN_MEANING = {("bridge", "rate"), ("view", "use_sim_time")}
OWN_MEANING |= {("web", "ghost"), ("web", "robot_name")}
"""Launch files where an argument means something else."""


def rows(options: type[Any], page: str) -> str:
    """Write the rows of a command's table for a page."""
    lines = ["| option | default | meaning |", "| --- | --- | --- |"]
    for name, declared in arguments_of(options).items():
        value = declared.given.get("metavar")
        flags = [f"`{flag}`" for flag in declared.flags(name)]
        if declared.is_positional:
            flags = [f"`{value or name}`"]
        see = f"; see {declared.see}" if declared.see else ""
        see = see.replace(f"({page}#", "(#")
        default = default_text(declared)
        if default and not declared.shown:
            default = f"`{default}`"
        about = re.sub(r"(?<![\w`-])(--[a-z-]+)", r"`\1`", declared.about)
        cells = (", ".join(flags), default, f"{about}{see}")
        lines.append(
            "|".join(["", *(f" {cell} " if cell else " " for cell in cells), ""])
        )
    return "\n".join(lines)


def flags_of(options: type[Any], *, alone: bool = False, files: bool = False) -> str:
    """List options for the completion.

    Args:
        options: The command's dataclass.
        alone: Only those that have no value.
        files: Only those whose value is a file.
    """
    found = [] if alone or files else ["--help"]
    for name, declared in arguments_of(options).items():
        if declared.is_positional:
            continue
        is_alone = declared.given.get("action") == "store_true"
        is_file = declared.given.get("type") is Path or name in FILES
        if (not alone or is_alone) and (not files or is_file):
            found += [flag for flag in declared.flags(name) if flag.startswith("--")]
    return " ".join(sorted(found))


FILES = ("csv", "json", "model", "motion", "out")
"""Options whose values are files, besides those that are read as paths."""


def completion() -> str:
    """Write the lists of the completion."""
    lines = [
        f'_g1_description_options[{command}]="{flags_of(options)}"'
        for command, (_, options) in COMMANDS.items()
    ]
    kinds = [options for _, options in COMMANDS.values()]
    for name, only in (("flags", {"alone": True}), ("files", {"files": True})):
        words = " ".join(flags_of(options, **only) for options in kinds).split()
        lines.append(f'_g1_description_{name}=" {" ".join(sorted({*words}))} "')
    until = arguments_of(DoctorOptions)["until"].given["choices"]
    return "\n".join([*lines, f'_g1_description_links="{" ".join(until)}"'])


def with_block(text: str, name: str, block: str, marks: tuple[str, str]) -> str:
    """Replace what stands between the marks of a name.

    Raises:
        LookupError: If the marks are not there.
    """
    begin, end = (f"{marks[0]}{word} {name}{marks[1]}\n" for word in ("options", "end"))
    before, found, rest = text.partition(begin)
    _, is_closed, after = rest.partition(end)
    if not (found and is_closed):
        raise LookupError(f"there is no place for {name}: {begin.strip()}")
    return f"{before}{begin}{block}\n{end}{after}"


def launch_texts() -> dict[Path, str]:
    """Return the launch files with the meanings of the first that declares them."""
    paths = sorted(
        (ROOT / "launch").glob("*.launch"),
        key=lambda path: (
            LAUNCH_FILES.index(path.stem) if path.stem in LAUNCH_FILES else 99
        ),
    )
    meanings: dict[str, str] = {}
    found = {}
    for path in paths:

        def replaced(match: re.Match[str], path: Path = path) -> str:
            head, name, between, about = match.groups()
            if (path.stem, name) in OWN_MEANING:
                return match[0]
            return f'{head}{name}{between}{meanings.setdefault(name, about)}"'

        pattern = r'(<arg name=")(\w+)("[^>]*?doc=")([^"]*)"'
        found[path] = re.sub(pattern, replaced, path.read_text())
    return found


def texts() -> dict[Path, str]:
    """Return all files that say something of options, as they should be."""
    found = launch_texts()
    for command, (page, options) in COMMANDS.items():
        path = ROOT / "docs" / page
        text = found.get(path) or path.read_text()
        found[path] = with_block(text, command, rows(options, page), ("<!-- ", " -->"))
    path = ROOT / "config" / "completion.bash"
    found[path] = with_block(path.read_text(), "of commands", completion(), ("# ", ""))
    return found


if __name__ == "__main__":
    for path, text in texts().items():
        if path.read_text() != text:
            path.write_text(text)
            print(f"tools/options: wrote {path.relative_to(ROOT)}")
