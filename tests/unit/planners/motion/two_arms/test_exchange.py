"""Exchanges of places: both arms keep apart and clear of obstacles, and are done sooner than without pushes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.motion.collision.collision import Boxes, CollisionChecker
from planners.motion.path.timed_path import Dwell, timed_path
from planners.motion.search.rrt_connect_native import RrtConnectNative
from planners.motion.two_arms.asynchronous import asynchronous
from planners.motion.two_arms.diagram import free_cells
from planners.motion.two_arms.exchange import Stay, exchange
from planners.motion.two_arms.swept import ArmInWorld, swept
from planners.motion.two_arms.together import Trip, Way, plan_together
from planners.motion.two_arms.turns import in_turn
from tests.unit.planners.motion.two_arms_scene import MAX_ACCELERATION, MAX_VELOCITY, Referee, bases

STEP_S = 0.02
LIMITS = MAX_VELOCITY, MAX_ACCELERATION
REST = np.array([0.9, -0.3, 0.0, -2.0, 0.0, 1.2, 0.0])
OVER_TRAY = np.array([0.0, 0.45, 0.0, -1.5, 0.0, 1.2, 0.0])
FLOOR = Boxes.one((0.0, 0.0, -0.05), (2.0, 2.0, 0.05), min_frame=2)


@pytest.fixture(scope="module")
def trips(iiwa):  # type: ignore[no-untyped-def]
    return tuple(
        Trip(
            arm=ArmInWorld(iiwa, base),
            checker=CollisionChecker(iiwa, FLOOR),
            max_velocity=MAX_VELOCITY,
            max_acceleration=MAX_ACCELERATION,
            start=REST,
            stops=[OVER_TRAY[None], REST[None]],
            dwell_s=0.4,
        )
        for base in bases()
    )


def _visits(trips, obstacles):  # type: ignore[no-untyped-def]
    return [
        Stay(
            arm=trip.arm,
            checker=CollisionChecker(trip.checker.model, obstacles),
            max_velocity=MAX_VELOCITY,
            max_acceleration=MAX_ACCELERATION,
            start=trip.start,
            place=trip.stops[0],
            beyond=trip.stops[1],
            stay_s=trip.dwell_s,
        )
        for trip in trips
    ]


def _plain_paths():  # type: ignore[no-untyped-def]
    segments = [
        asynchronous(REST, OVER_TRAY, *LIMITS, 0.01, late=True),
        Dwell(duration_s=0.4),
        asynchronous(OVER_TRAY, REST, *LIMITS, 0.01),
    ]
    return timed_path(segments, STEP_S), timed_path(segments, STEP_S)


def test_hulls_find_a_shorter_delay_than_covers_by_spheres(trips):  # type: ignore[no-untyped-def]
    arms, paths = tuple(trip.arm for trip in trips), _plain_paths()
    free = free_cells(*(swept(arm, path) for arm, path in zip(arms, paths, strict=True)))
    k, m = free.shape

    def covered(delay: int) -> bool:
        steps = np.arange(max(k, m + delay))
        return bool(np.all(free[np.minimum(steps, k - 1), np.clip(steps - delay, 0, m - 1)]))

    def delay_of(margin_m: float) -> int:
        found = in_turn(arms, paths, range(k), margin_m)
        assert found.solved
        return int(np.argmax(found.index[:, 1] > 0)) - 1

    assert 10 < delay_of(0.01) < next(delay for delay in range(k) if covered(delay))
    assert delay_of(0.01) <= delay_of(0.05) < delay_of(0.2)
    assert not in_turn(arms, paths, range(delay_of(0.01))).solved
    with pytest.raises(PlanningError, match="margin_m -1"):
        in_turn(arms, paths, range(3), -1.0)


@pytest.mark.parametrize("margin_m", [0.01, 0.05])
def test_the_least_delay_keeps_the_distance_by_the_meshes_and_no_more(trips, margin_m):  # type: ignore[no-untyped-def]
    arms, paths = tuple(trip.arm for trip in trips), _plain_paths()
    found = in_turn(arms, paths, range(200), margin_m)
    referee = Referee()

    def least_m(late_s: float) -> float:
        times = np.arange(0.0, found.makespan_s, 0.005)
        return min(
            referee.distance_m(
                *(path.at(max(0.0, t - late)) for path, late in zip(paths, (0.0, late_s), strict=True)), 0.3
            )
            for t in times
        )

    delay_s = (int(np.argmax(found.index[:, 1] > 0)) - 1) * STEP_S
    assert least_m(delay_s) > margin_m - 0.002  # the engine's distances are a little less than the hulls'
    assert least_m(delay_s - 2 * STEP_S) < margin_m
    referee.close()


def test_arms_that_push_exchange_places_sooner_and_apart(trips):  # type: ignore[no-untyped-def]
    both = plan_together(trips, RrtConnectNative())
    assert both.way is Way.DECOUPLED
    assert both.found is not None
    arms = trips[0].arm, trips[1].arm
    assert both.found.makespan_s < in_turn(arms, _plain_paths(), range(200)).makespan_s - 0.02
    for trip, path in zip(trips, both.paths, strict=True):
        assert trip.checker.path_free(path.q)
    referee = Referee()
    for t in np.arange(0.0, both.found.makespan_s, 0.01):
        pair = [path.at(both.found.along_s(arm, t)) for arm, path in enumerate(both.paths)]
        assert referee.distance_m(*pair) > 0.005
    referee.close()
    again = plan_together(trips, RrtConnectNative())
    assert [path.q.tobytes() for path in again.paths] == [path.q.tobytes() for path in both.paths]


def test_legs_keep_clear_of_posts_or_there_is_no_exchange(trips):  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(0)
    outcomes = []
    for _ in range(30):
        centre = *rng.uniform((0.2, -0.6), (0.8, 0.8)), rng.uniform(0.3, 0.9)
        posts = Boxes.join(FLOOR, Boxes.one(centre, rng.uniform(0.02, 0.08, 3)))
        visits = _visits(trips, posts)
        found = exchange(visits, 0.01, 0.01)
        outcomes.append(found is not None)
        if found is not None:
            for visit, segments in zip(visits, found.segments, strict=True):
                assert all(visit.checker.with_margin(0.0).path_free(segment.q) for segment in segments)
    assert 5 < sum(outcomes) < 30


def test_further_stops_follow_an_exchange(trips):  # type: ignore[no-untyped-def]
    longer = tuple(replace(trip, stops=[*trip.stops, REST[None] + 0.2]) for trip in trips)
    both = plan_together(longer, RrtConnectNative())
    assert both.found is not None
    for path in both.paths:
        np.testing.assert_allclose(path.q[-1], REST + 0.2)
        assert len(path.segments) == 5
