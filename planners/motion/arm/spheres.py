"""Spheres that cover meshes: conservative fit of convex hulls, boxes, and which parts of an arm to test."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.cluster.vq import kmeans2
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.array_cache import Arrays, cached_arrays
from planners.motion.arm.kinematics import link_frames
from planners.motion.arrays import FloatArray, IntArray

_FIT_VERSION = 1  # part of the cache key; raise it when the fit changes
_SURFACE_SAMPLES = 3000
_VOLUME_SAMPLES = 6000
_RESTARTS = 6
_MOST_SPHERES = 100
_LLOYD_STEPS = 25
_NEAR_M = 0.03  # the samples are 0.1-0.2 rad apart, so a near miss may hide a hit
_MOSTLY_TOUCHING = 0.5
_MINIMUM_POINTS = 4  # a volume needs four points
_SMALL_M, _LONG_M = 0.12, 0.2
_STL_HEADER = 84  # 80 bytes of comment, then the triangle count as uint32
_STL_TRIANGLE = np.dtype([("normal", "<3f4"), ("corners", "<9f4"), ("attribute", "<u2")])


def read_binary_stl(path: Path) -> FloatArray:
    """Read the triangle corners of a binary STL file.

    Args:
        path: The file.

    Returns:
        Corners in file order, in the file's units, shape (3 * n_triangles, 3).

    Raises:
        PlanningError: It cannot be read, or its size does not match the triangle count (an ASCII STL, or cut off).
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise PlanningError(f"{path}: {error.strerror}; valid: a binary STL file") from error
    count = int(np.frombuffer(data[80:_STL_HEADER], "<u4")[0]) if len(data) >= _STL_HEADER else -1
    if len(data) != _STL_HEADER + count * _STL_TRIANGLE.itemsize:
        raise PlanningError(f"{path}: {len(data)} bytes is not a binary STL of {count} triangles")
    triangles = np.frombuffer(data, _STL_TRIANGLE, count, _STL_HEADER)
    return triangles["corners"].reshape(-1, 3).astype(np.float64)


