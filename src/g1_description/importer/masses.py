"""What a robot's masses and inertias are, and what they cannot be."""

from __future__ import annotations

from lxml import etree

from g1_description.core.robot.description import Description, Inertial
from g1_description.core.robot.inertias import fault_of
from g1_description.core.robot.rigid import rigid_frames


def massless_links(description: Description) -> tuple[list[str], list[str]]:
    """Find the links without a mass, the root apart.

    Returns:
        Those without an inertial that fixed joints hold to a mass: they add none to
        it. And those that have none of their own nor any they are fixed to: their mass
        is not known, and Gazebo leaves them out.
    """
    frames = rigid_frames(description, as_lumped=True)
    with_mass = {
        frames[link.name][0]
        for link in description.links
        if not _is_bare(link.inertial)
    }
    bare = [
        link
        for link in description.links
        if _is_bare(link.inertial) and link.name != description.root
    ]
    held = [link for link in bare if frames[link.name][0] in with_mass]
    unknown = [link.name for link in bare if frames[link.name][0] not in with_mass]
    return [link.name for link in held if link.inertial is None], unknown


def _is_bare(inertial: Inertial | None) -> bool:
    """Check whether a link has no mass."""
    return inertial is None or inertial.mass == 0.0


def write_zero_masses(root: etree._Element, links: list[str]) -> None:
    """Write a mass of 0 for links."""
    for link in root.findall("link"):
        if link.get("name") not in links:
            continue
        inertial = etree.SubElement(link, "inertial")
        etree.SubElement(inertial, "mass", value="0")
        moments = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        etree.SubElement(inertial, "inertia", dict.fromkeys(moments, "0"))
        etree.indent(inertial, level=2)
        link.text = link.text or "\n    "
        before = inertial.getprevious()
        if before is not None:
            before.tail = "\n    "
        inertial.tail = "\n  "


def impossible_inertias(description: Description) -> list[str]:
    """Find inertias that no body has.

    Returns:
        A sentence for each link whose mass is zero, whose principal moments are not
        all positive, or one of them greater than the sum of the other two.
    """
    sentences = []
    for link in description.links:
        if link.inertial is None:
            continue
        fault = fault_of(link.inertial)
        if fault:
            sentences.append(f"Link {link.name}: {fault}.")
    return sentences
