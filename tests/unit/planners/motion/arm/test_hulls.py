"""Hulls: their corners are the mesh's, and one direction tells whether two bodies keep apart during a step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from planners.errors import PlanningError
from planners.motion.arm.hulls import SCRATCH, ArmStep, bodies_of, convex_hulls, step_apart

CUBE = np.array(np.meshgrid(*[(-0.1, 0.1)] * 3)).reshape(3, -1).T


def _frame(rng):  # type: ignore[no-untyped-def]
    turn = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    return np.column_stack([turn, rng.normal(scale=0.15, size=3)])


def _apart(hulls, a, begin, end, b, their_begin, their_end, distance):  # type: ignore[no-untyped-def]
    one, other = ArmStep(hulls, a, begin, end), ArmStep(hulls, b, their_begin, their_end)
    return step_apart(one, other, distance, np.empty(3), np.full(2, -1), np.empty(SCRATCH))


def _distance_m(points):  # type: ignore[no-untyped-def]
    """From the origin to the convex hull of points, by least squares; 0 inside."""
    hull = ConvexHull(points)
    if np.all(hull.equations[:, 3] <= 0):
        return 0.0
    corners = points[hull.vertices]
    weight, _ = nnls(np.vstack([corners.T, np.full(len(corners), 1e3)]), np.array([0.0, 0.0, 0.0, 1e3]))
    return float(np.linalg.norm(weight / weight.sum() @ corners))


def test_a_step_is_proven_to_the_distance_of_what_both_ends_differ_by(iiwa_meshes):  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(0)
    meshes = [mesh[ConvexHull(mesh).vertices] for mesh in iiwa_meshes]
    hulls = convex_hulls(iiwa_meshes)
    apart = 0
    for _ in range(20):
        a, b = rng.integers(8, size=2)
        begin, their_begin = _frame(rng), _frame(rng)
        end, their_end = begin.copy(), their_begin.copy()
        end[:, 3] += rng.normal(scale=0.02, size=3)
        their_end[:, 3] += rng.normal(scale=0.02, size=3)
        differences = [
            (meshes[b] @ theirs[:, :3].T + theirs[:, 3])[:, None] - (meshes[a] @ own[:, :3].T + own[:, 3])
            for own, theirs in ((begin, their_begin), (end, their_end))
        ]
        distance = _distance_m(np.concatenate(differences).reshape(-1, 3))
        apart += distance > 0
        for off in (-1e-3, -1e-5, 1e-5, 1e-3, 0.05):
            if distance + off > 0:
                proven = _apart(hulls, a, begin, end, b, their_begin, their_end, distance + off)
                assert proven == (off < 0)
    assert 10 < apart < 20


def test_bodies_that_pass_through_each_other_within_a_step_are_not_apart():  # type: ignore[no-untyped-def]
    hulls = convex_hulls([CUBE])
    still, left, right = (np.column_stack([np.eye(3), [x, 0.0, 0.0]]) for x in (0.0, -0.5, 0.5))
    assert _apart(hulls, 0, still, still, 0, left, left, 0.29)
    assert _apart(hulls, 0, still, still, 0, right, right, 0.29)
    assert not _apart(hulls, 0, still, still, 0, left, right, 0.01)


def test_parts_without_a_hull_are_their_spheres():  # type: ignore[no-untyped-def]
    hulls = convex_hulls([CUBE, (), CUBE + 1.0])
    spheres = np.array([[0.0, 0.0, 0.0, 0.2], [1.0, 0.0, 0.0, 0.3], [2.0, 0.0, 0.0, 0.4], [1.0, 1.0, 1.0, 0.2]])
    bodies = bodies_of(hulls, spheres, np.array([0, 1, 3, 2]), np.array([0, 1, 2, 2]))
    np.testing.assert_array_equal(bodies.radius, [0.0, 0.0, 0.3, 0.4])
    np.testing.assert_array_equal(bodies.frame, [0, 2, 1, 2])
    np.testing.assert_allclose(bodies.ball[:, 3], [np.sqrt(0.03), np.sqrt(0.03), 0.3, 0.4])
    np.testing.assert_allclose(bodies.ball[1, :3], 1.0)
    np.testing.assert_array_equal(bodies.hulls.corner[bodies.hulls.first[2]], [1.0, 0.0, 0.0])
    bare = bodies_of(None, spheres, np.array([0, 1, 3, 2]), np.array([0, 1, 2, 2]))
    np.testing.assert_array_equal(bare.radius, spheres[:, 3])


def test_a_flat_body_is_refused():  # type: ignore[no-untyped-def]
    with pytest.raises(PlanningError, match="body 1 has no volume"):
        convex_hulls([CUBE, CUBE * (1.0, 1.0, 0.0)])
