"""SolidShape: one collision shape of a link, as points whose convex hull holds it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.errors import ArmDescriptionError

_N_SIDES = 16
"""A cylinder is held by a prism of so many sides."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SolidShape:
    """A mesh, box, cylinder or sphere."""

    kind: Literal["mesh", "box", "cylinder", "sphere"]
    size_m: tuple[float, ...]
    """Edges of a box; radius and length of a cylinder, whose axis is z; radius of a sphere; scale of a mesh."""
    mesh: Path | None
    """Binary STL or OBJ file; None for the others."""
    link_from_shape: FloatArray
    """4x4 matrix."""

    def vertices(self) -> FloatArray:
        """Points whose convex hull holds the shape, in the link's frame [m], shape (v, 3).

        Raises:
            ArmDescriptionError: The mesh cannot be read.
        """
        points = self._points()
        if np.array_equal(self.link_from_shape, np.eye(4)):
            return points
        turned: FloatArray = points @ self.link_from_shape[:3, :3].T + self.link_from_shape[:3, 3]
        return turned

    def _points(self) -> FloatArray:
        if self.kind == "mesh":
            points = _mesh(self.mesh) if self.mesh is not None else np.empty((0, 3))
            return points if self.size_m == (1.0, 1.0, 1.0) else points * self.size_m
        if self.kind == "cylinder":
            radius, length = self.size_m
            # Sides touch the circle from outside.
            angles = 2.0 * np.pi * np.arange(_N_SIDES) / _N_SIDES
            ring = radius / math.cos(math.pi / _N_SIDES) * np.column_stack((np.cos(angles), np.sin(angles)))
            return np.concatenate([np.column_stack((ring, np.full(_N_SIDES, z))) for z in (-length / 2, length / 2)])
        half = np.array(self.size_m) / 2 if self.kind == "box" else np.full(3, self.size_m[0])
        corners: FloatArray = np.array(list(product((-1.0, 1.0), repeat=3))) * half
        return corners


def _mesh(path: Path) -> FloatArray:
    if path.suffix.lower() == ".stl":
        # Fitting needs scipy, which takes a while to load; only planners look at meshes.
        from planners.errors import PlanningError
        from planners.motion.arm.spheres import read_binary_stl

        try:
            return read_binary_stl(path)
        except PlanningError as error:
            raise ArmDescriptionError(str(error)) from error
    try:
        rows = [line.split()[1:4] for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("v ")]
        points = np.array(rows, dtype=np.float64).reshape(-1, 3)
    except (OSError, ValueError) as error:
        raise ArmDescriptionError(f"{path}: {error}; valid: a binary STL or an OBJ file") from error
    if len(points) == 0:
        raise ArmDescriptionError(f"{path}: no vertices; valid: a binary STL or an OBJ file")
    return points
