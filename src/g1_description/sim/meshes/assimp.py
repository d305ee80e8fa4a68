"""The Open Asset Import Library, which RViz reads meshes with, through its C interface.

It is set to read as RViz and Gazebo do: a COLLADA file's unit counts, its up axis
does not. What a hostile file does to it ends the process, so ``read_meshes`` runs
it in one of its own.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import numpy as np

TRIANGULATE, GEN_NORMALS, PRE_TRANSFORM = 0x8, 0x20, 0x100
SORT_BY_TYPE, FIND_INVALID_DATA = 0x8000, 0x20000
STEPS = TRIANGULATE | GEN_NORMALS | PRE_TRANSFORM | SORT_BY_TYPE | FIND_INVALID_DATA

PROPERTIES = {
    b"IMPORT_COLLADA_IGNORE_UP_DIRECTION": 1,
    b"PP_PTV_KEEP_HIERARCHY": 1,  # each use of a geometry stays a mesh
    b"PP_SBP_REMOVE": 0x1 | 0x2,  # points and lines
}

DIFFUSE_TEXTURE = 1
SUCCESS = 0
OUT_OF_MEMORY = "std::bad_alloc"
"""What the library says last where memory is at an end."""


class _String(ctypes.Structure):
    """An aiString.

    Its length has 32 bits since version 5.0.0, and had those of a size_t before: so
    says types.h of 5.0.1, which Ubuntu 20.04 has. The tests ran with that and with
    5.2.5 of Debian 12.
    """

    _fields_ = (("length", ctypes.c_uint32), ("data", ctypes.c_char * 1024))


class _Mesh(ctypes.Structure):
    """The beginning of an aiMesh, which has been the same since version 3."""

    _fields_ = (
        ("primitive_types", ctypes.c_uint),
        ("n_vertices", ctypes.c_uint),
        ("n_faces", ctypes.c_uint),
        ("vertices", ctypes.c_void_p),
        ("normals", ctypes.c_void_p),
        ("tangents", ctypes.c_void_p),
        ("bitangents", ctypes.c_void_p),
        ("colors", ctypes.c_void_p * 8),
        ("texture_coordinates", ctypes.c_void_p * 8),
        ("n_uv_components", ctypes.c_uint * 8),
        ("faces", ctypes.c_void_p),
        ("n_bones", ctypes.c_uint),
        ("bones", ctypes.c_void_p),
        ("material", ctypes.c_uint),
    )


class _Scene(ctypes.Structure):
    """The beginning of an aiScene, likewise."""

    _fields_ = (
        ("flags", ctypes.c_uint),
        ("root_node", ctypes.c_void_p),
        ("n_meshes", ctypes.c_uint),
        ("meshes", ctypes.POINTER(ctypes.POINTER(_Mesh))),
        ("n_materials", ctypes.c_uint),
        ("materials", ctypes.POINTER(ctypes.c_void_p)),
    )


_FACE = np.dtype([("n_indices", np.uint32), ("indices", np.uintp)], align=True)


class CannotReadError(Exception):
    """A mesh cannot be read; the text says why."""


@dataclass(frozen=True)
class RawPart:
    """A part of a mesh, of one material."""

    corners: np.ndarray
    """Of its triangles, in [m], shape (n, 3, 3)."""

    normals: np.ndarray
    """At the corners, shape (n, 3, 3)."""

    color: tuple[float, ...] | None
    """Red, green, blue, opacity from 0 to 1; None where the file has no material."""

    texture: str
    """Name of the picture that it is covered with, as written in the file."""


class Assimp:
    """The library, ready to read."""

    def __init__(self) -> None:
        """Load it.

        Raises:
            CannotReadError: If it is not installed.
        """
        name = ctypes.util.find_library("assimp")
        if name is None:
            raise CannotReadError("the library assimp is not installed")
        self._library = ctypes.CDLL(name)
        self._library.aiCreatePropertyStore.restype = ctypes.c_void_p
        self._library.aiImportFileExWithProperties.restype = ctypes.POINTER(_Scene)
        self._library.aiGetErrorString.restype = ctypes.c_char_p
        self._properties = ctypes.c_void_p(self._library.aiCreatePropertyStore())
        for key, value in PROPERTIES.items():
            self._library.aiSetImportPropertyInteger(self._properties, key, value)

    def read(self, path: Path, steps: int = STEPS) -> list[RawPart]:
        """Read a mesh.

        Args:
            path: Its file.
            steps: What the library does with it.

        Returns:
            Its parts, placed as the file's nodes place them.

        Raises:
            CannotReadError: If it cannot be read.
            MemoryError: If it takes too much memory.
        """
        found = self._library.aiImportFileExWithProperties(
            os.fsencode(path), steps, None, self._properties
        )
        if not found:
            why = self._library.aiGetErrorString().decode("utf-8", "replace")
            if why.endswith(OUT_OF_MEMORY):
                raise MemoryError
            raise CannotReadError(why.strip(" ."))
        scene = found.contents
        parts = []
        for pointer in scene.meshes[: scene.n_meshes]:
            mesh = pointer.contents
            indices = _triangles(mesh)
            material = ctypes.c_void_p(scene.materials[mesh.material])
            parts.append(
                RawPart(
                    _vectors(mesh.vertices, mesh.n_vertices)[indices],
                    _vectors(mesh.normals, mesh.n_vertices)[indices],
                    self._color(material),
                    self._texture(material),
                )
            )
        self._library.aiReleaseImport(found)
        return parts

    def _color(self, material: ctypes.c_void_p) -> tuple[float, ...] | None:
        """Give the colour of a material; None for the library's own one."""
        name = _String()
        self._library.aiGetMaterialString(
            material, b"?mat.name", 0, 0, ctypes.byref(name)
        )
        color, opacity = (ctypes.c_float * 4)(), ctypes.c_float(1.0)
        result = self._library.aiGetMaterialColor(
            material, b"$clr.diffuse", 0, 0, ctypes.byref(color)
        )
        if name.data == b"DefaultMaterial" or result != SUCCESS:
            return None
        self._library.aiGetMaterialFloatArray(
            material, b"$mat.opacity", 0, 0, ctypes.byref(opacity), None
        )
        return (*color[:3], opacity.value)

    def _texture(self, material: ctypes.c_void_p) -> str:
        """Give the name of a material's picture; empty where it has none."""
        name = _String()
        self._library.aiGetMaterialTexture(
            material, DIFFUSE_TEXTURE, 0, ctypes.byref(name), *repeat(None, 6)
        )
        return name.data.decode("utf-8", "replace")


def _vectors(address: int | None, count: int) -> np.ndarray:
    """Take vectors over from the library, shape (count, 3)."""
    if not address or not count:
        return np.zeros((count, 3), np.float32)
    numbers = (ctypes.c_float * (3 * count)).from_address(address)
    return np.array(numbers, np.float32).reshape(-1, 3)


def _triangles(mesh: _Mesh) -> np.ndarray:
    """Take the indices of a mesh's corners over from the library, shape (n, 3)."""
    if not mesh.n_faces:
        return np.zeros((0, 3), np.uint32)
    size = _FACE.itemsize * mesh.n_faces
    faces = np.frombuffer(ctypes.string_at(mesh.faces, size), _FACE)
    faces = faces[faces["n_indices"] == 3]
    addresses = faces["indices"].tolist()
    data = b"".join(map(ctypes.string_at, addresses, repeat(12)))
    return np.frombuffer(data, np.uint32).reshape(-1, 3)
