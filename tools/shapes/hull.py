"""Convex shapes for collisions."""

import numpy as np
import trimesh

DIRECTIONS = 90


def hull(mesh):
    """Make a convex shape of few corners: those of a mesh that reach furthest.

    Args:
        mesh: A trimesh.Trimesh.

    Returns:
        The hull of the vertices that reach furthest along each axis and in directions
        spread evenly, a trimesh.Trimesh: inside the mesh's own hull, and as large
        along the axes.
    """
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    directions = np.concatenate([axes, spread(DIRECTIONS)])
    furthest = np.unique(np.argmax(mesh.vertices @ directions.T, axis=0))
    return trimesh.PointCloud(mesh.vertices[furthest]).convex_hull


def spread(count):
    """Spread directions evenly over a sphere, on a Fibonacci spiral.

    Args:
        count: How many.

    Returns:
        Unit vectors, shape (count, 3).
    """
    numbers = np.arange(count) + 0.5
    height = 1.0 - 2.0 * numbers / count
    angle = np.pi * (1.0 + 5.0**0.5) * numbers
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
