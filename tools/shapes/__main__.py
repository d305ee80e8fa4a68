"""Make all meshes and variants of the tables. Called by tools/build_meshes."""

import sys
from pathlib import Path

import trimesh
import yaml

from .body import body, mirrored
from .hull import hull
from .variants import variant

ROOT = Path(__file__).resolve().parents[2]
URDF = ROOT / "urdf"
TABLE = URDF / "g1_29dof_shapes.yaml"
MESHES = ROOT / "meshes"


def meshes(name, shape, known):
    """Make the meshes of a link, and of its mirror image.

    Args:
        name: The link.
        shape: What the table tells of it.
        known: Meshes that were made before, by their files.

    Returns:
        Meshes by their files below ``meshes``.
    """
    if "joined" in shape:
        parts = [(known[f"{part}.stl"], at) for part, at in shape["joined"].items()]
        moved = [mesh.copy().apply_translation(at) for mesh, at in parts]
        sides = {name: trimesh.util.concatenate(moved)}
    else:
        sides = {name: body(shape)}
    if name.startswith("left_"):
        sides[name.replace("left_", "right_")] = mirrored(sides[name])
    made = {f"{link}.stl": mesh for link, mesh in sides.items()}
    if shape.get("collision") == "hull":
        hulls = {f"collision/{link}.stl": hull(mesh) for link, mesh in sides.items()}
        made.update(hulls)
    return made


def write(mesh, file):
    """Write a binary STL file, with a header that no reader takes for text."""
    file.parent.mkdir(parents=True, exist_ok=True)
    data = mesh.export(file_type="stl")
    header = f"g1_description {file.name}, metres".encode().ljust(80)
    file.write_bytes(header + data[80:])
    return len(data)


def main():
    """Make them all, and count."""
    base = (URDF / "g1_29dof.urdf").read_text(encoding="utf-8")
    variants = yaml.safe_load((URDF / "g1_variants.yaml").read_text(encoding="utf-8"))
    for name, changes in variants.items():
        text = variant(base, name, changes)
        (URDF / f"{name}.urdf").write_text(text, encoding="utf-8")
    table = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    triangles = size = 0
    known = {}
    for number, (name, shape) in enumerate(table.items(), 1):
        print(f"tools/build_meshes: {number} of {len(table)}, {name}", flush=True)
        made = meshes(name, shape, known)
        known.update(made)
        for file, mesh in made.items():
            size += write(mesh, MESHES / file)
            triangles += len(mesh.faces)
    print(f"tools/build_meshes: {triangles} triangles, {size / 1e6:.2f} MB in meshes/")


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("tools/build_meshes: interrupted")
