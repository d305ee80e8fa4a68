"""The profile that an import begins, for its user to complete."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import PurePath

from g1_description.files.yaml import YamlError, parse_yaml
from g1_description.importer.robot import ImportedRobot
from g1_description.robot.description import Description, limb_of
from g1_description.robot.profile import FILE

ROLES = {
    "head": ("head",),
    "left_foot": ("left leg",),
    "right_foot": ("right leg",),
    "left_hand": ("left hand", "left arm"),
    "right_hand": ("right hand", "right arm"),
}
"""Roles of links, and the limbs at whose ends they are."""

POSES = """\
# Named poses: joint -> position in rad or m, inside the limits of the URDF; others are
# at 0. `about` is a description, not a joint.

zero:
  about: all joints at 0
"""


def first_profile(robot: ImportedRobot) -> dict[str, bytes]:
    """Write the files of a profile, as far as the robot is known.

    A robot that has a profile gets one that is like it.

    Returns:
        Contents by file name; ``model`` is the robot's file in the same folder.
    """
    name = str(robot.root.get("name") or PurePath(robot.name).stem)
    lines = [
        f"# The profile of {name}; docs/robots.md explains the keys.",
        "",
        f"names: [{_scalar(name)}]",
        f"model: {_scalar(robot.name)}",
    ]
    known = robot.description.profile.name
    if known:
        lines.insert(2, f"like: {_scalar(known)}")
        return {FILE: _text(lines)}
    lines += [
        "standing_pose: zero  # a pose of poses.yaml",
        "",
        "# Guessed by names of joints: correct them, and remove what the robot lacks.",
        "# The z axes of the feet are to be normal to their soles.",
        "links:",
    ]
    guesses = guessed_links(robot.description)
    for role in ROLES:
        link = f" {_scalar(guesses[role])}" if role in guesses else ""
        lines.append(f"  {role}:{link}")
    lines += [
        "",
        "# Further files of this folder, all of them optional:",
        "# motors.yaml: stronger or softer motors than those of the URDF",
        "# collisions.yaml: pairs of links that may touch; to write it:",
        "#   rosrun g1_description collision_pairs FOLDER -o FOLDER/collisions.yaml",
    ]
    return {FILE: _text(lines), "poses.yaml": POSES.encode()}


def guessed_links(description: Description) -> dict[str, str]:
    """Guess feet, hands and head: the links at the ends of limbs, by role."""
    ends = {limb_of(joint.name): joint.child for joint in description.movable_joints}
    found = {}
    for role, limbs in ROLES.items():
        link = next((ends[limb] for limb in limbs if limb in ends), None)
        if link is not None:
            found[role] = link
    return found


def _scalar(name: str) -> str:
    """Write a name in YAML, in quotation marks where it needs them."""
    with suppress(YamlError):
        if parse_yaml(name.encode()) == name and not {*name} & {*",[]{}"}:
            return name
    return json.dumps(name)


def _text(lines: list[str]) -> bytes:
    """Join the lines of a file."""
    return ("\n".join(lines) + "\n").encode("utf-8")
