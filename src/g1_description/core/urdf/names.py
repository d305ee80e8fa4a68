"""Names that RViz wants and a file leaves out.

RViz and check_urdf read URDF with urdfdom, which refuses a robot without a name, and
leaves out a visual whose material has none.
"""

from __future__ import annotations

from itertools import count

from lxml import etree


def give_names(root: etree._Element, name: str) -> list[str]:
    """Give a robot and the materials of its visuals the names that they lack.

    Args:
        root: The robot element, which is changed.
        name: For the robot.

    Returns:
        A sentence for the robot, and one for all materials, that got a name.
    """
    sentences = []
    if root.get("name") is None:
        root.set("name", name)
        sentences.append(f"The robot, which had no name, is named {name}, as its file.")
    taken = {material.get("name") for material in root.iter("material")}
    free = (f"material_{number}" for number in count(1))
    given = []
    for link in root.findall("link"):
        for material in link.findall("visual/material"):
            if material.get("name") is None:
                new = next(word for word in free if word not in taken)
                material.set("name", new)
                given.append(f"{new} (link {link.get('name')})")
    if given:
        sentences.append(f"Materials that had no name are named {', '.join(given)}.")
    return sentences
