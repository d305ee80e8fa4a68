"""Make all meshes of the table. Called by tools/build_meshes."""

import sys
from pathlib import Path

import yaml

from .body import body, mirrored
from .hull import hull

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "urdf" / "g1_29dof_shapes.yaml"
MESHES = ROOT / "meshes"


def meshes(name, shape):
    """Make the meshes of a link, and of its mirror image.

    Args:
        name: The link.
        shape: What the table tells of it.

    Returns:
        Meshes by their files below ``meshes``.
    """
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
    table = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    triangles = size = 0
    for number, (name, shape) in enumerate(table.items(), 1):
        print(f"tools/build_meshes: {number} of {len(table)}, {name}", flush=True)
        for file, mesh in meshes(name, shape).items():
            size += write(mesh, MESHES / file)
            triangles += len(mesh.faces)
    print(f"tools/build_meshes: {triangles} triangles, {size / 1e6:.2f} MB in meshes/")


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("tools/build_meshes: interrupted")
