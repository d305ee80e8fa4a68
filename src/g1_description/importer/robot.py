"""A URDF with its file references, edits of it, and the profile of an import."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath

from lxml import etree

from g1_description.files.model_files import find_folder
from g1_description.files.uris import find_file, give_names
from g1_description.files.xml import parse_xml
from g1_description.files.yaml import YamlError, parse_yaml
from g1_description.robot.description import Description, limb_of
from g1_description.robot.load import ModelText
from g1_description.robot.profile import FILE
from g1_description.robot.urdf import make_version_1_0


@dataclass
class Reference:
    """A reference to a mesh or texture in a URDF."""

    element: etree._Element
    owner: str
    """The element around it, such as "visual of link base" or "material black"."""

    path: Path | None
    """The file; None if it does not exist."""

    is_collision: bool
    """Whether it is the mesh of a collision."""

    @property
    def name(self) -> str:
        """The name as it is written."""
        return str(self.element.get("filename", ""))

    @property
    def scale(self) -> float:
        """Largest scale of a mesh on any axis."""
        try:
            factors = [abs(float(w)) for w in self.element.get("scale", "1").split()]
        except ValueError:
            return 1.0
        return max(factors, default=1.0) or 1.0

    @property
    def is_mesh(self) -> bool:
        """Whether it is a mesh, not a texture."""
        return bool(self.element.tag == "mesh")

    def remove(self) -> None:
        """Remove the visual or collision of a mesh, or only the texture."""
        gone = self.element
        if self.is_mesh:
            gone = next(gone.iterancestors("visual", "collision"))
        gone.getparent().remove(gone)


@dataclass
class ImportedRobot:
    """A robot that is imported."""

    source: Path
    description: Description
    root: etree._Element
    references: list[Reference]
    changes: list[str] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    number: int = 1
    """Number among files of the same name."""

    @property
    def name(self) -> str:
        """Name of the file in the result."""
        stem = self.source.name
        for suffix in (".xacro", ".urdf"):
            stem = stem[: -len(suffix)] if stem.endswith(suffix) else stem
        number = f"_{self.number}" if self.number > 1 else ""
        return f"urdf/{stem}{number}.urdf"

    def text(self) -> bytes:
        """Return the edited URDF."""
        tree = self.root.getroottree()
        data = etree.tostring(tree, encoding="utf-8", xml_declaration=True)
        return bytes(data.rstrip() + b"\n")


def open_robot(model: ModelText) -> ImportedRobot:
    """Collect the file references of a URDF; comments and unknown tags are kept.

    Names that RViz requires and the file lacks are added, and reported.

    Args:
        model: The robot, whose text was checked.

    Returns:
        The robot.
    """
    root = parse_xml("robot description", model.text, keep_comments=True)
    changes = give_names(root, model.path.stem)
    newer = {
        "rpy instead of quat_xyzw": "origin[@quat_xyzw]",
        "a cylinder and two spheres instead of each capsule": "geometry/capsule",
    }
    changed = [words for words, path in newer.items() if root.xpath(f".//{path}")]
    make_version_1_0(root)
    if changed:
        changes.append(
            f"The robot became URDF 1.0, which ROS 1 reads, with {', '.join(changed)}."
        )
    description = replace(model.description, name=root.get("name"))
    folder = model.path.parent
    references = []
    for element in root.iter("mesh", "texture"):
        kind, name = _owner(element)
        if kind:
            path = find_file(element.get("filename", ""), folder, find_folder)
            owner = kind if kind == "material" else f"{kind} of link"
            references.append(
                Reference(element, f"{owner} {name}", path, kind == "collision")
            )
    findings = [f"{text[0].upper()}{text[1:]}." for text in description.unread]
    return ImportedRobot(model.path, description, root, references, changes, findings)


def _owner(element: etree._Element) -> tuple[str, str]:
    """Return kind and name of a file's owner; empty if not part of URDF."""
    above = list(element.iterancestors())
    tags = [parent.tag for parent in above]
    if tags == ["material", "robot"]:
        return "material", above[0].get("name", "")
    if tags[-2:] == ["link", "robot"] and tags[-3:-2] in (["visual"], ["collision"]):
        return tags[-3], above[-2].get("name", "")
    return "", ""


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
