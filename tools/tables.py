"""Tables of pages, completion, thresholds and launch docs, written from the code."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Collection
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from g1_description.bridge.parameters import BridgeParameters
from g1_description.checker.parameters import CheckerParameters
from g1_description.checks.first_cause import CAUSES
from g1_description.checks.rules import RULES
from g1_description.cli.check import CheckOptions
from g1_description.cli.collision_pairs import PairsOptions
from g1_description.cli.doctor import CHECKS, DoctorOptions, run_checks
from g1_description.cli.motion_edits import COMMANDS as MOTION
from g1_description.cli.motion_edits import Edit, Mend, Reading
from g1_description.cli.moveit_config import MoveItOptions
from g1_description.cli.play import PlayOptions
from g1_description.cli.pose import PoseOptions
from g1_description.cli.record import RecordOptions
from g1_description.cli.snapshot import SnapshotOptions
from g1_description.cli.web import WebOptions
from g1_description.cli.why import WhyOptions
from g1_description.command_line import Argument, arguments_of, default_text
from g1_description.gazebo.parameters import GazeboParameters, SpawnerParameters
from g1_description.gazebo.programs.spawn_scene import SceneParameters
from g1_description.importer.import_model import ImportOptions
from g1_description.interactive.node import InteractiveParameters
from g1_description.ros.parameters import NAMESPACE
from g1_description.web.node import WebParameters

from ros_tables import (
    argument_text,
    interface_rows,
    launch_meanings,
    launch_rows,
    launch_texts,
    row,
)

ROOT = Path(__file__).resolve().parents[1]

COMMANDS: dict[str, tuple[str, type[Any]]] = {
    "check": ("checks_reference.md", CheckOptions),
    "collision_pairs": ("self_collision.md", PairsOptions),
    "doctor": ("doctor.md", DoctorOptions),
    "import_model": ("import.md", ImportOptions),
    "moveit_config": ("robots.md", MoveItOptions),
    "play": ("motions.md", PlayOptions),
    "pose": ("poses.md", PoseOptions),
    "record": ("motions.md", RecordOptions),
    "snapshot": ("pictures.md", SnapshotOptions),
    "web": ("browser.md", WebOptions),
    "why": ("why.md", WhyOptions),
}
"""The page that lists a command's options, and their dataclass. ``motion`` has one for
each subcommand."""

COMMON = ("model", "fps", "topic", "order", "input_joint_order", "format")
"""Options of several commands, which stand in one table, on ``COMMON_PAGE``."""

COMMON_PAGE = "commands.md"

NODES = {
    "link_states_bridge": BridgeParameters,
    "gazebo": GazeboParameters,
    "spawn_urdf": SpawnerParameters,
    "spawn_scene": SceneParameters,
    "checker": CheckerParameters,
    "web": WebParameters,
    "interactive": InteractiveParameters,
}
"""The dataclass of a node's parameters."""

ARGUMENTS = {
    "display": "launch.md",
    "two_robots": "launch.md",
    "view": "launch.md",
    "replay": "motions.md",
}
"""The page that lists a launch file's arguments."""

HEAD = ["| option | default | meaning |", "| --- | --- | --- |"]


def rows(options: type[Any], page: str) -> str:
    """Write a command's table for a page."""
    return "\n".join([*HEAD, *option_rows(options, page)])


def motion_rows(page: str) -> str:
    """Write the table of all subcommands of ``motion``: shared options first."""
    lines = [*HEAD, *option_rows(Edit, page)]
    for command, options in MOTION.items():
        known = Edit if issubclass(options, Edit) else Reading
        lines += option_rows(options, page, command, {*arguments_of(known)})
    return "\n".join(lines)


def option_rows(
    options: type[Any], page: str, command: str = "", left_out: Collection[str] = ()
) -> list[str]:
    """Write the rows of options, those of a subcommand with its name."""
    common = {} if left_out else common_flags(options)
    lines = [
        option_row(name, declared, page, command)
        for name, declared in arguments_of(options).items()
        if name not in left_out and name not in common
    ]
    if common:
        flags = ", ".join(f"`{flag}`" for flag in common.values())
        see = f"see [common options]({COMMON_PAGE}#common-options)"
        lines.append(row((flags, "", see)))
    return lines


def option_row(name: str, declared: Argument, page: str, command: str = "") -> str:
    """Write the row of an option."""
    value = declared.given.get("metavar")
    flags = [f"`{command} {flag}`" for flag in declared.flags(name)]
    flags = [flag.replace("` ", "`") for flag in flags]
    if declared.is_positional:
        flags = [f"`{value or name}`"]
    see = f"; see {declared.see}" if declared.see else ""
    see = see.replace(f"({page}#", "(#")
    default = default_text(declared)
    if default and not declared.shown:
        default = f"`{default}`"
    about = re.sub(r"(?<![\w`-])(--[a-z-]+)", r"`\1`", declared.about)
    return row((", ".join(flags), default, f"{about}{see}"))


