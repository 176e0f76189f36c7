"""Routes: straight out, short, straight in, timed; a status says why there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.motion import RrtConnectNative
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.kinematics import link_frames
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes
from planners.motion.path.lines import straight_line, tip_pose
from planners.motion.path.route import RouteConfig, RoutePlanner, RouteProblem, RouteStatus

SPEED = np.radians([85, 85, 100, 75, 130, 135, 135])
ACCELERATION = np.full(7, 5.0)


def router(iiwa, srs, boxes):  # type: ignore[no-untyped-def]
    travel, line = (CollisionChecker(iiwa, boxes, margin=margin) for margin in (0.01, 0.002))
    return RoutePlanner(srs, travel, line, RrtConnectNative(), SPEED, ACCELERATION)


def down(x: float, y: float, z: float):  # type: ignore[no-untyped-def]
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x, y, z
    return pose


@pytest.fixture
def problem(srs):  # type: ignore[no-untyped-def]
    """From beside one pedestal to over the tray."""
    start = srs.ik_all(down(0.2, 0.5, 0.25 + 0.185))
    start = start[np.argmin(np.abs(start).sum(axis=1))]
    return RouteProblem(
        start=start,
        tips=np.stack([down(0.6, 0.0, 0.3), down(0.62, 0.05, 0.3)]),
        leave=np.array([0.0, 0.0, 0.1]),
        arrive=np.array([0.0, 0.0, 0.12]),
        seed=3,
    )


def test_a_route_has_straight_ends_and_respects_limits(iiwa, srs, station, problem):  # type: ignore[no-untyped-def]
    planner = router(iiwa, srs, station)
    route = planner.plan(problem)
    assert route.status is RouteStatus.SOLVED
    assert len(route.segments) == 3
    np.testing.assert_array_equal(route.out[0], problem.start)
    np.testing.assert_array_equal(route.out[-1], route.travel[0])
    np.testing.assert_allclose(route.travel[-1], route.into[0], atol=1e-12)
    assert min(np.abs(tip - planner.tip(route.into[-1])).max() for tip in problem.tips) < 1e-6
    for line, way in ((route.out, problem.leave), (route.into, -problem.arrive)):
        tips = np.array([planner.tip(q)[:3, 3] for q in line])
        along = (tips - tips[0]) @ way / (way @ way)
        np.testing.assert_allclose(tips - tips[0], along[:, None] * way, atol=1e-6)
        assert along[-1] == pytest.approx(1.0)
    solid = CollisionChecker(iiwa, station, margin=0.0)
    for segment in route.segments:
        assert solid.path_free(segment.q)
        assert (np.abs(np.diff(segment.q, axis=0) / 0.01) <= SPEED).all()
        assert (np.abs(np.diff(segment.q, 2, axis=0) / 0.01**2) <= ACCELERATION).all()
    assert route.duration_s == sum(segment.duration_s for segment in route.segments)
    assert planner.plan(problem).travel.tobytes() == route.travel.tobytes()


def test_without_lines_there_is_one_segment(iiwa, srs, station, problem):  # type: ignore[no-untyped-def]
    still = replace(problem, leave=np.zeros(3), arrive=np.zeros(3), tips=problem.tips + down(0, 0, 0.3) * [0, 0, 0, 1])
    route = router(iiwa, srs, station).plan(still)
    assert route.solved
    assert len(route.segments) == 1
    assert len(route.out) == len(route.into) == 1


def test_reasons(iiwa, srs, station, problem):  # type: ignore[no-untyped-def]
    planner = router(iiwa, srs, station)
    far, inside = down(2.0, 0.0, 0.5), down(0.6, 0.0, 0.1)
    assert planner.plan(replace(problem, tips=far[None])).status is RouteStatus.UNREACHABLE
    assert planner.plan(replace(problem, tips=inside[None])).status is RouteStatus.NO_LINE_TO_GOAL
    still = replace(problem, tips=inside[None], arrive=np.zeros(3))
    assert planner.plan(still).status is RouteStatus.GOALS_COLLIDE
    assert planner.plan(replace(problem, leave=np.array([0, 0, -0.6]))).status is RouteStatus.NO_LINE_FROM_START
    lost = RoutePlanner(
        srs,
        CollisionChecker(iiwa, Boxes.join(station, Boxes.one((0.45, 0.0, 1.0), (0.02, 3.0, 1.0))), margin=0.01),
        CollisionChecker(iiwa, station, margin=0.002),
        RrtConnectNative(),
        SPEED,
        ACCELERATION,
        RouteConfig(max_iterations=50),
    )
    assert lost.plan(problem).status in (RouteStatus.NO_PATH, RouteStatus.GOALS_COLLIDE)


def test_malformed_problems_are_named(iiwa, srs, station, problem):  # type: ignore[no-untyped-def]
    with pytest.raises(PlanningError, match=r"(?s)RouteProblem.tips: .*valid: finite"):
        replace(problem, tips=np.full((1, 4, 4), np.nan))
    with pytest.raises(PlanningError, match=r"valid: \(n,\) and \(k, 4, 4\)"):
        replace(problem, tips=np.empty((0, 4, 4)))
    with pytest.raises(PlanningError, match="leave: shape"):
        replace(problem, leave=np.zeros(2))
    with pytest.raises(PlanningError, match=r"valid: \(7,\)"):
        router(iiwa, srs, station).plan(replace(problem, start=np.zeros(6)))


def test_lines_by_descent_are_straight_too(iiwa, srs):  # type: ignore[no-untyped-def]
    descent = NumericInverse.from_joints(iiwa.base_from_joint, iiwa.lower, iiwa.upper)
    q = np.array([0.3, 0.6, 0.0, -1.4, 0.0, 1.1, 0.0])
    goal = tip_pose(srs, q, 0.185)
    goal[:3, 3] += [0.1, -0.1, -0.15]
    line = straight_line(descent, descent, q, goal, 0.185)  # type: ignore[arg-type]
    tips = link_frames(iiwa.base_from_joint, line)[:, -1]
    tips = tips[:, :3, 3] + 0.185 * tips[:, :3, 2]
    along = np.linspace(0.0, 1.0, len(line))[:, None]
    np.testing.assert_allclose(tips, tips[0] + along * (goal[:3, 3] - tips[0]), atol=1e-5)
    goal[:3, 3] += 2.0
    assert straight_line(descent, descent, q, goal, 0.185) is None  # type: ignore[arg-type]
