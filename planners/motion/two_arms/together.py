"""Together: paths and a schedule for two arms in one workspace, by the cheapest way that works."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from planners.errors import PlanningError
from planners.motion.arrays import FloatArray
from planners.motion.collision.collision import CollisionChecker
from planners.motion.path.timed_path import Dwell, TimedPath, timed_path
from planners.motion.path.trajectory import Trajectory, retime
from planners.motion.problem import MotionPlanner, MotionProblem
from planners.motion.two_arms.asynchronous import asynchronous, least_times_s
from planners.motion.two_arms.composite import CompositePlanner, CompositeProblem
from planners.motion.two_arms.diagram import MARGIN_M, free_cells
from planners.motion.two_arms.exchange import Stay, exchange
from planners.motion.two_arms.schedule import Schedule, schedule, schedule_in
from planners.motion.two_arms.swept import ArmInWorld, SweptArm, at_rest, swept
from planners.motion.two_arms.turns import in_turn

SAMPLE_S = 0.01
STEP_S = 0.02
"""Step of the coordination diagram: half of it changed makespans by 0.2 %, twice of it by 4 % [s]."""
EXCHANGE_STEP_S = 0.005
"""The same for an exchange of places [s]."""
N_TRIED_SOONER = 16
"""Steps by which the second arm is tried to be sooner than an exchange promises."""
N_MOTIONS = 3
"""Motions of each arm that are tried with each other."""
CORNERS_RAD = (0.05, 0.02, 0.005)
"""How far corners of planned paths may be cut, largest first: the first that stays free is taken [rad]."""
CHECK_EVERY = 4
"""One of so many samples is a corner of what is checked: at 8 rad/s^2 no joint is 0.002 rad off it in between."""
N_NEAREST = 3
"""Goals of a stop that are tried without a search, soonest first."""
SHARED_RAD = 1.5
"""Two postures differ if a joint does by so much; other postures at a stop may leave the other arm more room. With 0.35
the others were too much alike: makespans were longer by 1 % [rad]."""
COARSE = 8
"""Pairs of motions are compared by diagrams with only one of so many samples."""
N_TRIES = 4
"""Pairs of motions for which a schedule is looked for, most promising first."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trip:
    """Where one arm is to go."""

    arm: ArmInWorld
    checker: CollisionChecker
    """The arm among its obstacles, holding what `arm` holds."""
    max_velocity: FloatArray
    """Joint limits [rad/s], shape (n,)."""
    max_acceleration: FloatArray
    """Joint limits [rad/s^2], shape (n,)."""
    start: FloatArray
    """Joint angles [rad], shape (n,)."""
    stops: Sequence[FloatArray]
    """Goals of each stop, any of which will do [rad], shapes (k, n); at least one stop."""
    dwell_s: float = 0.0
    """Rest at every stop but the last [s]."""

    def __post_init__(self) -> None:
        if not self.stops or not self.dwell_s >= 0:
            raise PlanningError(f"Trip: {len(self.stops)} stops, dwell_s {self.dwell_s}; valid: at least 1, and >= 0")


class Way(Enum):
    """How two trips were brought together."""

    DECOUPLED = "decoupled"
    """Each arm has its own path; a schedule says who waits."""
    COMPOSITE = "composite"
    """Both arms were planned as one."""
    NONE = "none"
    """No way was found."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Together:
    """Motions of two arms and their schedule."""

    way: Way
    paths: tuple[TimedPath, ...]
    """Motion of each arm; empty if there is no way."""
    found: Schedule | None
    """None if there is no way."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motion:
    """One arm's way through all its stops."""

    path: TimedPath
    cover: SweptArm
    coarse: SweptArm


def plan_together(
    trips: tuple[Trip, Trip], planner: MotionPlanner, *, seed: int = 0, margin_m: float = MARGIN_M
) -> Together:
    """Plan two trips that begin at once.

    Arms that meet at their first stops, and nowhere else, exchange places there as fast as they can. Otherwise each arm
    gets several motions, with other postures at the stops where the arms could meet. Coarse coordination diagrams tell
    which pair of motions promises the earliest end, the exact diagram of that pair who waits for whom. If there is no
    schedule, other pairs are tried, and at last both arms are planned as one, which takes longer and needs trips of a
    single stop.

    Args:
        trips: One for each arm.
        planner: Plans the segments of single arms.
        seed: The same trips and seed give the same bytes.
        margin_m: Distance kept between the arms [m], >= 0.
    """
    stops, shared = _meetings(trips)
    if all(own[0] and not any(own[1:]) and len(own) > 1 for own in shared):
        exchanged = _exchanged(trips, planner, seed, margin_m)
        if exchanged is not None:
            return exchanged
    motions = [_motions(trip, own, meets, planner, seed) for trip, own, meets in zip(trips, stops, shared, strict=True)]
    pairs = [(a, b) for a in motions[0] for b in motions[1]]
    promised = np.array([_coarse_steps(a, b, margin_m) for a, b in pairs])
    for k in np.argsort(promised, kind="stable")[:N_TRIES]:
        pair = pairs[k]
        found = _scheduled(pair[0].cover, pair[1].cover, margin_m)
        if found.solved:
            return Together(way=Way.DECOUPLED, paths=(pair[0].path, pair[1].path), found=found)
    if all(len(trip.stops) == 1 for trip in trips):
        return _as_one(trips, seed, margin_m)
    return Together(way=Way.NONE, paths=(), found=None)