def common_flags(options: type[Any]) -> dict[str, str]:
    """Return the flags of common options by field; of a single one, none."""
    known = arguments_of(Reading)
    meanings = {known[name].about for name in COMMON}
    found = {
        name: declared.flags(name)[0]
        for name, declared in arguments_of(options).items()
        if declared.about in meanings
    }
    return found if len(found) > 1 else {}


def common_rows() -> str:
    """Write the table of the common options."""
    known = arguments_of(Reading)
    return "\n".join(
        [*HEAD, *(option_row(name, known[name], COMMON_PAGE) for name in COMMON)]
    )


def command_rows() -> str:
    """Write the table of the commands."""
    lines = ["| command | what it does |", "| --- | --- |"]
    known = {
        name: (page, (options.__doc__ or "").splitlines()[0])
        for name, (page, options) in COMMANDS.items()
    }
    known["motion"] = ("motions.md", "Say what motions are, convert and edit them.")
    for name, (page, about) in sorted(known.items()):
        text = about[0].lower() + about[1:].rstrip(".")
        lines.append(row((f"[`{name}`]({page})", text)))
    return "\n".join(lines)


def meanings_of(kind: type[Any]) -> dict[str, str]:
    """Return the docstrings of a dataclass' fields."""
    found: dict[str, str] = {}
    for one in reversed(kind.__mro__[:-1]):
        source = textwrap.dedent(inspect.getsource(one))
        (tree,) = ast.parse(source).body
        assert isinstance(tree, ast.ClassDef)
        for line, after in zip(tree.body, tree.body[1:]):
            if isinstance(line, ast.AnnAssign) and isinstance(after, ast.Expr):
                assert isinstance(line.target, ast.Name)
                name = line.target.id
                found[name] = " ".join(ast.literal_eval(after.value).split())
    return found


def parameter_rows(kind: type[Any], namespace: str = "") -> list[str]:
    """Write the rows of a node's parameters.

    A field's docstring is its meaning; without one, that of the launch argument.
    """
    lines, meanings, unit = [], meanings_of(kind), ""
    for known in fields(kind):
        inner = known.default_factory
        if is_dataclass(inner):
            below = namespace + known.metadata.get(NAMESPACE, "")
            lines += parameter_rows(inner, below)
            continue
        default: Any = known.default
        if isinstance(default, bool):
            default = str(default).lower()
        if default in ("", ()):
            default = "(empty)"
        elif isinstance(default, str) and default not in ("true", "false"):
            default = f"`{default}`"
        text = meanings.get(known.name, "")
        if not text and known.name in launch_meanings():
            text = argument_text(known.name, launch_meanings()[known.name], "nodes.md")
            text = text.replace(" (stand-in only)", "")
        if text:
            match = re.search(r",? in \[([^\]]+)\]|^\[(\w+)[^\]]*\] ?", text)
            unit = match[1] or match[2] if match else ""
            text = text.replace(match[0], "") if match else text
            text = text.rstrip(".").replace("``", "`")
            text = text[:1].lower() + text[1:]
        cells = (f"`~{namespace}{known.name}`", default, unit, text)
        lines.append(row(cells))
    return lines


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


FILES = ("compare", "csv", "json", "model", "motion", "out")
"""Options whose values are files, besides those that are read as paths."""


def completion() -> str:
    """Write the lists of the completion."""
    lines = [
        f'_g1_description_options[{command}]="{flags_of(options)}"'
        for command, (_, options) in COMMANDS.items()
    ]
    words = sorted({w for o in MOTION.values() for w in flags_of(o).split()})
    lines.append(f'_g1_description_options[motion]="{" ".join(words)}"')
    lines.sort()
    kinds = [*(options for _, options in COMMANDS.values()), *MOTION.values()]
    for name, only in (("flags", {"alone": True}), ("files", {"files": True})):
        words = " ".join(flags_of(options, **only) for options in kinds).split()
        lines.append(f'_g1_description_{name}=" {" ".join(sorted({*words}))} "')
    until = arguments_of(DoctorOptions)["until"].given["choices"]
    lines.append(f'_g1_description_motion="{" ".join(MOTION)}"')
    return "\n".join([*lines, f'_g1_description_links="{" ".join(until)}"'])


def with_block(text: str, name: str, block: str, marks: tuple[str, str]) -> str:
    """Replace what stands between the marks of a name.

    Raises:
        LookupError: If the marks are not there.
    """
    begin, end = (f"{marks[0]}{word} {name}{marks[1]}\n" for word in ("table", "end"))
    before, found, rest = text.partition(begin)
    _, is_closed, after = rest.partition(end)
    if not (found and is_closed):
        raise LookupError(f"there is no place for {name}: {begin.strip()}")
    return f"{before}{begin}{block}\n{end}{after}"


