"""Make the URDFs of other G1s, from that of g1_29dof and a table of differences."""

import re


def variant(base, name, table):
    """Make the URDF of another G1.

    Args:
        base: The URDF of g1_29dof.
        name: The robot.
        table: Its entry in urdf/g1_variants.yaml.

    Returns:
        Its URDF.

    Raises:
        ValueError: If the base lacks a link, joint or attribute of the table.
    """
    about = f"{table['about']} Made by tools/build_meshes from\n  g1_29dof.urdf. "
    text = base.replace('<robot name="g1_29dof">', f'<robot name="{name}">')
    text = text.replace("Unitree G1, 29 degrees of freedom. ", about)
    text = re.sub(r", motors \d+ to \d+,?", "", text)
    for part, changes in table.items():
        if part == "about":
            continue
        block = rf'  <(link|joint) name="{part}"[^>]*>.*?</\1>\n\s*?(?=\n  <|</robot>)'
        found = re.search(block, text, re.S)
        if not found:
            raise ValueError(f"there is no {part}")
        new = changed(found[0], changes) if changes else ""
        text = text.replace(found[0], new)
    return re.sub(r"\n{3,}", "\n\n", text).replace("\n\n</robot>", "\n</robot>")


def changed(block, changes):
    """Change attributes of a link or joint."""
    place = ""
    for key, value in changes.items():
        tag, attribute = r"\w+", key
        if key == "rename":
            tag, attribute = "link|joint", "name"
        elif key in ("parent", "child"):
            tag, attribute = key, "link"
        if key == "mesh":
            block = re.sub(r"\w+(?=\.stl)", value, block)
        elif key == "shapes":
            place = f'<origin xyz="{value}" rpy="0 0 0"/>\n      '
        else:
            old = rf'(<(?:{tag})\s[^>]*\b{attribute}=")[^"]*'
            block, count = re.subn(old, rf"\g<1>{value}", block, count=1)
            if not count:
                raise ValueError(f"there is no {key} in\n{block}")
    if changes.get("type") == "fixed":
        block = re.sub(r"    <(axis|limit) .*\n", "", block)
    return block.replace("<geometry>", f"{place}<geometry>")