def alone_s(trips: tuple[Trip, Trip], planner: MotionPlanner, *, seed: int = 0) -> tuple[float, ...]:
    """How long each arm would take at least if there were no other: the shortest of its motions [s].

    Args:
        trips: One for each arm.
        planner: Plans the segments of single arms.
        seed: As for `plan_together`.
    """
    stops, shared = _meetings(trips)
    return tuple(
        min((motion.path.duration_s for motion in _motions(trip, own, meets, planner, seed)), default=np.inf)
        for trip, own, meets in zip(trips, stops, shared, strict=True)
    )


def _exchanged(trips: tuple[Trip, Trip], planner: MotionPlanner, seed: int, margin_m: float) -> Together | None:
    """Both arms by way of an exchange at their first stops; None if there is none."""
    visits = [
        Stay(
            arm=trip.arm,
            checker=trip.checker,
            max_velocity=trip.max_velocity,
            max_acceleration=trip.max_acceleration,
            start=trip.start,
            place=trip.stops[0],
            beyond=trip.stops[1],
            stay_s=trip.dwell_s,
        )
        for trip in trips
    ]
    best = exchange(visits, margin_m, EXCHANGE_STEP_S)
    if best is None:
        return None
    paths = []
    for trip, (come, leave) in zip(trips, best.segments, strict=True):
        further = _segments(trip, leave.q[-1], trip.stops[2:], [False] * len(trip.stops[2:]), planner, seed)
        if further is None:
            return None
        paths.append(timed_path([come, Dwell(duration_s=trip.dwell_s), leave, *further], EXCHANGE_STEP_S))
    order = [best.first, 1 - best.first]
    (first, one), (second, other) = ((trips[k].arm, paths[k]) for k in order)
    soonest = one.starts[2] - other.starts[1] + round(best.gap_s / EXCHANGE_STEP_S)
    delays = range(max(0, soonest - N_TRIED_SOONER if best.gap_s > 0 else 0), len(one.q))
    found = in_turn((first, second), (one, other), delays, margin_m)
    if not found.solved:
        return None
    found = replace(found, index=np.ascontiguousarray(found.index[:, order]))
    return Together(way=Way.DECOUPLED, paths=tuple(paths), found=found)


def _meetings(trips: tuple[Trip, Trip]) -> tuple[tuple[list[FloatArray], ...], tuple[list[bool], ...]]:
    """Goals of each arm's stops, soonest first, and at which of its stops it could meet the other."""
    first, second = (_soonest_first(trip) for trip in trips)
    return (first, second), (_shared(trips[0], first, trips[1], second), _shared(trips[1], second, trips[0], first))


def _shared(trip: Trip, stops: Sequence[FloatArray], other: Trip, others: Sequence[FloatArray]) -> list[bool]:
    """At which stops the arm could meet the other at one of its; the goals of all are given soonest first."""
    return [any(not _apart(trip.arm, goals[0], other.arm, theirs[0]) for theirs in others) for goals in stops]


def _soonest_first(trip: Trip) -> list[FloatArray]:
    """Goals of each stop in the order of the time that going there and on to the next stop takes at least."""
    limits = trip.max_velocity, trip.max_acceleration
    ordered = []
    for k, goals in enumerate(trip.stops):
        time_s = least_times_s(goals, trip.stops[k - 1] if k > 0 else trip.start[None], *limits)
        if k + 1 < len(trip.stops):
            time_s += least_times_s(goals, trip.stops[k + 1], *limits)
        ordered.append(goals[np.argsort(time_s, kind="stable")])
    return ordered


def _motions(
    trip: Trip, stops: Sequence[FloatArray], shared: Sequence[bool], planner: MotionPlanner, seed: int
) -> list[_Motion]:
    """Different ways through all stops, whose goals are given soonest first; `shared` as `_shared` has it."""
    postures = [_different(goals) if meet else [] for goals, meet in zip(stops, shared, strict=True)]
    n = max(1, min(N_MOTIONS, max(len(own) for own in postures)))
    motions = []
    for k in range(n):
        # A stop that has no more postures begins with the first again.
        chosen = [own[k % len(own)][None] if own else goals for goals, own in zip(stops, postures, strict=True)]
        segments = _segments(trip, trip.start, chosen, shared, planner, seed + k)
        if segments is not None:
            path = timed_path(segments[1:], STEP_S)
            cover = swept(trip.arm, path)
            motions.append(_Motion(path=path, cover=cover, coarse=cover.thinned(COARSE)))
    return motions