def example(path: Path) -> str:
    """Write an example and what it prints."""
    output = path.parent / "output" / f"{path.stem}.txt"
    printed = f"$ python3 {path.relative_to(ROOT)}\n{output.read_text()}"
    return f"```python\n{path.read_text()}```\n\n```text\n{printed}```"


def level_of(value: float | None) -> str:
    """Write a threshold; YAML 1.1 takes 1e-06 for a text."""
    text = "null" if value is None else repr(float(value))
    return text.replace("1e-", "1.0e-")


def rule_rows() -> str:
    """Write the table of the checks."""
    lines = ["| check | what is found | needs |", "| --- | --- | --- |"]
    for rule in RULES:
        lines.append(
            f"| `{rule.name}` | {rule.about} | {rule.requires}".rstrip() + " |"
        )
    return "\n".join(lines)


def cause_rows() -> str:
    """Write the table of the events before failures."""
    lines = ["| event | evidence | explains |", "| --- | --- | --- |"]
    for cause in CAUSES:
        mark = "*" if cause.lasts else ""
        explained = ", ".join(f"`{name}`" for name in cause.explains)
        lines.append(row((f"`{cause.name}`{mark}", cause.about, explained)))
    return "\n".join(lines)


def levels() -> str:
    """Write the default thresholds of the checks."""
    lines = []
    for rule in RULES:
        warning, failure = map(level_of, (rule.level.warning, rule.level.failure))
        line = f"{rule.name}: {{warning: {warning}, failure: {failure}}}"
        worse = "; less is worse" if rule.lower_is_worse else ""
        lines.append(f"{line:51} # {rule.limit}{worse}")
    return "\n".join(lines)


def doctor_rows() -> tuple[str, str]:
    """Write the tables of the doctor's checks and faults."""
    checks = ["| check | ok if |", "| --- | --- |"]
    faults = ["| fault | meaning |", "| --- | --- |"]
    for name, function in [*((n, f) for n, _, f in CHECKS), ("", run_checks)]:
        text = inspect.getdoc(function).replace("``", "`")
        about, _, found = text.partition("\n\nFaults:\n")
        about = " ".join(about.split()).rstrip(".")
        if name:
            checks.append(row((f"`{name}`", about.replace("Check that ", ""))))
        for fault in re.findall(r"^    (\w+): ((?:.|\n {8})*)", found, flags=re.M):
            faults.append(
                row((f"`{fault[0]}`", " ".join(fault[1].split()).rstrip(".")))
            )
    return "\n".join(checks), "\n".join(faults)


def texts() -> dict[Path, str]:
    """Return all files that repeat the code, as they should be."""
    found = launch_texts()

    def put(
        file: str, name: str, block: str, marks: tuple[str, str] = ("<!-- ", " -->")
    ) -> None:
        path = ROOT / file
        text = found.get(path) or path.read_text()
        found[path] = with_block(text, name, block, marks)

    for command, (page, options) in COMMANDS.items():
        put(f"docs/{page}", command, rows(options, page))
    put("docs/motions.md", "motion", motion_rows("motions.md"))
    for node, kind in NODES.items():
        head = ["| parameter | default | unit | meaning |", "| --- | --- | --- | --- |"]
        put("docs/nodes.md", node, "\n".join([*head, *parameter_rows(kind)]))
    for file in sorted((ROOT / "examples").glob("*.py")):
        put("docs/examples.md", file.stem, example(file))
    for stem, page in ARGUMENTS.items():
        put(f"docs/{page}", f"{stem}.launch", launch_rows(stem, page))
    for name, block in zip(("checks", "faults"), doctor_rows()):
        put("docs/doctor.md", name, block)
    for folder in ("msg", "srv"):
        put("docs/messages.md", folder, interface_rows(folder))
    put(f"docs/{COMMON_PAGE}", "commands", command_rows())
    put(f"docs/{COMMON_PAGE}", "common", common_rows())
    put("docs/checks_reference.md", "rules", rule_rows())
    put("docs/why.md", "causes", cause_rows())
    known = {*arguments_of(Edit)} - {"out"}
    mend = [*HEAD, *option_rows(Mend, "mend.md", left_out=known)]
    put("docs/mend.md", "fixes", "\n".join(mend))
    put("config/checks.yaml", "of checks", levels(), ("# ", ""))
    put("config/completion.bash", "of commands", completion(), ("# ", ""))
    return found


if __name__ == "__main__":
    for path, text in texts().items():
        if path.read_text() != text:
            path.write_text(text)
            print(f"tools/tables: wrote {path.relative_to(ROOT)}")
