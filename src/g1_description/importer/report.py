"""The report of an import for its folder, and the summary for the terminal."""

from __future__ import annotations

import os
from collections.abc import Iterator

from g1_description.importer.meshes.meshes import millimetres

from .importing import Import, MeshFile
from .robot import Robot


def report(imported: Import, where: str) -> str:
    """Write the report, in Markdown.

    Args:
        imported: What was done.
        where: A message on how the URDF names its meshes.
    """
    lines = ["# Import report", "", where, ""]
    for robot in imported.robots:
        lines += _robot_section(robot)
    if imported.faults:
        lines += ["## Skipped", "", *(f"- {fault}" for fault in imported.faults), ""]
    if imported.files:
        lines += _mesh_section(list(imported.files.values()))
    return "\n".join(lines).rstrip() + "\n"


def summary(imported: Import) -> str:
    """Write the summary that the terminal shows."""
    lines = []
    for robot in imported.robots:
        lines.append(
            f"{os.path.basename(robot.name)} from {robot.source}: {_figures(robot)}"
        )
        lines += [f"  {text}" for text in (*robot.changes, *robot.findings)]
    files = imported.files.values()
    changed = sum(bool(file.changes) for file in files)
    lines.append(f"{len(files)} mesh files, {changed} changed")
    moved = {file.moved: file.name for file in files if file.moved is not None}
    if moved:
        most = max(moved)
        lines.append(
            f"Decimation moved no mesh by more than {millimetres(most)} "
            f"({moved[most]})."
        )
    lines += [f"  {file.name} {text}." for file in files for text in file.findings]
    lines += [f"Skipped: {fault}" for fault in imported.faults]
    return "\n".join(lines)


def _figures(robot: Robot) -> str:
    """Count what a robot has."""
    found = robot.description
    meshes = sum(ref.is_mesh for ref in robot.references)
    mass = "" if found.mass is None else f" {found.mass:.6g} kg,"
    return (
        f"robot {found.name}, {len(found.links)} links, {len(found.joints)} joints "
        f"({len(found.movable_joints)} movable),{mass} meshes in {meshes} places"
    )


def _robot_section(robot: Robot) -> Iterator[str]:
    """Write the part of one robot."""
    yield from (f"## {os.path.basename(robot.name)}", "")
    yield from (f"From `{robot.source}`: {_figures(robot)}.", "")
    for title, texts in (("Changed", robot.changes), ("To check", robot.findings)):
        if texts:
            yield from (f"### {title}", "", *(f"- {text}" for text in texts), "")


def _mesh_section(files: list[MeshFile]) -> Iterator[str]:
    """Write the table of meshes."""
    yield from (
        "## Meshes",
        "",
        "| file | from | triangles | |",
        "| --- | --- | ---: | --- |",
    )
    for file in sorted(files, key=lambda file: file.name):
        count = "" if file.triangles is None else str(file.triangles)
        notes = "; ".join((*file.changes, *file.findings))
        yield f"| {file.name} | {file.source} | {count} | {notes} |"
