"""STL files are cleaned, and simpler shapes made of them; trimesh is the oracle."""

import io

import numpy as np
import pytest
import trimesh

from g1_description.errors import DescriptionError
from g1_description.importer.simplify import (
    ComparedSurface,
    convex_hull,
    decimated,
    decimated_hull,
    deviation,
    within,
)
from g1_description.sim.meshes.stl import clean_header, is_binary, write_stl

BALL = trimesh.creation.icosphere(3)
BINARY = BALL.export(file_type="stl")
TEXT = BALL.export(file_type="stl_ascii").encode()


def loaded(data):
    return trimesh.load(io.BytesIO(data), file_type="stl")


def test_a_clean_file_stays_as_it_is():
    assert clean_header(BINARY) == (BINARY, ())


def test_a_binary_header_does_not_begin_with_solid():
    for beginning in (b"solid left_hip", b"  SOLID x", b"solid"):
        header = beginning.ljust(80)
        data, changes = clean_header(header + BINARY[80:])
        assert changes == ('header no longer begins with "solid"',)
        assert not data.lstrip().lower().startswith(b"solid")
        assert data[80:] == BINARY[80:]
        assert data[:80].split()[1:] == beginning.split()[1:]


def test_binary_is_what_is_as_long_as_it_says():
    assert is_binary(BINARY)
    for data in (b"", BINARY[:84], BINARY[:-1], BINARY + b"\0", TEXT):
        assert not is_binary(data)


def test_written_triangles_have_unit_normals():
    written = loaded(write_stl(np.asarray(BALL.triangles)))
    np.testing.assert_allclose(written.bounds, BALL.bounds, atol=1e-6)
    record = np.frombuffer(write_stl(np.asarray(BALL.triangles)), "<f4", 3, 84)
    np.testing.assert_allclose(record, BALL.face_normals[0], atol=1e-3)


@pytest.mark.parametrize("most", [4, 50, 300])
def test_a_decimated_mesh_has_no_more_triangles_and_its_size(most):
    fewer = decimated(np.asarray(BALL.triangles), most)
    assert len(fewer) <= most
    if most > 4:
        np.testing.assert_allclose(np.ptp(fewer.reshape(-1, 3), axis=0), 2.0, rtol=0.3)


def test_where_no_edge_collapses_corners_are_joined():
    """Leaves that meet in one corner only: no two share an edge."""
    angles, heights = np.meshgrid(np.linspace(0, 6, 30), np.linspace(0, 1, 30))
    rim = [
        np.stack([np.cos(a), np.sin(a), z], axis=-1).reshape(-1, 3)
        for a, z in ((angles, heights), (angles + 0.1, heights + 0.3))
    ]
    triangles = np.stack([np.zeros_like(rim[0]), *rim], axis=1)
    fewer = decimated(triangles, 300)
    assert 0 < len(fewer) <= 300
    size = np.ptp(triangles.reshape(-1, 3), axis=0)
    np.testing.assert_allclose(np.ptp(fewer.reshape(-1, 3), axis=0), size, rtol=0.1)


def test_a_mesh_with_few_triangles_is_not_decimated():
    triangles = np.asarray(BALL.triangles)
    assert decimated(triangles, len(triangles)) is triangles


@pytest.mark.parametrize("most", [None, 60])
def test_a_hull_is_convex_and_holds_the_mesh(most):
    mesh = trimesh.creation.annulus(0.5, 1.0, 0.3)
    triangles = convex_hull(np.asarray(mesh.triangles))
    if most:
        triangles = decimated_hull(triangles, most)
    hull = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles))
    assert hull.is_convex
    assert hull.volume == pytest.approx(np.pi * 0.3, rel=0.1)
    assert most is None or len(triangles) <= most


def apart(one, other, limit=np.inf):
    surfaces = [ComparedSurface(np.asarray(m.triangles), 1.0) for m in (one, other)]
    return deviation(*surfaces, limit)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_surfaces_are_as_far_apart_as_trimesh_says(seed):
    """Its own search, triangle by triangle, from corners and random points."""
    random = np.random.RandomState(seed)
    one = trimesh.creation.box(random.uniform(0.1, 1.0, 3)).subdivide()
    other = trimesh.creation.icosphere(2, random.uniform(0.2, 0.6))
    other.apply_translation(random.uniform(-0.3, 0.3, 3))
    farthest = 0.0
    for a, b in ((one, other), (other, one)):
        points = np.concatenate([a.vertices, a.sample(1000)])
        distances = trimesh.proximity.closest_point_naive(b, points)[1]
        farthest = max(farthest, distances.max())
    measured = apart(one, other)
    assert farthest - 1e-9 <= measured * 1.03
    assert measured <= farthest * 1.03
    assert measured == pytest.approx(apart(other, one))


def test_a_part_that_is_gone_counts():
    """Each point that is left is where it was: that is one side only."""
    ball = trimesh.creation.icosphere(2, 0.1).apply_translation([1.0, 0.0, 0.0])
    box = trimesh.creation.box([0.2] * 3)
    both = trimesh.util.concatenate([box, ball])
    assert apart(both, box) == pytest.approx(1.0, abs=0.01)
    assert apart(both, both) == pytest.approx(0.0, abs=1e-9)
    assert apart(both, box, limit=0.1) > 0.1


def test_a_flat_mesh_has_no_hull():
    flat = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=float)
    with pytest.raises(DescriptionError, match="flat"):
        convex_hull(flat)


def test_a_hull_that_would_become_flat_keeps_more_triangles():
    lens = trimesh.creation.icosphere(subdivisions=2)
    lens.apply_scale([0.5, 0.5, 0.0005])
    hull = convex_hull(np.asarray(lens.triangles))
    fewer, moved = within(0.002, hull, 4, decimated_hull)
    assert 4 <= len(fewer) <= len(hull)
    assert moved <= 0.002