def _apart(arm: ArmInWorld, q: FloatArray, other: ArmInWorld, theirs: FloatArray) -> bool:
    """Whether two arms at rest keep their distance."""
    return bool(free_cells(at_rest(arm, q), at_rest(other, theirs))[0, 0])


def _different(goals: FloatArray) -> list[FloatArray]:
    """The first goals that differ from all before, at most `N_MOTIONS`."""
    picked: list[FloatArray] = []
    for q in goals:
        if all(np.abs(q - other).max() > SHARED_RAD for other in picked):
            picked.append(q)
        if len(picked) == N_MOTIONS:
            break
    return picked


def _coarse_steps(a: _Motion, b: _Motion, margin_m: float) -> float:
    """Steps until both are done, by the coarse diagram; infinite if it has no way."""
    found = _scheduled(a.coarse, b.coarse, margin_m)
    return len(found.index) if found.solved else np.inf


def _scheduled(a: SweptArm, b: SweptArm, margin_m: float) -> Schedule:
    return schedule_in([free_cells(a, b, margin_m)], [a.rests, b.rests], STEP_S)


def _segments(
    trip: Trip,
    here: FloatArray,
    stops: Sequence[FloatArray],
    shared: Sequence[bool],
    planner: MotionPlanner,
    seed: int,
) -> list[Trajectory | Dwell] | None:
    """One arm's rest and motion to each of several stops in turn; None if one cannot be reached."""
    segments: list[Trajectory | Dwell] = []
    for goals, meets in zip(stops, shared, strict=True):
        segment = _straight_segment(trip, here, goals, late=meets) or _planned_segment(trip, here, goals, planner, seed)
        if segment is None:
            return None
        segments += [Dwell(duration_s=trip.dwell_s), segment]
        here = segment.q[-1]
    return segments


def _straight_segment(trip: Trip, start: FloatArray, goals: FloatArray, *, late: bool) -> Trajectory | None:
    """Every joint at its own pace to one of the soonest goals: none takes less time.

    Where the other arm comes, joints arrive late and leave early, so that neither waits longer than it must.
    """
    limits = trip.max_velocity, trip.max_acceleration
    time_s = least_times_s(goals, start[None], *limits)
    for row in np.argsort(time_s, kind="stable")[:N_NEAREST]:
        segment = asynchronous(start, goals[row], *limits, SAMPLE_S, late=late)
        if trip.checker.path_free(np.concatenate([segment.q[:-1:CHECK_EVERY], segment.q[-1:]])):
            return segment
    return None


def _planned_segment(
    trip: Trip, start: FloatArray, goals: FloatArray, planner: MotionPlanner, seed: int
) -> Trajectory | None:
    """A planned path; corners that are cut may use up the checker's margin, the obstacles themselves stay clear."""
    result = planner.plan(MotionProblem(checker=trip.checker, start=start, goals=goals, seed=seed))
    if not result.solved:
        return None
    limits = trip.max_velocity, trip.max_acceleration
    if len(result.path) == 2:
        return retime(result.path, *limits, SAMPLE_S)
    solid = trip.checker.with_margin(0.0)
    for deviation in CORNERS_RAD:
        segment = retime(result.path, *limits, SAMPLE_S, max_deviation_rad=deviation)
        if solid.path_free(segment.q):
            return segment
    return None


def _as_one(trips: tuple[Trip, Trip], seed: int, margin_m: float) -> Together:
    """Both arms in one search, to the first pair of goals, soonest first, to which there is a way."""
    first, second = trips
    near = [_soonest_first(trip)[0] for trip in trips]
    pairs = sorted(
        ((i, j) for i in range(len(near[0])) for j in range(len(near[1]))), key=lambda pair: (sum(pair), pair)
    )
    velocity = np.concatenate([first.max_velocity, second.max_velocity])
    acceleration = np.concatenate([first.max_acceleration, second.max_acceleration])
    planner = CompositePlanner()
    for i, j in pairs[:N_TRIES]:
        problem = CompositeProblem(
            arms=(first.arm, second.arm),
            checkers=(first.checker, second.checker),
            start=np.concatenate([first.start, second.start]),
            goal=np.concatenate([near[0][i], near[1][j]]),
            seed=seed,
            # Covers are wider than spheres: a search with more room leaves the schedule some.
            margin_m=2 * margin_m,
        )
        result = planner.plan(problem)
        motions = planner.timed(problem, result.path, velocity, acceleration, SAMPLE_S) if result.solved else None
        if motions is None:
            continue
        paths = tuple(timed_path([motion], STEP_S) for motion in motions)
        found = schedule([first.arm, second.arm], paths, margin_m)
        if found.solved:
            return Together(way=Way.COMPOSITE, paths=paths, found=found)
    return Together(way=Way.NONE, paths=(), found=None)
