"""The arm as the motion planners see it: joints, limits and the spheres that cover its links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.array_cache import Arrays, cached_arrays
from planners.motion.arm.hulls import Hulls, convex_hulls
from planners.motion.arm.kinematics import joint_rows
from planners.motion.arm.spheres import fit_spheres_cached, link_self_pairs
from planners.motion.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmModel:
    """Kinematics and collision spheres of one serial arm, in its base frame."""

    base_from_joint: FloatArray
    """Fixed transform before each joint's rotation about its own z, shape (n, 4, 4)."""
    lower: FloatArray
    """Lower joint limits [rad], shape (n,)."""
    upper: FloatArray
    """Upper joint limits [rad], shape (n,)."""
    sphere_centre: FloatArray
    """Sphere centres in their link frames [m], shape (k, 3)."""
    sphere_radius: FloatArray
    """Sphere radii [m], shape (k,)."""
    sphere_frame: IntArray
    """Link frame of each sphere, 0 (base) to n, shape (k,)."""
    self_pairs: IntArray
    """Indices of spheres tested against each other, lower frame first, shape (p, 2)."""
    tool_length: float
    """From the last link frame to the tool tip along +z [m]."""
    sphere_part: IntArray | None = None
    """Rigid part of each sphere, shape (k,): its frame, or n+1 for the tool; None if there is none."""
    hulls: Hulls | None = None
    """Convex hulls of the rigid parts 0 to n+1 in their link frames; None if only spheres are known."""

    def __post_init__(self) -> None:
        n = len(joint_rows(self.base_from_joint))
        for name in ("lower", "upper", "sphere_centre", "sphere_radius", "sphere_frame", "self_pairs"):
            checks.is_array(f"ArmModel.{name}", getattr(self, name))
        for name in ("lower", "upper"):
            if getattr(self, name).shape != (n,):
                raise PlanningError(f"ArmModel.{name}: shape {getattr(self, name).shape}; valid: ({n},)")
        if not np.all(self.lower < self.upper):
            joint = int(np.argmin(self.lower < self.upper))
            raise PlanningError(
                f"ArmModel: joint {joint} from {self.lower[joint]} to {self.upper[joint]}; valid: lower < upper"
            )
        k = len(self.sphere_radius)
        checks.spheres("ArmModel: spheres", (self.sphere_centre, self.sphere_radius))
        checks.positive("ArmModel.tool_length", abs(self.tool_length), zero=True)
        for name in ("sphere_frame", "self_pairs", "sphere_part"):
            indices = getattr(self, name)
            if indices is not None and indices.dtype.kind not in "iu":
                raise PlanningError(f"ArmModel.{name}: numbers of kind {indices.dtype}; valid: integers")
        part = self.sphere_part
        if part is not None and (part.shape != (k,) or not np.array_equal(np.minimum(part, n), self.sphere_frame)):
            raise PlanningError(f"ArmModel.sphere_part: {part}; valid: the frame of each sphere, or {n + 1} for a tool")
        if self.sphere_centre.shape != (k, 3) or self.sphere_frame.shape != (k,):
            raise PlanningError(
                f"ArmModel: sphere arrays disagree: centre {self.sphere_centre.shape}, radius ({k},), "
                f"frame {self.sphere_frame.shape}; valid: (k, 3), (k,), (k,)"
            )
        if k and (self.sphere_frame.min() < 0 or self.sphere_frame.max() > n):
            raise PlanningError(f"ArmModel.sphere_frame: {self.sphere_frame.tolist()}; valid: 0 to {n}")
        if self.self_pairs.ndim != 2 or self.self_pairs.shape[1] != 2:
            raise PlanningError(f"ArmModel.self_pairs: shape {self.self_pairs.shape}; valid: (p, 2)")
        if self.self_pairs.size and (self.self_pairs.min() < 0 or self.self_pairs.max() >= k):
            raise PlanningError(f"ArmModel.self_pairs: {self.self_pairs.tolist()}; valid: spheres 0 to {k - 1}")

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.lower)

    def within_limits(self, q: npt.ArrayLike) -> BoolArray:
        """Whether configurations (..., n) respect the joint limits; shape (...)."""
        angles = np.asarray(q, dtype=np.float64)
        inside: BoolArray = np.all((angles >= self.lower) & (angles <= self.upper), axis=-1)
        return inside


