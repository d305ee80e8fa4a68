"""Engines that find the distance of two convex shapes, each with the same work."""

import numpy as np
from scipy.spatial import ConvexHull

from g1_description.collisions.distances import ClosestPoints

REACH = 5e-4  # [m] what is farther apart need not be measured
POINT = 1e-9  # [m] radius of the sphere that stands for a point


def triangles(points):
    """Triangulate a convex hull, anticlockwise seen from outside, shape (n, 3)."""
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = (normals * hull.equations[:, :3]).sum(axis=1) < 0.0
    return np.where(inwards[:, np.newaxis], hull.simplices[:, ::-1], hull.simplices)


class PyBullet:
    """What the checks use."""

    name = "PyBullet"

    def __init__(self, shapes):
        """Create the shapes."""
        self._closest = ClosestPoints(shapes)

    def distances(self, placed):
        """Measure pairs, in [m], NaN where they are far apart."""
        return self._closest.find(placed, REACH).distance


class Library:
    """A library with shapes and transforms of its own."""

    def __init__(self, shapes):
        """Create the shapes; those of spheres are points in the link frame's axes."""
        self.radius = [shape.radius for shape in shapes]
        self.center = np.array(
            [shape.points[0] if shape.radius else np.zeros(3) for shape in shapes]
        )
        self.forms = [
            self.sphere(POINT)
            if shape.radius
            else self.convex(shape.points, triangles(shape.points))
            for shape in shapes
        ]

    def distances(self, placed):
        """Measure pairs, in [m]."""
        center_b = (placed.axes @ self.center[placed.b][:, :, np.newaxis])[..., 0]
        origin = placed.origin + center_b - self.center[placed.a]
        pairs = zip(placed.a.tolist(), placed.b.tolist(), placed.axes, origin)
        measure, radius = self.measure, self.radius
        return np.array(
            [measure(*pair) - radius[pair[0]] - radius[pair[1]] for pair in pairs]
        )


class HppFcl(Library):
    """hpp-fcl, which Pinocchio brings."""

    name = "hpp-fcl"

    def __init__(self, shapes):
        """Create the shapes."""
        import hppfcl

        self.fcl = hppfcl
        super().__init__(shapes)
        self._request = hppfcl.DistanceRequest()
        self._result = hppfcl.DistanceResult()
        self._still = hppfcl.Transform3f()

    def sphere(self, radius):
        """Create a sphere."""
        return self.fcl.Sphere(radius)

    def convex(self, points, faces):
        """Create a hull."""
        vertices, triples = self.fcl.StdVec_Vec3f(), self.fcl.StdVec_Triangle()
        for point in points:
            vertices.append(point)
        for face in faces.tolist():
            triples.append(self.fcl.Triangle(*face))
        return self.fcl.Convex(vertices, triples)

    def measure(self, a, b, axes, origin):
        """Measure a pair."""
        place = self.fcl.Transform3f(axes, origin)
        self._result.clear()
        return self.fcl.distance(
            self.forms[a],
            self._still,
            self.forms[b],
            place,
            self._request,
            self._result,
        )


class PythonFcl(Library):
    """python-fcl."""

    name = "python-fcl"

    def __init__(self, shapes):
        """Create the shapes."""
        import fcl

        self.fcl = fcl
        super().__init__(shapes)
        self._objects = [
            [fcl.CollisionObject(form) for form in self.forms] for _ in range(2)
        ]
        self._request = fcl.DistanceRequest(
            enable_nearest_points=True, enable_signed_distance=True
        )

    def sphere(self, radius):
        """Create a sphere."""
        return self.fcl.Sphere(radius)

    def convex(self, points, faces):
        """Create a hull."""
        rows = np.insert(faces, 0, 3, axis=1).ravel()
        return self.fcl.Convex(points, len(faces), rows)

    def measure(self, a, b, axes, origin):
        """Measure a pair."""
        still, moved = self._objects[0][a], self._objects[1][b]
        moved.setTransform(self.fcl.Transform(axes, origin))
        result = self.fcl.DistanceResult()
        return self.fcl.distance(still, moved, self._request, result)


ENGINES = (PyBullet, HppFcl, PythonFcl)
