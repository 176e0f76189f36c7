"""Sphere covers: everything inside, files read right, cache transparent."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from planners.errors import PlanningError
from planners.motion.arm.spheres import box_spheres, fit_spheres, fit_spheres_cached, link_self_pairs, read_binary_stl


def _outside(points, centre, radius):  # type: ignore[no-untyped-def]
    return np.min(np.linalg.norm(points[:, None] - centre, axis=2) - radius, axis=1).max()


def _hull_points(vertices, n, rng):  # type: ignore[no-untyped-def]
    corners = vertices[ConvexHull(vertices).vertices]
    few = rng.dirichlet(np.full(3, 0.5), n)  # mixtures of few corners lie near the surface
    return np.einsum("nk,nkd->nd", few, corners[rng.integers(0, len(corners), (n, 3))])


def test_every_hull_point_of_every_link_is_covered(iiwa, iiwa_meshes):  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(2)
    for link, vertices in enumerate(iiwa_meshes):
        own = iiwa.sphere_frame == link
        points = np.concatenate([vertices, _hull_points(vertices, 20000, rng)])
        assert _outside(points, iiwa.sphere_centre[own], iiwa.sphere_radius[own]) <= 0.0


def test_cover_is_not_much_larger_than_the_arm(iiwa_meshes):  # type: ignore[no-untyped-def]
    centre, radius = fit_spheres(iiwa_meshes[3], 4, 0)
    volume = ConvexHull(iiwa_meshes[3]).volume
    assert np.sum(4 / 3 * np.pi * radius**3) < 3.0 * volume
    assert len(centre) == 4


def test_a_cube_in_one_sphere():
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    centre, radius = fit_spheres(cube, 1, 0)
    np.testing.assert_allclose(centre, [[0.5, 0.5, 0.5]], atol=0.02)
    assert radius[0] == pytest.approx(np.sqrt(0.75), abs=0.02)


def test_same_seed_same_spheres(iiwa_meshes):  # type: ignore[no-untyped-def]
    first, second = fit_spheres(iiwa_meshes[7], 2, 5), fit_spheres(iiwa_meshes[7], 2, 5)
    assert first[0].tobytes() == second[0].tobytes()
    assert first[1].tobytes() == second[1].tobytes()


def test_cache_returns_the_same_and_keys_on_parameters(tmp_path):  # type: ignore[no-untyped-def]
    points = np.random.default_rng(0).normal(size=(30, 3))
    fresh = fit_spheres_cached(points, 2, 0, tmp_path)
    stored = fit_spheres_cached(points, 2, 0, tmp_path)
    np.testing.assert_array_equal(fresh[0], stored[0])
    np.testing.assert_array_equal(fresh[1], stored[1])
    assert len(list(tmp_path.iterdir())) == 1
    fit_spheres_cached(points, 1, 0, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("per_axis", [(1, 1, 1), (2, 2, 2), (3, 2, 1)])
def test_box_is_covered(per_axis):  # type: ignore[no-untyped-def]
    half = np.array([0.05, 0.04, 0.03])
    points = np.random.default_rng(0).uniform(-half, half, (5000, 3))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    centre, radius = box_spheres(half, per_axis)
    assert len(radius) == np.prod(per_axis)
    assert _outside(np.concatenate([points, corners]), centre, radius) <= 1e-12


def test_self_pairs_skip_neighbours_and_find_the_tool(iiwa):  # type: ignore[no-untyped-def]
    frames = {tuple(sorted(iiwa.sphere_frame[pair])) for pair in iiwa.self_pairs}
    assert all(b - a >= 2 for a, b in frames)
    assert {(0, 5), (0, 6), (0, 7)} <= frames  # the hand can reach the base
    last_link = int(np.flatnonzero(iiwa.sphere_frame == 7)[0])
    fifth = np.flatnonzero(iiwa.sphere_frame == 5)
    tested = iiwa.self_pairs[iiwa.self_pairs[:, 1] == last_link, 0]
    assert not np.isin(fifth, tested).any()  # the covers of links 5 and 7 always meet


def test_self_pairs_of_a_planar_arm():
    # Three links of 1 m in a plane: the last can fold back onto the base, the middle one touches both.
    transforms = np.tile(np.eye(4), (3, 1, 1))
    transforms[1:, 0, 3] = 1.0
    pairs = link_self_pairs(
        base_from_joint=transforms,
        lower=np.full(3, -3.1),
        upper=np.full(3, 3.1),
        sphere_centre=np.array([[0.0, 0, 0], [0.5, 0, 0], [0.5, 0, 0], [0.9, 0, 0]]),
        sphere_radius=np.full(4, 0.1),
        sphere_frame=np.arange(4),
        sphere_part=np.arange(4),
    )
    assert pairs.tolist() == [[0, 3], [1, 3]]


def test_bad_meshes_are_refused(tmp_path):  # type: ignore[no-untyped-def]
    with pytest.raises(PlanningError, match="no volume"):
        fit_spheres(np.zeros((8, 3)), 2, 0)
    with pytest.raises(PlanningError, match="k = 0"):
        fit_spheres(np.eye(4)[:, :3], 0, 0)
    path = tmp_path / "text.stl"
    path.write_text("solid ascii\nendsolid\n")
    with pytest.raises(PlanningError, match="binary STL"):
        read_binary_stl(path)