def build_arm_model(
    *,
    base_from_joint: npt.ArrayLike,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    link_vertices: Sequence[npt.ArrayLike],
    spheres_per_link: Sequence[int],
    tool_length: float,
    tool_centre: npt.ArrayLike = (),
    tool_radius: npt.ArrayLike = (),
    tool_vertices: npt.ArrayLike = (),
    cache_dir: Path | None = None,
    seed: int = 0,
) -> ArmModel:
    """Fit spheres to an arm's link meshes and choose the self-collision pairs.

    The tool counts as one more rigid part on the last frame, with pairs of its own.

    Args:
        base_from_joint: Fixed transform before each joint, shape (n, 4, 4).
        lower: Lower joint limits [rad], shape (n,).
        upper: Upper joint limits [rad], shape (n,).
        link_vertices: Mesh vertices [m] of links 0 to n in their link frames, each (v, 3).
        spheres_per_link: Number of spheres of each link, n+1 values.
        tool_length: From the last link frame to the tool tip along +z [m].
        tool_centre: Centres of the tool's spheres in the last link frame [m], shape (t, 3); may be empty.
        tool_radius: Radii of the tool's spheres [m], shape (t,).
        tool_vertices: Points whose convex hull holds the tool [m], shape (v, 3); without any it is its spheres.
        cache_dir: Directory for fitted spheres and hulls; None fits anew.
        seed: Seed of the sphere fit and of the sampled self-collision statistics.

    Returns:
        The arm model.

    Raises:
        PlanningError: Shapes do not fit, or a mesh has no volume.
    """
    n = len(joint_rows(base_from_joint))
    if len(link_vertices) != n + 1 or len(spheres_per_link) != n + 1:
        raise PlanningError(
            f"build_arm_model: {len(link_vertices)} meshes and {len(spheres_per_link)} sphere counts, "
            f"valid: {n + 1} of each (links 0 to {n})"
        )
    fitted = [
        fit_spheres_cached(vertices, k, seed, cache_dir)
        for vertices, k in zip(link_vertices, spheres_per_link, strict=True)
    ]
    tool = np.reshape(np.asarray(tool_centre, dtype=np.float64), (-1, 3))
    covers = [(i, c, r) for i, (c, r) in enumerate(fitted)]
    covers.append((n + 1, tool, np.asarray(tool_radius, dtype=np.float64).reshape(-1)))
    bodies = [np.reshape(np.asarray(body, dtype=np.float64), (-1, 3)) for body in (*link_vertices, tool_vertices)]
    hulls = cached_arrays(cache_dir, "hulls1", bodies, lambda: dict(convex_hulls(bodies)._asdict()))
    model = assemble(
        base_from_joint=base_from_joint,
        lower=lower,
        upper=upper,
        covers=covers,
        tool_length=tool_length,
        cache_dir=cache_dir,
        seed=seed,
    )
    return replace(model, hulls=Hulls(**hulls))  # type: ignore[arg-type]


def assemble(
    *,
    base_from_joint: npt.ArrayLike,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    covers: Sequence[tuple[int, FloatArray, FloatArray]],
    tool_length: float = 0.0,
    touching: Sequence[tuple[int, int]] | None = None,
    colliding: Sequence[tuple[int, int]] = (),
    cache_dir: Path | None = None,
    seed: int = 0,
) -> ArmModel:
    """Put an arm's spheres together and choose the self-collision pairs.

    Args:
        base_from_joint: Fixed transform before each joint, shape (n, 4, 4).
        lower: Lower joint limits [rad], shape (n,).
        upper: Upper joint limits [rad], shape (n,).
        covers: Rigid part (0 base, i what moves with joint i, n+1 what is fixed to the last link), sphere centres in
            the part's frame (k, 3) and radii (k,) [m]; a part may have several.
        tool_length: From the last link frame to the tool tip along +z [m].
        touching: Pairs of parts that touch by construction and are not tested, lower one first, neighbours included;
            None takes neighbours, and pairs whose spheres overlap in more than half of all configurations.
        colliding: Pairs that are tested although they are neighbours.
        cache_dir: Directory for the pairs; None finds them anew.
        seed: Seed of the sampled self-collision statistics.

    Returns:
        The arm model.

    Raises:
        PlanningError: Shapes do not fit, no spheres, a part that the arm does not have, or limits that are not finite
            or not in order.
    """
    n = len(joint_rows(base_from_joint))
    if not covers or not all(0 <= part <= n + 1 for part, _, _ in covers):
        raise PlanningError(f"assemble: parts {[part for part, _, _ in covers]}; valid: at least one, 0 to {n + 1}")
    centre = np.concatenate([np.reshape(c, (-1, 3)) for _, c, _ in covers])
    radius = np.concatenate([np.reshape(r, -1) for _, _, r in covers])
    part = np.concatenate([np.full(len(r), i, dtype=np.int64) for i, _, r in covers])
    frame = np.minimum(part, n)
    low, high = checks.limits("assemble", lower, upper)
    if not np.isfinite(high - low).all():
        raise PlanningError(f"assemble: limits {low} and {high}; valid: finite: configurations are drawn between them")

    def pairs() -> Arrays:
        found = link_self_pairs(
            base_from_joint=base_from_joint,
            lower=low,
            upper=high,
            sphere_centre=centre,
            sphere_radius=radius,
            sphere_frame=frame,
            sphere_part=part,
            touching=touching,
            seed=seed,
        )
        return {"pairs": found}

    said = np.array([] if touching is None else [(-1, -1), *touching])
    inputs = (base_from_joint, low, high, centre, radius, frame, part, seed, said)
    part_pairs = cached_arrays(cache_dir, "pairs2", inputs, pairs)["pairs"]
    part_pairs = np.unique(np.concatenate([part_pairs, np.reshape(colliding, (-1, 2)).astype(np.int64)]), axis=0)
    return ArmModel(
        base_from_joint=np.asarray(base_from_joint, dtype=np.float64),
        lower=low,
        upper=high,
        sphere_centre=centre,
        sphere_radius=radius,
        sphere_frame=frame,
        self_pairs=sphere_pairs(part, part_pairs.tolist()),
        tool_length=float(tool_length),
        sphere_part=part,
    )


def sphere_pairs(sphere_part: IntArray, part_pairs: Sequence[Sequence[int]]) -> IntArray:
    """Expand pairs of rigid parts to pairs of their spheres, shape (p, 2), lower part first."""
    rows = [
        np.stack(np.meshgrid(np.flatnonzero(sphere_part == min(p)), np.flatnonzero(sphere_part == max(p))), axis=-1)
        for p in part_pairs
    ]
    return np.concatenate([np.empty((0, 2), dtype=np.int64)] + [r.reshape(-1, 2) for r in rows]).astype(np.int64)
