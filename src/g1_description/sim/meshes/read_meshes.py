"""A program that reads meshes with assimp, as RViz does, in a child process.

A mesh that crashes assimp ends this process, not the simulator. The arguments are a
folder, the limits of processor time and time per file in seconds, and files. For the
n-th file it writes ``n.npz``, or ``n.txt`` with an error, to the folder. The first file
that takes too long kills it; its parent continues with the next.

assimp is configured as in RViz and Gazebo: the unit of a COLLADA file is applied, its
up axis is ignored.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import suppress
from itertools import repeat
from pathlib import Path
from typing import Any, Tuple
from urllib.parse import unquote

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.sim.meshes.stl import (
    HEAD,
    binary_size,
    has_direction,
    triangle_count,
    triangle_normals,
)

try:
    import resource
except ImportError:  # on Windows
    resource = None  # type: ignore[assignment]

BEGUN, LAST_WORDS = "begun", "last_words"
"""Files that it writes when it begins, and on an internal error."""

MEMORY = 4 * 2**30
"""Limit of memory in bytes."""

MAX_TRIANGLES = 3_000_000

STEPS = 0x8 | 0x20 | 0x100 | 0x8000
"""Steps of assimp: triangulate, generate normals, pre-transform vertices, sort by
primitive type."""

PROPERTIES = {
    b"IMPORT_COLLADA_IGNORE_UP_DIRECTION": 1,
    b"PP_PTV_KEEP_HIERARCHY": 1,  # each use of a geometry stays a mesh
    b"PP_SBP_REMOVE": 0x1 | 0x2,  # points and lines
}

DIFFUSE_TEXTURE = 1
SUCCESS = 0
OUT_OF_MEMORY = "std::bad_alloc"
"""End of the library's message if it is out of memory."""


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
    """The beginning of an aiScene, which has been the same, too."""

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
    """A mesh cannot be read."""


_Part = Tuple[np.ndarray, np.ndarray, Tuple[float, ...]]
"""A part with one material: corners and normals of triangles, shape (n, 3, 3), and red,
green, blue, opacity, NaN without a material."""


class _Assimp:
    """The configured library."""

    def __init__(self) -> None:
        name = ctypes.util.find_library("assimp")
        if name is None:
            raise CannotReadError("the library assimp is not installed")
        self._library: Any = ctypes.CDLL(name)
        self._library.aiCreatePropertyStore.restype = ctypes.c_void_p
        self._library.aiImportFileExWithProperties.restype = ctypes.POINTER(_Scene)
        self._library.aiGetErrorString.restype = ctypes.c_char_p
        self._properties = ctypes.c_void_p(self._library.aiCreatePropertyStore())
        for key, value in PROPERTIES.items():
            self._library.aiSetImportPropertyInteger(self._properties, key, value)

    def parts(self, path: Path) -> Iterator[_Part]:
        """Read the parts of a mesh, transformed by the nodes of the file."""
        found = self._library.aiImportFileExWithProperties(
            os.fsencode(path), STEPS, None, self._properties
        )
        if not found:
            why = self._library.aiGetErrorString().decode("utf-8", "replace")
            if why.endswith(OUT_OF_MEMORY):
                raise MemoryError
            raise CannotReadError(why.strip(" ."))
        scene = found.contents
        for pointer in scene.meshes[: scene.n_meshes]:
            mesh = pointer.contents
            indices = _triangles(mesh)
            if len(indices):
                material = ctypes.c_void_p(scene.materials[mesh.material])
                yield (
                    _vectors(mesh.vertices, mesh.n_vertices)[indices],
                    _vectors(mesh.normals, mesh.n_vertices)[indices],
                    self._color(material, path.parent),
                )
        self._library.aiReleaseImport(found)

    def _color(self, material: ctypes.c_void_p, folder: Path) -> tuple[float, ...]:
        """Return the colour of a material, or the mean of its texture."""
        name, texture = _String(), _String()
        color, opacity = (ctypes.c_float * 4)(), ctypes.c_float(1.0)
        self._library.aiGetMaterialString(
            material, b"?mat.name", 0, 0, ctypes.byref(name)
        )
        result = self._library.aiGetMaterialColor(
            material, b"$clr.diffuse", 0, 0, ctypes.byref(color)
        )
        if name.data == b"DefaultMaterial" or result != SUCCESS:
            return (np.nan,) * 4
        self._library.aiGetMaterialFloatArray(
            material, b"$mat.opacity", 0, 0, ctypes.byref(opacity), None
        )
        self._library.aiGetMaterialTexture(
            material, DIFFUSE_TEXTURE, 0, ctypes.byref(texture), *repeat(None, 6)
        )
        mean = _mean_color(folder, texture.data.decode("utf-8", "replace"))
        return (*(mean or color[:3]), opacity.value)


def _vectors(address: int | None, count: int) -> np.ndarray:
    """Copy vectors from the library, shape (count, 3)."""
    if not address or not count:
        return np.zeros((count, 3), np.float32)
    numbers = (ctypes.c_float * (3 * count)).from_address(address)
    return np.array(numbers, np.float32).reshape(-1, 3)


