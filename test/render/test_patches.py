"""Triangles of links, as a browser is given them."""

from __future__ import annotations

import dae
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from g1_description.render.patches import GREY, link_patches
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.meshes.stl import AROUND

BOX = '<box size="0.2 0.3 0.5"/>'
BALL = '<sphere radius="0.4"/>'
PILL = '<capsule radius="0.2" length="0.7"/>'
ROD = '<cylinder radius="0.1" length="0.7"/>'
ROUND = np.sin(2 * np.pi / AROUND) * AROUND / (2 * np.pi)
"""Area of the polygon that stands for a circle, as a share of the circle's."""
RED, BLUE = (0.9, 0.1, 0.0, 1.0), (0.0, 0.1, 0.9, 0.5)


def part(geometry, xyz="0 0 0", rpy="0 0 0", color=None, kind="visual"):
    look = ""
    if color is not None:
        numbers = " ".join(map(str, color))
        look = f'<material name="m{numbers}"><color rgba="{numbers}"/></material>'
    return (
        f'<{kind}><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry>'
        f"{look}</{kind}>"
    )


def patches(*parts, solid=False):
    text = f'<robot name="r"><link name="a">{"".join(parts)}</link></robot>'
    found, left_out = link_patches(parse_urdf(text), solid)
    return found.get("a", []), left_out


def surface(patch):
    """Give a patch as trimesh has it, as it came."""
    return trimesh.Trimesh(patch.vertices, patch.faces, process=False)


def mesh_text(path, scale=(1, 1, 1)):
    scale = " ".join(map(str, scale))
    return f'<mesh filename="file://{path}" scale="{scale}"/>'


@pytest.fixture(scope="module")
def wedge(tmp_path_factory):
    """Give a solid without symmetry: its trimesh, and its files by kind."""
    points = [(0, 0, 0), (0.4, 0, 0), (0, 0.3, 0), (0.1, 0.1, 0.2), (0.3, 0.2, 0.5)]
    solid = trimesh.convex.convex_hull(np.array(points, dtype=float))
    folder = tmp_path_factory.mktemp("meshes")
    paths = {kind: folder / f"wedge.{kind}" for kind in ("stl", "obj", "dae")}
    solid.export(paths["stl"])
    solid.export(paths["obj"])
    box, green = dae.box("b", (0.1, 0.2, 0.3), "g"), ("g", "0 0.8 0 1")
    scene = dae.collada([box], [dae.node(dae.use("b", "g"))], colors=[green])
    paths["dae"].write_text(scene)
    return solid, paths


@pytest.mark.parametrize(
    ("geometry", "wanted", "tolerance"),
    [
        (BOX, trimesh.creation.box((0.2, 0.3, 0.5)), 1e-6),
        (BALL, trimesh.creation.icosphere(4, 0.4), 0.01),
        (PILL, trimesh.creation.capsule(0.7, 0.2, count=[256, 256]), 0.01),
        (ROD, trimesh.creation.cylinder(0.1, 0.7, sections=256), 1.1 * (1 - ROUND)),
    ],
)
def test_a_shape_has_its_size_and_faces_outwards(geometry, wanted, tolerance):
    ((patch,), left_out) = patches(part(geometry))
    found = surface(patch)
    assert not left_out
    outwards = (found.triangles_cross * found.triangles_center).sum(axis=1)
    assert (outwards > -1e-9).all(), "faces are seen from outside"
    assert found.volume == pytest.approx(wanted.volume, rel=tolerance)
    assert found.area == pytest.approx(wanted.area, rel=tolerance)
    assert found.bounds == pytest.approx(wanted.bounds, abs=tolerance)


@given(st.tuples(*[st.floats(-1, 1)] * 3), st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_shape_is_where_its_origin_says(place, rpy):
    numbers = (" ".join(f"{x:.17g}" for x in vector) for vector in (place, rpy))
    ((patch,), _) = patches(part(BOX, *numbers))
    corners = trimesh.creation.box((0.2, 0.3, 0.5)).vertices
    wanted = Rotation.from_euler("xyz", rpy).apply(corners) + place
    apart = cdist(patch.vertices, wanted)
    assert apart.min(axis=0).max() < 1e-6
    assert apart.min(axis=1).max() < 1e-6


@pytest.mark.parametrize(
    ("kind", "scale"),
    [
        ("stl", (1, -1, 1)),
        ("stl", (-2, -1, 1)),
        ("obj", (-1, -0.5, -3)),
        ("obj", (1e-3, 1e-3, 1e-3)),
    ],
)
def test_a_mesh_is_scaled_and_faces_outwards_also_in_a_mirror(wedge, kind, scale):
    solid, paths = wedge
    ((patch,), left_out) = patches(part(mesh_text(paths[kind], scale)))
    wanted = solid.copy()
    wanted.apply_transform(np.diag([*scale, 1.0]))
    found = surface(patch)
    size = np.abs(wanted.bounds).max()
    assert not left_out
    assert found.is_watertight and found.is_winding_consistent
    assert found.volume > 0, "faces are seen from outside"
    assert found.volume == pytest.approx(abs(wanted.volume), rel=1e-4)
    assert found.bounds == pytest.approx(wanted.bounds, abs=1e-5 * size)


def test_triangles_of_a_colour_are_one_patch(wedge):
    _, paths = wedge
    found, _ = patches(
        part(BOX, color=RED),
        part(ROD, xyz="1 0 0", color=BLUE),
        part(mesh_text(paths["stl"]), xyz="2 0 0", color=RED),
        part(BALL, xyz="3 0 0"),
    )
    places = {patch.color: patch.vertices[:, 0].max() for patch in found}
    assert places == pytest.approx({RED: 2.4, BLUE: 1.1, GREY: 3.4})


def test_colours_of_a_mesh_count_more_than_that_of_the_link(wedge):
    _, paths = wedge
    ((patch,), _) = patches(part(mesh_text(paths["dae"]), color=BLUE))
    assert patch.color == pytest.approx((0.0, 0.8, 0.0, 1.0), abs=0.01)


def test_collision_shapes_are_those_of_collisions():
    shapes = part(BOX), part(BALL, kind="collision")
    (seen,), (solid,) = patches(*shapes)[0], patches(*shapes, solid=True)[0]
    assert np.ptp(seen.vertices, axis=0) == pytest.approx((0.2, 0.3, 0.5))
    assert np.ptp(solid.vertices, axis=0) == pytest.approx((0.8, 0.8, 0.8), rel=0.01)


def test_what_cannot_be_read_is_told_and_the_rest_is_shown(tmp_path):
    broken = tmp_path / "broken.stl"
    broken.write_bytes(b"solid\n")
    (patch,), left_out = patches(
        part(mesh_text(broken)), part(mesh_text(tmp_path / "none.stl")), part(BOX)
    )
    assert len(patch.faces) == 12
    assert len(left_out) == 2
    assert str(broken) in " ".join(left_out)


def test_links_without_shapes_have_no_patch():
    found, left_out = link_patches(
        parse_urdf('<robot name="r"><link name="a"/></robot>')
    )
    assert (found, left_out) == ({}, ())


def test_corners_are_sent_once():
    ((patch,), _) = patches(part(BOX))
    assert (patch.vertices.shape, patch.faces.shape) == ((8, 3), (12, 3))
    assert (patch.vertices.dtype, patch.faces.dtype) == (np.float32, np.uint32)
