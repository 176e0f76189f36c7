"""Together: paths and a schedule for two arms in one workspace, by the cheapest way that works."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion.collision import CollisionChecker
from planners.motion.composite import CompositePlanner, CompositeProblem
from planners.motion.coordination import MARGIN_M, ArmInWorld, Schedule, schedule
from planners.motion.problem import MotionPlanner, MotionProblem
from planners.motion.timed_path import Dwell, TimedPath, timed_path
from planners.motion.trajectory import Trajectory, retime

FloatArray = npt.NDArray[np.float64]

SAMPLE_S = 0.01
STEP_S = 0.02
"""Step of the coordination diagram: half of it changed makespans by 0.2 %, twice of it by 4 % [s]."""
TRIES_N = 4
"""Sets of paths for which a schedule is looked for."""


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
            raise PlanningError(f"Trip: {len(self.stops)} stops, dwell_s {self.dwell_s}; expected at least 1, and >= 0")


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


def plan_together(
    trips: tuple[Trip, Trip], planner: MotionPlanner, *, seed: int = 0, margin_m: float = MARGIN_M
) -> Together:
    """Plan two trips that begin at once.

    Each arm gets paths of its own, and the coordination diagram says who waits for whom. If there is no schedule, other
    paths are tried, and at last both arms are planned as one, which takes longer and needs trips of a single stop.

    Args:
        trips: One for each arm.
        planner: Plans the legs of single arms.
        seed: The same trips and seed give the same bytes.
        margin_m: Distance kept between the arms [m], >= 0.
    """
    arms = [trip.arm for trip in trips]
    for attempt in range(TRIES_N):
        legs = [_legs(trip, planner, seed + attempt) for trip in trips]
        if not all(legs):
            continue
        paths = tuple(timed_path(own, STEP_S) for own in legs)
        found = schedule(arms, paths, margin_m)
        if found.solved:
            return Together(way=Way.DECOUPLED, paths=paths, found=found)
    if all(len(trip.stops) == 1 for trip in trips):
        return _as_one(trips, seed, margin_m)
    return Together(way=Way.NONE, paths=(), found=None)


def _legs(trip: Trip, planner: MotionPlanner, seed: int) -> list[Trajectory | Dwell]:
    """One arm's motions; empty if a stop cannot be reached."""
    here = trip.start
    legs: list[Trajectory | Dwell] = []
    for goals in trip.stops:
        result = planner.plan(MotionProblem(checker=trip.checker, start=here, goals=goals, seed=seed))
        if not result.solved:
            return []
        legs.append(retime(result.path, trip.max_velocity, trip.max_acceleration, SAMPLE_S))
        legs.append(Dwell(duration_s=trip.dwell_s))
        here = result.path[-1]
    return legs[:-1]


def _as_one(trips: tuple[Trip, Trip], seed: int, margin_m: float) -> Together:
    """Both arms in one search, to the first pair of goals, nearest first, to which there is a way."""
    first, second = trips
    near = [e.stops[0][np.argsort(np.linalg.norm(e.stops[0] - e.start, axis=1), kind="stable")] for e in trips]
    pairs = sorted(
        ((i, j) for i in range(len(near[0])) for j in range(len(near[1]))), key=lambda pair: (sum(pair), pair)
    )
    velocity = np.concatenate([first.max_velocity, second.max_velocity])
    acceleration = np.concatenate([first.max_acceleration, second.max_acceleration])
    planner = CompositePlanner()
    for i, j in pairs[:TRIES_N]:
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