def _triangles(mesh: _Mesh) -> np.ndarray:
    """Copy the indices of a mesh's corners from the library, shape (n, 3)."""
    if not mesh.n_faces:
        return np.zeros((0, 3), np.uint32)
    size = _FACE.itemsize * mesh.n_faces
    faces = np.frombuffer(ctypes.string_at(mesh.faces, size), _FACE)
    faces = faces[faces["n_indices"] == 3]
    addresses = faces["indices"].tolist()
    data = b"".join(map(ctypes.string_at, addresses, repeat(12)))
    return np.frombuffer(data, np.uint32).reshape(-1, 3)


def main() -> None:
    """Read all files."""
    if resource is not None:
        with suppress(ValueError, OSError):  # macOS has no limit of memory
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    folder, limits, files = Path(sys.argv[1]), sys.argv[2:4], sys.argv[4:]
    (folder / BEGUN).touch()
    try:
        for number, file in enumerate(files):
            if hasattr(signal, "setitimer"):
                signal.setitimer(signal.ITIMER_PROF, float(limits[0]))
                signal.setitimer(signal.ITIMER_REAL, float(limits[1]))
            _read_to(folder, number, Path(file))
    except Exception as error:  # raised again; reported to the parent
        words = f"{type(error).__name__}: {error}"
        (folder / LAST_WORDS).write_text(words, encoding="utf-8")
        raise


def _read_to(folder: Path, number: int, file: Path) -> None:
    """Read a mesh, and write its contents."""
    try:
        arrays = _read(file)
    except (CannotReadError, MemoryError) as error:
        full = f"it takes more than {MEMORY // 2**30} GiB of memory"
        why_not = full if isinstance(error, MemoryError) else str(error)
        (folder / f"{number}.txt").write_text(why_not, encoding="utf-8")
        return
    # Renamed, so that an existing file is complete.
    np.savez(folder / "unfinished.npz", **arrays)
    (folder / "unfinished.npz").rename(folder / f"{number}.npz")


def _read(path: Path) -> dict[str, np.ndarray]:
    """Read a mesh: all parts' ``corners`` and ``normals``, ``counts``, ``colors``."""
    # Before the library: version 5.0 aborts on a truncated binary STL.
    _check_stl(path)
    parts = list(_Assimp().parts(path))
    if not parts:
        raise CannotReadError("it has no triangles")
    counts = [len(corners) for corners, _, _ in parts]
    if sum(counts) > MAX_TRIANGLES:
        raise CannotReadError(
            f"it has {sum(counts)} triangles; the limit is {MAX_TRIANGLES}"
        )
    corners, normals = (np.concatenate([part[n] for part in parts]) for n in (0, 1))
    with np.errstate(invalid="ignore"):
        if not (np.abs(corners) <= MAX_VALUE).all():
            raise CannotReadError(
                f"it has vertices that are not finite, or beyond {MAX_VALUE:g} m"
            )
    if not np.ptp(corners.reshape(-1, 3), axis=0).any():
        raise CannotReadError("all its vertices are at one point")
    # A zero normal is replaced by that of its triangle.
    own = triangle_normals(corners)[:, np.newaxis]
    normals = np.where(has_direction(normals)[..., np.newaxis], normals, own)
    return {
        "corners": corners,
        "normals": normals.astype(corners.dtype),
        "counts": np.array(counts),
        "colors": np.array([color for _, _, color in parts]),
    }


def _check_stl(path: Path) -> None:
    """Check that an STL is text, or its size matches its number of triangles."""
    if path.suffix.lower() != ".stl":
        return
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
            size = file.seek(0, os.SEEK_END)
    except OSError as error:
        raise CannotReadError(str(error.strerror)) from error
    needed = binary_size(head)
    # The number of triangles contains a zero byte, unlike text.
    begin = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    is_text = b"\0" not in head and (not begin or begin.startswith(b"solid"))
    if size != needed and not is_text:
        raise CannotReadError(
            'it is not text that begins with "solid" in small letters, and its '
            f"{size} bytes are not the {needed} of {triangle_count(head)} triangles"
        )


def _mean_color(folder: Path, name: str) -> tuple[float, ...] | None:
    """Return the mean colour of a picture, from 0 to 1; None if it cannot be read."""
    paths = [folder / written for written in (name, unquote(name)) if written]
    # os.path.isfile: Path.is_file() raises on names that are too long.
    picture = next(filter(os.path.isfile, paths), None)
    if picture is None:
        return None
    from PIL import Image

    try:
        with warnings.catch_warnings(), Image.open(picture) as image:
            warnings.simplefilter("error")  # on very large images
            small = image.convert("RGB").resize((1, 1), Image.Resampling.BOX)
            return tuple(value / 255.0 for value in small.getpixel((0, 0)))
    except Exception:  # the errors of Pillow depend on the format
        return None


if __name__ == "__main__":
    main()
