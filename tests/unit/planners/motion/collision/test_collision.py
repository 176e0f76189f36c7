"""Collision checks against a slow, obvious reference."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.motion.arm.kinematics import link_frames
from planners.motion.arm.spheres import box_spheres
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes, Capsules

HOME = np.array([0, 0.2, 0, -1.5, 0, 1.4, 0])


def _reference(model, boxes, q, margin, held=None):  # type: ignore[no-untyped-def]
    """Clearance to boxes and smallest self gap, written the slow way."""
    frames = link_frames(model.base_from_joint, q)
    frame, radius, local = model.sphere_frame, model.sphere_radius, model.sphere_centre
    if held is not None:
        local = np.concatenate([local, held[0]])
        radius = np.concatenate([radius, held[1]])
        frame = np.concatenate([frame, np.full(len(held[1]), model.n_joints)])
    centre = np.array([frames[f, :3, :3] @ c + frames[f, :3, 3] for f, c in zip(frame, local, strict=True)])
    clearance = np.inf
    for b in range(len(boxes)):
        c, s = np.cos(boxes.yaw[b]), np.sin(boxes.yaw[b])
        inside = (centre - boxes.centre[b]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        gap = np.abs(inside) - boxes.half[b]
        distance = np.linalg.norm(np.maximum(gap, 0), axis=1) + np.minimum(gap.max(1), 0) - radius
        clearance = min(clearance, distance[frame >= boxes.min_frame[b]].min())
    pairs = model.self_pairs
    if held is not None:
        extra = [
            (i, len(model.sphere_radius) + h)
            for i in np.flatnonzero(model.sphere_frame <= 5)
            for h in range(len(held[1]))
        ]
        pairs = np.concatenate([pairs, extra])
    gaps = np.linalg.norm(centre[pairs[:, 0]] - centre[pairs[:, 1]], axis=1) - radius[pairs].sum(1)
    return clearance, gaps.min()


@pytest.fixture(scope="module")
def held():  # type: ignore[no-untyped-def]
    """A 10 cm parcel at the tip of the cup."""
    centre, radius = box_spheres((0.05, 0.05, 0.05))
    return centre + np.array([0, 0, 0.185 + 0.05]), radius


@pytest.mark.parametrize("carries", [False, True])
def test_free_and_clearance_match_the_reference(iiwa, station, held, carries):  # type: ignore[no-untyped-def]
    turned = Boxes.join(station, Boxes.one((0.1, 0.6, 0.5), (0.2, 0.05, 0.1), yaw=0.7))
    parcel = held if carries else None
    checker = CollisionChecker(iiwa, turned, parcel, margin=0.02)
    q = np.random.default_rng(0).uniform(iiwa.lower, iiwa.upper, (400, 7))
    expected = [_reference(iiwa, turned, x, 0.02, parcel) for x in q]
    free = np.array([c >= 0.02 and s >= 0.0 for c, s in expected])
    assert 0.1 < free.mean() < 0.9
    np.testing.assert_array_equal(checker.batch(q), free)
    assert [checker.free(x) for x in q[:50]] == free[:50].tolist()
    np.testing.assert_allclose([checker.clearance(x) for x in q], [c for c, _ in expected], atol=1e-9)


def test_capsules_match_segment_distances(iiwa):  # type: ignore[no-untyped-def]
    ends = (
        np.array([[0.5, 0.1, 0.2], [0.2, -0.5, 0.9], [-0.4, 0.3, 0.7]]),
        np.array([[0.6, -0.4, 0.8], [0.2, -0.5, 0.4], [-0.4, 0.3, 0.7]]),
    )
    radius = np.array([0.05, 0.1, 0.15])
    rods = Capsules(start=ends[0], end=ends[1], radius=radius, min_frame=np.array([0, 4, 0]))
    checker = CollisionChecker(iiwa, Boxes(), margin=0.0, capsules=rods)
    dense = ends[0][:, None] + np.linspace(0, 1, 2001)[:, None] * (ends[1] - ends[0])[:, None]
    alone = CollisionChecker(iiwa, Boxes(), margin=0.0)
    n_hit = 0
    for q in np.random.default_rng(5).uniform(iiwa.lower, iiwa.upper, (60, 7)):
        centre = alone.sphere_centres(q)
        part = np.sort(iiwa.sphere_part)
        gap = np.inf
        for points, r, frame in zip(dense, radius, rods.min_frame, strict=True):
            own = np.linalg.norm(centre[:, None] - points, axis=2).min(axis=1) - r
            own -= iiwa.sphere_radius[np.argsort(iiwa.sphere_part, kind="stable")]
            gap = min(gap, own[part >= frame].min())
        assert checker.clearance(q) == pytest.approx(gap, abs=2e-4)
        if abs(gap) > 2e-4:
            assert checker.free(q) == (alone.free(q) and gap > 0)
        n_hit += gap < 0
    assert 10 < n_hit < 50


def test_another_arm_at_rest_is_an_obstacle(iiwa):  # type: ignore[no-untyped-def]
    other = CollisionChecker(iiwa, Boxes()).sphere_centres(np.zeros(7)) + np.array([0.5, 0.0, 0.0])
    spheres = Capsules.spheres(other, iiwa.sphere_radius[np.argsort(iiwa.sphere_part, kind="stable")])
    checker = CollisionChecker(iiwa, Boxes(), capsules=spheres)
    assert checker.free(np.zeros(7))
    assert not checker.free([0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_accepted_edges_are_free_everywhere(iiwa, station, held):  # type: ignore[no-untyped-def]
    # Far denser than the check's own steps: 0.002 rad, without the margin.
    checker = CollisionChecker(iiwa, station, held, margin=0.01)
    exact = CollisionChecker(iiwa, station, held, margin=0.0)
    rng = np.random.default_rng(3)
    q = rng.uniform(iiwa.lower, iiwa.upper, (400, 7))
    q = q[checker.batch(q)]
    accepted = rejected = 0
    for a in q:
        b = np.clip(a + rng.normal(0, 0.4, 7), iiwa.lower, iiwa.upper)
        dense = a + np.linspace(0, 1, int(np.linalg.norm(b - a) / 0.002))[:, None] * (b - a)
        if checker.edge(a, b):
            accepted += 1
            assert exact.batch(dense).all()
        else:
            rejected += 1
            assert not checker.batch(dense).all()
    assert accepted > 50
    assert rejected > 20


def test_thin_wall_is_not_jumped(iiwa):  # type: ignore[no-untyped-def]
    a, b = HOME.copy(), HOME.copy()
    a[0], b[0] = -0.6, 0.6
    wall = Boxes.one((0.55, 0.0, 0.5), (0.25, 0.0005, 0.5))
    checker = CollisionChecker(iiwa, wall, margin=0.0)
    assert checker.free(a)
    assert checker.free(b)
    assert not checker.edge(a, b)
    assert not checker.path_free([a, b])
    assert CollisionChecker(iiwa, Boxes(), margin=0.0).path_free([a, b])


def test_base_may_stand_on_the_floor(iiwa):  # type: ignore[no-untyped-def]
    floor = {"centre": (0, 0, -0.05), "half": (3, 3, 0.05)}
    assert not CollisionChecker(iiwa, Boxes.one(**floor)).free(HOME)
    assert CollisionChecker(iiwa, Boxes.one(**floor, min_frame=2)).free(HOME)


def test_the_parcel_counts(iiwa, held):  # type: ignore[no-untyped-def]
    bare = CollisionChecker(iiwa, Boxes())
    x, y, z = link_frames(iiwa.base_from_joint, HOME)[-1][:3, 3]
    below = Boxes.one((x, y, z - 0.32), (0.05, 0.05, 0.05))
    assert bare.clearance(HOME) == np.inf
    assert CollisionChecker(iiwa, below).free(HOME)
    assert not CollisionChecker(iiwa, below, held).free(HOME)


def test_malformed_input_is_named(iiwa):  # type: ignore[no-untyped-def]
    with pytest.raises(PlanningError, match="margin"):
        CollisionChecker(iiwa, Boxes(), margin=-0.1)
    with pytest.raises(PlanningError, match="held spheres"):
        CollisionChecker(iiwa, Boxes(), (np.zeros((2, 3)), np.zeros(1)))
    with pytest.raises(PlanningError, match="half > 0"):
        Boxes.one((0, 0, 0), (0.1, 0.0, 0.1))
    with pytest.raises(PlanningError, match=r"valid: \(7,\)"):
        CollisionChecker(iiwa, Boxes()).free(np.zeros(6))
    with pytest.raises(PlanningError, match="radius > 0"):
        Capsules.one((0, 0, 0), (0, 0, 1), 0.0)
    with pytest.raises(PlanningError, match="finite"):
        Boxes.one((0, 0, np.nan), (1, 1, 1))


def test_a_check_takes_numbers_however_they_lie_in_memory_and_copies_of_a_checker_agree(iiwa):  # type: ignore[no-untyped-def]
    """Checks are compiled for contiguous float64 and do not ask for types: what differs is made so before."""
    checker = CollisionChecker(iiwa, Boxes.one((0.5, 0.0, 0.4), (0.2, 0.2, 0.2)), margin=0.0)
    rng = np.random.default_rng(3)
    q = rng.uniform(iiwa.lower, iiwa.upper, (60, 7)).astype(np.float32).astype(np.float64)
    free = checker.batch(q)
    assert 5 < free.sum() < 55
    wide = np.repeat(q, 2, axis=1)
    still = q.copy()
    still.flags.writeable = False
    others = copy.deepcopy(checker), pickle.loads(pickle.dumps(checker))
    for k in range(len(q)):
        forms = wide[k, ::2], q[k].astype(np.float32), q[k].astype(">f8"), q[k].tolist(), tuple(q[k]), still[k]
        assert [checker.free(form) for form in forms] == [free[k]] * len(forms)
        assert [other.free(q[k]) for other in others] == [free[k]] * 2
        assert checker.edge(q[k].tolist(), wide[k, ::2]) == free[k]
