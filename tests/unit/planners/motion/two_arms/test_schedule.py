"""Schedules of arms in one workspace against brute force, and against a referee of its own."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from planners.errors import PlanningError
from planners.motion.arm.kinematics import link_frames
from planners.motion.collision.collision import Boxes, CollisionChecker
from planners.motion.path.timed_path import Dwell, TimedPath, timed_path
from planners.motion.path.trajectory import Trajectory, retime
from planners.motion.search.rrt_connect_native import RrtConnectNative
from planners.motion.status import MotionStatus
from planners.motion.two_arms.composite import CompositePlanner, CompositeProblem
from planners.motion.two_arms.diagram import free_cells
from planners.motion.two_arms.schedule import schedule, schedule_in
from planners.motion.two_arms.swept import ArmInWorld, swept
from planners.motion.two_arms.together import Together, Trip, Way, plan_together
from tests.unit.planners.motion.two_arms_scene import MAX_ACCELERATION, MAX_VELOCITY, Referee, bases

STEP_S = 0.02
REST = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.2, 0.0])
OVER_TRAY = np.array([0.0, 0.45, 0.0, -1.5, 0.0, 1.2, 0.0])
TURN = np.array([0.3, 0, 0, 0, 0, 0, 0])


def _motion(*corners) -> Trajectory:  # type: ignore[no-untyped-def]
    return retime(np.array(corners), MAX_VELOCITY, MAX_ACCELERATION, dt_s=0.01)


def _delivery(side: float) -> TimedPath:
    """From the side over the tray, a rest there, and back to the side."""
    aside = REST + np.array([side, 0, 0, 0, 0, 0, 0])
    return timed_path(
        [_motion(aside, OVER_TRAY), Dwell(duration_s=0.4), _motion(OVER_TRAY, REST, aside)], step_s=STEP_S
    )


@pytest.fixture(scope="module")
def arms(iiwa):  # type: ignore[no-untyped-def]
    return tuple(ArmInWorld(iiwa, base) for base in bases())


@pytest.fixture(scope="module")
def paths() -> tuple[TimedPath, TimedPath]:
    return _delivery(1.0), _delivery(-1.2)


@pytest.fixture(scope="module")
def referee():  # type: ignore[no-untyped-def]
    referee = Referee()
    yield referee
    referee.close()


def test_samples_and_bounds_hold_the_motion_between_them(paths):  # type: ignore[no-untyped-def]
    path = paths[0]
    for number, segment in enumerate(path.segments):
        if isinstance(segment, Dwell):
            continue
        curve = CubicHermiteSpline(segment.t, segment.q, segment.qd)
        for t in np.arange(0.0, segment.duration_s, 0.0007):
            q = curve(t)
            sample = path.starts[number] + int(np.floor(t / STEP_S))
            half = int(np.floor(t / STEP_S * 2)) % 2
            ends = path.q[sample], path.between[sample], path.q[sample + 1]
            u = t / STEP_S * 2 - np.floor(t / STEP_S * 2)
            line = ends[half] + u * (ends[half + 1] - ends[half])
            assert np.all(np.abs(q - line) <= path.bow[sample] + 1e-12)
            np.testing.assert_allclose(path.at(path.starts[number] * STEP_S + t), q, atol=1e-9)


def test_an_arm_rests_only_where_its_legs_meet_and_while_it_dwells(paths):  # type: ignore[no-untyped-def]
    path = paths[0]
    begin, end = path.starts[1], path.starts[2]
    expected = np.zeros(len(path.q), dtype=bool)
    expected[[0, -1]] = True
    expected[begin : end + 1] = True
    np.testing.assert_array_equal(path.rests, expected)


def _touching_by_hand(arm, base, path, k):  # type: ignore[no-untyped-def]
    """Spheres of an arm at a sample: centres in the world and radii without the bounds."""
    frames = base @ link_frames(arm.base_from_joint, path.q[k])
    centre = np.array([(frames[f] @ [*c, 1.0])[:3] for f, c in zip(arm.sphere_frame, arm.sphere_centre, strict=True)])
    return centre, arm.sphere_radius


def test_diagram_matches_a_test_of_every_cell(iiwa, arms, paths):  # type: ignore[no-untyped-def]
    short = [timed_path(path.segments, step_s=0.15) for path in paths]
    covers = [swept(arm, path) for arm, path in zip(arms, short, strict=True)]
    free = free_cells(*covers, margin_m=0.013)
    assert 0.5 < free.mean() < 0.98
    n = len(iiwa.sphere_radius)
    for i, j in itertools.product(range(len(covers[0])), range(len(covers[1]))):
        gaps = np.linalg.norm(covers[0].centre[i, :n, None] - covers[1].centre[j, None, :n], axis=-1)
        gaps -= covers[0].radius[i, :n, None] + covers[1].radius[j, None, :n]
        assert free[i, j] == (gaps.min() >= 0.013)
    for base, cover, path in zip(bases(), covers, short, strict=True):
        for k in (0, 5, len(path.q) - 1):
            centre, radius = _touching_by_hand(iiwa, base, path, k)
            gap = np.linalg.norm(centre[:, None] - cover.centre[k, None, :n], axis=-1)
            np.testing.assert_allclose(gap.min(axis=1), 0.0, atol=1e-9)
            assert np.all(np.sort(cover.radius[k, :n]) >= np.sort(radius) - 1e-12)


def test_covers_hold_the_arm_half_a_step_around_each_sample(iiwa, arms, paths):  # type: ignore[no-untyped-def]
    path, cover = paths[0], swept(arms[0], paths[0])
    rng = np.random.default_rng(1)
    for time in rng.uniform(0.0, path.starts[1] * STEP_S, 200):
        k = int(np.floor(time / STEP_S + 0.5))
        frames = link_frames(iiwa.base_from_joint, path.at(time))
        order = np.argsort(iiwa.sphere_frame, kind="stable")
        for s, sphere in enumerate(order):
            centre = (frames[iiwa.sphere_frame[sphere]] @ [*iiwa.sphere_centre[sphere], 1.0])[:3]
            moved = np.linalg.norm(centre - cover.centre[k, s])
            assert moved + iiwa.sphere_radius[sphere] <= cover.radius[k, s] + 1e-9


def _brute_force(free, rests):  # type: ignore[no-untyped-def]
    """Fewest steps by breadth first search over sets of places; None if the end is never reached."""
    end = tuple(len(r) - 1 for r in rests)
    pairs = list(itertools.combinations(range(len(rests)), 2))
    level, seen, steps = {(0,) * len(rests)}, set(), 0
    while level:
        if end in level:
            return steps
        seen |= level
        following = set()
        for here in level:
            for move in itertools.product((0, 1), repeat=len(rests)):
                ahead = tuple(h + m for h, m in zip(here, move, strict=True))
                if any(a > e for a, e in zip(ahead, end, strict=True)):
                    continue
                if any(not m and h < e and not r[h] for m, h, e, r in zip(move, here, end, rests, strict=True)):
                    continue
                if all(table[ahead[i], ahead[j]] for table, (i, j) in zip(free, pairs, strict=True)):
                    following.add(ahead)
        level, steps = following - seen, steps + 1
    return None


@pytest.mark.parametrize("sizes", [(9, 7), (5, 4, 6), (3, 4, 3, 3)])
def test_schedules_are_the_shortest_there_are(sizes):  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(len(sizes))
    solved = 0
    for _ in range(60):
        rests = [rng.random(k) < 0.5 for k in sizes]
        free = [rng.random((sizes[i], sizes[j])) < 0.8 for i, j in itertools.combinations(range(len(sizes)), 2)]
        for table in free:
            table[0, 0] = table[-1, -1] = True
        found, expected = schedule_in(free, rests, STEP_S), _brute_force(free, rests)
        assert found.solved == (expected is not None)
        if expected is None:
            assert found.status is MotionStatus.NO_SOLUTION
            continue
        solved += 1
        assert len(found.index) - 1 == expected
        assert _is_valid(found.index, free, rests)
    assert solved > 10


def _is_valid(index, free, rests):  # type: ignore[no-untyped-def]
    ends = np.array([len(r) - 1 for r in rests])
    for before, after in itertools.pairwise(index):
        for arm, rest in enumerate(rests):
            if after[arm] - before[arm] not in (0, 1):
                return False
            if after[arm] == before[arm] and before[arm] < ends[arm] and not rest[before[arm]]:
                return False
    pairs = itertools.combinations(range(len(rests)), 2)
    apart = all(table[index[:, i], index[:, j]].all() for table, (i, j) in zip(free, pairs, strict=True))
    return apart and not index[0].any() and np.array_equal(index[-1], ends)


def test_two_arms_deliver_to_one_tray(arms, paths, referee):  # type: ignore[no-untyped-def]
    found = schedule(arms, paths)
    alone = [path.duration_s for path in paths]
    assert found.solved
    assert max(alone) < found.makespan_s < 0.8 * sum(alone)

    def motion(time_s: float):  # type: ignore[no-untyped-def]
        return tuple(path.at(found.along_s(arm, time_s)) for arm, path in enumerate(paths))

    times = np.arange(0.0, found.makespan_s, 0.005)
    assert referee.least_m(motion, times) > 0.01
    # The referee would notice: without the schedule the arms meet.
    assert referee.least_m(lambda t: tuple(path.at(t) for path in paths), times) < 0.0


def test_equal_queries_give_equal_bytes(arms, paths):  # type: ignore[no-untyped-def]
    again = tuple(timed_path(path.segments, STEP_S) for path in paths)
    assert schedule(arms, paths).index.tobytes() == schedule(arms, again).index.tobytes()


def test_arms_that_meet_at_an_end_or_cannot_pass_are_told_apart(arms, paths):  # type: ignore[no-untyped-def]
    out, in_ = _motion(OVER_TRAY, REST), _motion(REST, OVER_TRAY)
    leaves, comes = (timed_path(segments, STEP_S) for segments in ([out], [in_]))
    assert schedule(arms, (leaves, leaves)).status is MotionStatus.INVALID_START
    assert schedule(arms, (comes, comes)).status is MotionStatus.INVALID_GOAL
    assert schedule(arms, (leaves, comes)).solved
    assert schedule(arms, _exchange()).status is MotionStatus.NO_SOLUTION


def _exchange() -> tuple[TimedPath, TimedPath]:
    """Both arms are over the tray and change sides."""
    left, right = OVER_TRAY + TURN, OVER_TRAY - TURN
    return timed_path([_motion(left, right)], STEP_S), timed_path([_motion(left, right)], STEP_S)


def test_a_composite_plan_lets_arms_exchange_their_places(iiwa, arms, referee):  # type: ignore[no-untyped-def]
    paths = _exchange()
    free = CollisionChecker(iiwa, Boxes.one((0.0, 0.0, -0.05), (2.0, 2.0, 0.05), min_frame=2))
    problem = CompositeProblem(
        arms=arms,
        checkers=(free, free),
        start=np.concatenate([path.q[0] for path in paths]),
        goal=np.concatenate([path.q[-1] for path in paths]),
    )
    planner = CompositePlanner()
    result = planner.plan(problem)
    assert result.solved
    assert result.path.tobytes() == planner.plan(problem).path.tobytes()
    limits = np.tile(MAX_VELOCITY, 2), np.tile(MAX_ACCELERATION, 2)
    both = planner.timed(problem, result.path, *limits, dt_s=0.01)
    assert both is not None
    timed = [timed_path([trajectory], STEP_S) for trajectory in both]
    found = schedule(arms, timed, margin_m=0.0)
    assert found.makespan_s == pytest.approx(timed[0].duration_s)
    times = np.arange(0.0, found.makespan_s, 0.005)
    assert referee.least_m(lambda t: tuple(path.at(t) for path in timed), times) > 0.005


def test_a_composite_plan_says_why_there_is_none(iiwa, arms):  # type: ignore[no-untyped-def]
    free = CollisionChecker(iiwa, Boxes())
    apart, together = np.concatenate([REST, REST]), np.concatenate([OVER_TRAY, OVER_TRAY])

    def status(start, goal, iterations=0):  # type: ignore[no-untyped-def]
        return (
            CompositePlanner()
            .plan(CompositeProblem(arms=arms, checkers=(free, free), start=start, goal=goal, max_iterations=iterations))
            .status
        )

    swapped = np.concatenate([OVER_TRAY + TURN, OVER_TRAY + TURN]), np.concatenate([OVER_TRAY - TURN, OVER_TRAY - TURN])
    assert status(together, apart) is MotionStatus.INVALID_START
    assert status(apart, together) is MotionStatus.INVALID_GOAL
    assert status(*swapped) is MotionStatus.NO_SOLUTION
    with pytest.raises(PlanningError, match=r"start \(7,\)"):
        CompositeProblem(arms=arms, checkers=(free, free), start=REST, goal=apart)


FLOOR = Boxes.one((0.0, 0.0, -0.05), (2.0, 2.0, 0.05), min_frame=2)


def _trip(iiwa, arm, start, *stops, obstacles=FLOOR) -> Trip:  # type: ignore[no-untyped-def]
    return Trip(
        arm=arm,
        checker=CollisionChecker(iiwa, obstacles),
        max_velocity=MAX_VELOCITY,
        max_acceleration=MAX_ACCELERATION,
        start=start,
        stops=[stop[None] for stop in stops],
        dwell_s=0.2,
    )


def _played(both: Together):  # type: ignore[no-untyped-def]
    """Both arms at a time."""
    return lambda t: tuple(path.at(both.found.along_s(arm, t)) for arm, path in enumerate(both.paths))


def test_two_errands_get_the_cheapest_way_that_works(iiwa, arms, referee):  # type: ignore[no-untyped-def]
    planner = RrtConnectNative()
    aside = REST + 3 * TURN
    deliveries = tuple(_trip(iiwa, arm, aside, OVER_TRAY, REST) for arm in arms)
    exchange = tuple(_trip(iiwa, arm, OVER_TRAY + TURN, OVER_TRAY - TURN) for arm in arms)
    meeting = tuple(_trip(iiwa, arm, REST, OVER_TRAY) for arm in arms)
    # Both want to end at one place: no search finds what does not exist.
    for trips, way in ((deliveries, Way.DECOUPLED), (exchange, Way.COMPOSITE), (meeting, Way.NONE)):
        both = plan_together(trips, planner)
        assert both.way is way
        if both.found is None:
            continue
        assert referee.least_m(_played(both), np.arange(0.0, both.found.makespan_s, 0.01)) > 0.005
        again = plan_together(trips, planner).found
        assert again is not None
        assert again.index.tobytes() == both.found.index.tobytes()


@pytest.mark.parametrize("seed", [6, 10, 73, 126])
def test_motions_keep_clear_of_obstacles_beside_straight_lines(iiwa, arms, seed):  # type: ignore[no-untyped-def]
    # Posts where joints lead at their own pace (6, 10), and where corners lead that are cut widely (73, 126).
    rng = np.random.default_rng(seed)
    posts = [
        Boxes.one((*rng.uniform((0.2, 0.05), (0.6, 0.4)), rng.uniform(0.2, 0.9)), rng.uniform(0.02, 0.1, 3))
        for _ in range(4)
    ]
    obstacles = Boxes.join(FLOOR, *posts)
    aside = REST + 4 * TURN
    first = _trip(iiwa, arms[0], aside, OVER_TRAY, obstacles=obstacles)
    both = plan_together((first, _trip(iiwa, arms[1], REST, REST + TURN)), RrtConnectNative())
    assert both.way is Way.DECOUPLED
    assert CollisionChecker(iiwa, obstacles, margin=0.0).path_free(both.paths[0].q)


def test_bad_input_is_named(iiwa, arms, paths):  # type: ignore[no-untyped-def]
    with pytest.raises(PlanningError, match="segment 1 starts at"):
        timed_path([_motion(REST, OVER_TRAY), _motion(REST, OVER_TRAY)], STEP_S)
    with pytest.raises(PlanningError, match=r"step_s 0\.0"):
        timed_path([_motion(REST, OVER_TRAY)], 0.0)
    with pytest.raises(PlanningError, match="1 arms, 2 paths"):
        schedule(arms[:1], paths)
    with pytest.raises(PlanningError, match="margin_m -1"):
        schedule(arms, paths, margin_m=-1.0)
    with pytest.raises(PlanningError, match="valid: at most"):
        schedule_in([np.ones((9000, 9000), dtype=bool)], [np.ones(9000, dtype=bool)] * 2, STEP_S)
    with pytest.raises(PlanningError, match="world_from_base"):
        ArmInWorld(iiwa, np.full((4, 4), np.nan))
