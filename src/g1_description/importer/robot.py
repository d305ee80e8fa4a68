"""A URDF with its file references, and edits of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from lxml import etree

from g1_description.files.model_files import find_folder
from g1_description.files.uris import find_file, give_names
from g1_description.files.xml import parse_xml
from g1_description.robot.description import Description
from g1_description.robot.load import ModelText
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
