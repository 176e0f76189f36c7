"""Meshes: the drawn parts of a robot's link as one coloured mesh, so that a link is one entity of the recording."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray, IntArray
from fleet.recording.errors import RecordingError
from fleet.recording.rerun_stream import palette
from fleet.robots.spec import Visual

Vectors = npt.NDArray[np.float32]
_QUADS = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
"""Corners of the sides of a box, seen from outside against the clock; corner i lies at the signs of its three bits."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Triangles with shading and colours."""

    positions: Vectors
    """Vertices [m], shape (v, 3)."""
    normals: Vectors
    """Unit normals of the vertices, shape (v, 3)."""
    triangles: npt.NDArray[np.uint32]
    """Vertices of each triangle, shape (t, 3)."""
    colours: npt.NDArray[np.uint32]
    """Colours of the vertices, 0xRRGGBBAA, shape (v,)."""


def link_mesh(visuals: Sequence[Visual]) -> Mesh:
    """Put the visuals of a link together in the link's frame; textures are left out.

    Raises:
        RecordingError: A mesh file is neither binary STL nor OBJ; names it.
    """
    positions, normals, triangles, colours = [], [], [], []
    count = 0
    for visual in visuals:
        vertices, normal, faces = _box(visual.size_m) if visual.mesh is None else _read(visual.mesh)
        pose = visual.link_from_visual
        positions.append(vertices @ pose[:3, :3].T + pose[:3, 3])
        normals.append(normal @ pose[:3, :3].T)
        triangles.append(faces + count)
        colours.append(np.full(len(vertices), palette.packed(visual.rgba), np.uint32))
        count += len(vertices)
    return Mesh(
        positions=np.concatenate(positions).astype(np.float32),
        normals=np.concatenate(normals).astype(np.float32),
        triangles=np.concatenate(triangles).astype(np.uint32),
        colours=np.concatenate(colours),
    )


_Shape = tuple[FloatArray, FloatArray, IntArray]
"""Vertices (v, 3), their normals (v, 3), triangles (t, 3)."""


def _read(path: Path) -> _Shape:
    """Read a mesh file."""
    readers = {".stl": _read_stl, ".obj": _read_obj}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(f"mesh {path}: {path.suffix} is not known; valid: {', '.join(readers)}")
    return reader(path)


def _read_stl(path: Path) -> _Shape:
    """Binary STL: 80 bytes of header, a count, then per triangle its normal, three vertices and two bytes."""
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])
    facets = np.frombuffer(path.read_bytes(), kind, offset=84)
    corners = facets["corners"].astype(np.float64)
    return _faceted(corners)


def _read_obj(path: Path) -> _Shape:
    """Wavefront OBJ: vertices, normals, and faces of corners ``v``, ``v/vt``, ``v/vt/vn`` or ``v//vn``, counted from 1.

    Numbers of all lines of a kind are read in one go: line by line, the meshes of one arm took a tenth of a short run.

    Raises:
        RecordingError: What should be numbers is not.
    """

    def numbers(words: list[str], width: int) -> FloatArray:
        found = np.array([])
        with suppress(ValueError), warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # else what follows a word is left out
            found = np.fromstring(" ".join(words), dtype=np.float64, sep=" ")
        if len(found) != width * len(words):
            raise RecordingError(f"mesh {path}: lines v, vn or f hold other things than numbers; valid: an OBJ file")
        return found.reshape(-1, width)

    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    vertices, normals = (
        numbers([" ".join(line.split(None, 4)[1:4]) for line in lines if line.startswith(kind)], 3)
        for kind in ("v ", "vn ")
    )
    rings = [line[2:].split() for line in lines if line.startswith("f ")]
    triangles = _fans(np.array([len(ring) for ring in rings], dtype=np.int64))
    words = [word for ring in rings for word in ring]
    if not len(normals) or any(word.count("/") < 2 for word in words):
        points = numbers([word.partition("/")[0] for word in words], 1)[:, 0].astype(np.int64) - 1
        return _faceted(vertices[points[triangles]])
    corners = numbers([word.replace("//", "/0/").replace("/", " ") for word in words], 3).astype(np.int64)
    points, _, shades = corners.T - 1
    _, first, faces = np.unique(points * len(normals) + shades, return_index=True, return_inverse=True)
    return vertices[points[first]], normals[shades[first]], faces[triangles]


def _fans(n_corners: IntArray) -> IntArray:
    """Cut faces, whose corners stand one after the other, into triangles about their first corners, shape (t, 3)."""
    n_triangles = np.maximum(n_corners - 2, 0)
    first = np.repeat(np.cumsum(n_corners) - n_corners, n_triangles)
    k = np.arange(len(first)) - np.repeat(np.cumsum(n_triangles) - n_triangles, n_triangles)
    return np.stack((first, first + k + 1, first + k + 2), axis=1)


def _box(size_m: tuple[float, float, float]) -> _Shape:
    signs = np.array([[(i >> axis & 1) * 2 - 1 for axis in range(3)] for i in range(8)])
    corners = signs * np.asarray(size_m) / 2
    halves = [half for a, b, c, d in _QUADS for half in ((a, b, c), (a, c, d))]
    return _faceted(corners[np.array(halves)])


def _faceted(corners: FloatArray) -> _Shape:
    """Triangles (t, 3, 3) that share no vertex, each with the normal of its plane."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return corners.reshape(-1, 3), np.repeat(normal, 3, axis=0), np.arange(3 * len(corners)).reshape(-1, 3)
