"""Random free configurations to random free configurations: the bare planner, as the published figures have it."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from benchmarks.arms import workcell
from benchmarks.harness import Kind, Row, Trial
from planners.motion import RrtConnect, RrtConnectNative
from planners.motion.collision.collision import CollisionChecker
from planners.motion.problem import MotionPlanner, MotionProblem

FloatArray = npt.NDArray[np.float64]

N_QUERIES, QUICK_QUERIES = 1_000, 60


def measure_free(trial: Trial) -> Iterable[Row]:
    """The native lane and OMPL's RRT-Connect on the same queries; shortening is part of both."""
    checker = workcell_checker()
    model = checker.model
    rng = np.random.default_rng(trial.seeds[0])
    q = rng.uniform(model.lower, model.upper, (200 + 4 * N_QUERIES, model.n_joints))
    ends = q[checker.batch(q)]
    n = QUICK_QUERIES if trial.quick else N_QUERIES
    native = RrtConnectNative()
    for name, planner, count, target in (("native lane", native, n, "<= 0.2"), ("OMPL", RrtConnect(), n // 4, "")):
        spent_ms, solved = run(trial, name, planner, checker, ends[: 2 * count])
        yield Row(
            name=f"free to free, {name}, median",
            value=float(np.median(spent_ms)),
            unit="ms",
            kind=Kind.TIME,
            target=target,
        )
        yield Row(name="  95th percentile", value=float(np.percentile(spent_ms, 95)), unit="ms", kind=Kind.TIME)
        yield Row(name=f"  solved of {count:,}", value=100 * solved / count, unit="%")


def workcell_checker() -> CollisionChecker:
    """The scene: no margin, as in the published figures."""
    return CollisionChecker(workcell.model(), workcell.boxes(), margin=0.0)


def query(checker: CollisionChecker, ends: FloatArray, k: int) -> MotionProblem:
    """From one row to the next."""
    return MotionProblem(checker=checker, start=ends[k], goals=ends[k + 1 : k + 2], seed=k)


def run(
    trial: Trial, name: str, planner: MotionPlanner, checker: CollisionChecker, ends: FloatArray
) -> tuple[list[float], int]:
    """Times of all queries [ms], and how many were solved."""
    planner.plan(query(checker, ends, 0))  # compiles
    spent_ms, solved = [], 0
    for k in range(0, len(ends), 2):
        problem = query(checker, ends, k)
        begin_s = time.process_time()
        result = planner.plan(problem)
        spent_ms.append(1e3 * (time.process_time() - begin_s))
        solved += result.solved
        trial.check(not result.solved or checker.path_free(result.path), f"{name}: query {k // 2}: the path collides")
    return spent_ms, solved