def fit_spheres(vertices: npt.ArrayLike, k: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Cover the convex hull of a mesh with spheres; every point of the hull is inside one of them.

    Lloyd's iteration with smallest enclosing balls as centres spreads the spheres. Then the hull is cut into the
    Voronoi cells of the centres: convex polytopes, so a ball around a cell's corners holds the whole cell. This
    makes the cover exact, not sampled.

    Args:
        vertices: Mesh vertices, shape (v, 3).
        k: Number of spheres, 1 to 100.
        seed: Seed of samples and restarts.

    Returns:
        Centres (m, 3) and radii (m,), m <= k (an empty Voronoi cell gives no sphere), in the mesh's units.

    Raises:
        PlanningError: k is out of range, or the mesh has no volume.
    """
    points = checks.rows("fit_spheres: vertices", vertices, 3, least=0)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < _MINIMUM_POINTS:
        raise PlanningError(f"fit_spheres: vertices of shape {points.shape}; valid: (v, 3) with v >= 4")
    checks.whole("fit_spheres: k =", k, 1, _MOST_SPHERES)
    try:
        hull = ConvexHull(points)
    except QhullError as error:
        raise PlanningError("fit_spheres: the mesh has no volume") from error
    rng = np.random.default_rng(seed)
    surface = np.concatenate([points[hull.vertices], _surface_samples(points, hull, rng)])
    inside = _volume_samples(points, hull, rng)
    best: tuple[float, FloatArray, FloatArray] | None = None
    for _ in range(_RESTARTS):
        centre, radius = _cover(hull, _spread(surface, inside, k, rng), inside)
        cost = float(np.sum(radius**3))
        if best is None or cost < best[0]:
            best = (cost, centre, radius)
    if best is None:
        raise PlanningError("fit_spheres: no restart was made")
    return best[1], best[2]


def sphere_count(vertices: npt.ArrayLike) -> int:
    """A number of spheres that suits a link of this size: four for a long one of a human-sized arm, two for a small."""
    size = float(np.ptp(np.asarray(vertices), axis=0).max())
    return 2 if size < _SMALL_M else 3 if size < _LONG_M else 4


def fit_spheres_cached(
    vertices: npt.ArrayLike, k: int, seed: int, directory: Path | None
) -> tuple[FloatArray, FloatArray]:
    """`fit_spheres`, remembered in a directory by mesh bytes and parameters (None: no cache)."""

    def compute() -> Arrays:
        centre, radius = fit_spheres(vertices, k, seed)
        return {"centre": centre, "radius": radius}

    stored = cached_arrays(directory, f"spheres{_FIT_VERSION}", (vertices, k, seed), compute)
    return stored["centre"].astype(np.float64), stored["radius"].astype(np.float64)


def box_spheres(
    half_extent: npt.ArrayLike, per_axis: tuple[int, int, int] = (2, 2, 2)
) -> tuple[FloatArray, FloatArray]:
    """Cover a box by a regular grid of equal spheres, each around one cell of the grid.

    Args:
        half_extent: Half edge lengths [m], shape (3,).
        per_axis: Cells along each axis.

    Returns:
        Centres relative to the box centre (m, 3) and radii (m,) [m].

    Raises:
        PlanningError: A non-positive extent or count.
    """
    half = checks.vector("box_spheres: half extent", half_extent, 3)
    count = np.asarray(per_axis)
    if np.any(half <= 0) or count.shape != (3,) or np.any(count < 1):
        raise PlanningError(f"box_spheres: half extent {half}, per axis {per_axis}; valid: three positive values each")
    axes = [(np.arange(n) + 0.5) / n * 2.0 * h - h for n, h in zip(count, half, strict=True)]
    centre = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return centre, np.full(len(centre), float(np.linalg.norm(half / count)))


def link_self_pairs(
    *,
    base_from_joint: npt.ArrayLike,
    lower: FloatArray,
    upper: FloatArray,
    sphere_centre: FloatArray,
    sphere_radius: FloatArray,
    sphere_frame: IntArray,
    sphere_part: IntArray,
    touching: Sequence[tuple[int, int]] | None = None,
    seed: int = 0,
    n_samples: int = 4000,
) -> IntArray:
    """Which rigid parts of an arm are worth testing against each other.

    Decided by random configurations, as the MoveIt setup assistant does. Skipped are parts on the same frame or one
    joint apart (they touch by construction), pairs whose spheres overlap in more than half of the configurations
    (the cover meets, not the links) and pairs that never come nearer than 3 cm.

    Args:
        base_from_joint: Joint transforms, shape (n, 4, 4).
        lower: Lower limits [rad], shape (n,).
        upper: Upper limits [rad], shape (n,).
        sphere_centre: Centres in their frames [m], shape (k, 3).
        sphere_radius: Radii [m], shape (k,).
        sphere_frame: Frame of each sphere, shape (k,).
        sphere_part: Rigid part of each sphere, shape (k,); two parts may share a frame (a link and its tool).
        touching: Pairs that are known to touch by construction; they are skipped, and no others for overlapping
            often. None for not known.
        seed: Seed of the sampled configurations.
        n_samples: Number of configurations.

    Returns:
        Pairs of parts, lower one first, sorted, shape (p, 2).
    """
    q = np.random.default_rng(seed).uniform(lower, upper, (n_samples, len(lower)))
    own = link_frames(base_from_joint, q)[:, sphere_frame]  # (m, k, 4, 4)
    centre = np.einsum("mkab,kb->mka", own[..., :3, :3], sphere_centre) + own[..., :3, 3]
    parts = np.unique(sphere_part)
    pairs = []
    for a, i in enumerate(parts):
        for j in parts[a + 1 :]:
            if touching is not None and (int(i), int(j)) in touching:
                continue
            first, second = np.flatnonzero(sphere_part == i), np.flatnonzero(sphere_part == j)
            if abs(int(sphere_frame[first[0]]) - int(sphere_frame[second[0]])) <= 1:
                continue
            distance = np.linalg.norm(centre[:, first][:, :, None] - centre[:, second][:, None], axis=-1)
            gap = np.min(distance - sphere_radius[first][:, None] - sphere_radius[second], axis=(1, 2))
            if gap.min() < _NEAR_M and (touching is not None or np.mean(gap < 0.0) < _MOSTLY_TOUCHING):
                pairs.append((int(i), int(j)))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _surface_samples(points: FloatArray, hull: ConvexHull, rng: np.random.Generator) -> FloatArray:
    corners = points[hull.simplices]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = corners[rng.choice(len(corners), _SURFACE_SAMPLES, p=area / area.sum())]
    weight = rng.dirichlet((1.0, 1.0, 1.0), _SURFACE_SAMPLES)
    samples: FloatArray = np.einsum("nk,nkd->nd", weight, chosen)
    return samples


def _volume_samples(points: FloatArray, hull: ConvexHull, rng: np.random.Generator) -> FloatArray:
    box = rng.uniform(points.min(0), points.max(0), (_VOLUME_SAMPLES, 3))
    inside = np.all(box @ hull.equations[:, :3].T + hull.equations[:, 3] < 0.0, axis=1)
    # The centroid makes the set non-empty even for a sliver that no sample hits.
    return np.concatenate([points[hull.vertices].mean(0, keepdims=True), box[inside]])


def _spread(surface: FloatArray, inside: FloatArray, k: int, rng: np.random.Generator) -> FloatArray:
    """Centres by Lloyd's iteration: assign, then move each centre into the ball around its points."""
    if k == 1:
        middle: FloatArray = surface.mean(0, keepdims=True)
        return middle
    centre: FloatArray
    centre, _ = kmeans2(inside, min(k, len(inside)), seed=rng, minit="++")
    for _ in range(_LLOYD_STEPS):
        nearest = np.argmin(np.linalg.norm(surface[:, None] - centre, axis=2), axis=1)
        for i in np.unique(nearest):
            centre[i] += 0.5 * (_enclosing_centre(surface[nearest == i], 20) - centre[i])
    return centre


def _cover(hull: ConvexHull, centre: FloatArray, inside: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Balls around the Voronoi cells of the centres within the hull."""
    owner = np.argmin(np.linalg.norm(inside[:, None] - centre, axis=2), axis=1)
    balls_centre, balls_radius = [], []
    for i, c in enumerate(centre):
        if not np.any(owner == i):
            continue
        others = np.delete(centre, i, axis=0)
        # |x - c|^2 <= |x - o|^2 as a half-space normal.x + offset <= 0
        bisector = np.column_stack([2.0 * (others - c), np.sum(c * c) - np.sum(others * others, axis=1)])
        cell = HalfspaceIntersection(np.concatenate([hull.equations, bisector]), inside[owner == i].mean(0))
        corners = cell.intersections[np.all(np.isfinite(cell.intersections), axis=1)]
        middle = _enclosing_centre(corners, 200)
        balls_centre.append(middle)
        # Half a micrometre covers the rounding of the polytope's corners.
        balls_radius.append(np.linalg.norm(corners - middle, axis=1).max() + 5e-7)
    return np.array(balls_centre), np.array(balls_radius)


def _enclosing_centre(points: FloatArray, steps: int) -> FloatArray:
    """Near-smallest enclosing ball's centre (Badoiu and Clarkson, Smaller core-sets for balls, SODA 2003)."""
    centre: FloatArray = 0.5 * (points.min(0) + points.max(0))
    for i in range(1, steps + 1):
        gap = np.linalg.norm(points - centre, axis=1)
        centre = centre + (points[np.argmax(gap)] - centre) / (i + 1)
    return centre
