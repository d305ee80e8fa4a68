"""The meshes are sound, small, and of the size that was measured."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

REPOSITORY = Path(__file__).resolve().parents[2]
MESHES = REPOSITORY / "meshes"
FILES = sorted(MESHES.rglob("*.stl"))
TABLE = yaml.safe_load((REPOSITORY / "urdf" / "g1_29dof_shapes.yaml").read_text())
ROBOTS = [ET.parse(str(file)) for file in sorted((REPOSITORY / "urdf").glob("*.urdf"))]


def name_of(file):
    return str(file.relative_to(MESHES))


def load(file):
    return trimesh.load(str(file))


@pytest.mark.parametrize("file", FILES, ids=name_of)
def test_a_mesh_is_closed_binary_and_its_normals_point_outward(file):
    """No reader takes it for text."""
    mesh = load(file)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    data = file.read_bytes()
    assert not data[:80].lstrip().lower().startswith(b"solid")
    count = int.from_bytes(data[80:84], "little")
    assert len(data) == 84 + 50 * count


def test_all_meshes_together_are_small():
    sizes = [file.stat().st_size for file in FILES]
    assert sum(sizes) < 2.5e6
    assert sum((size - 84) // 50 for size in sizes) < 50_000


def test_the_robots_use_each_mesh_and_no_other():
    used = {mesh.get("filename") for robot in ROBOTS for mesh in robot.iter("mesh")}
    assert used == {f"package://g1_description/meshes/{name_of(f)}" for f in FILES}


@pytest.mark.parametrize("name", [n for n in TABLE if "parts" in TABLE[n]])
def test_a_mesh_is_as_large_as_its_outlines(name):
    """The table's own corners are the oracle: the box that all views leave."""
    boxes = []
    for part in TABLE[name]["parts"]:
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
        for axis, others in enumerate(([1, 2], [0, 2], [0, 1])):
            points = np.concatenate([np.array(r) for r in part[f"along_{'xyz'[axis]}"]])
            low[others] = np.maximum(low[others], points.min(axis=0))
            high[others] = np.minimum(high[others], points.max(axis=0))
        boxes.append((low, high))
    wanted = np.array([np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]])
    np.testing.assert_allclose(load(MESHES / f"{name}.stl").bounds, wanted, atol=1e-6)


@pytest.mark.parametrize("name", [name for name in TABLE if name.startswith("left_")])
def test_the_right_side_is_the_mirror_image_of_the_left(name):
    left = load(MESHES / f"{name}.stl")
    right = load(MESHES / f"{name.replace('left_', 'right_')}.stl")
    mirrored = left.bounds * [1, -1, 1]
    np.testing.assert_allclose(right.bounds, np.sort(mirrored, axis=0), atol=1e-9)
    np.testing.assert_allclose(right.volume, left.volume)


@pytest.mark.parametrize(
    "file", sorted((MESHES / "collision").glob("*.stl")), ids=name_of
)
def test_what_collides_is_convex_and_inside_what_is_seen(file):
    """The hull of scipy's Qhull is the oracle."""
    mesh = load(file)
    seen = load(MESHES / file.name)
    np.testing.assert_allclose(mesh.volume, mesh.convex_hull.volume, rtol=1e-6)
    outside = mesh.vertices @ seen.convex_hull.face_normals.T - np.einsum(
        "ij,ij->i", seen.convex_hull.face_normals, seen.convex_hull.triangles[:, 0]
    )
    assert outside.max() < 1e-6
    np.testing.assert_allclose(mesh.bounds, seen.bounds, atol=1e-6)
    assert len(mesh.faces) < 200
