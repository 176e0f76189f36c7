"""Open floor: cars without lanes, on published instances and our own, with a judge that is not ours.

Times are computing time. An instance of the published sets counts if its cars stand free at start and goal; the others,
which nobody can solve, are listed below the table with the reason.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.interop.others import package
from benchmarks.mapf.instances import INSTANCES
from maps.formats.clcbs import read_car_instance
from planners.deadline import Deadline
from planners.open_floor import (
    BENCHMARK_CAR,
    OpenFloorPlan,
    OpenFloorPlanner,
    OpenFloorProblem,
    breaches,
    generate_open_floor,
    illegal_poses,
)
from planners.open_floor.referee import corners_of
from planners.status import Status

SETS = (
    ("50x50, 20 cars", "clcbs/map50by50/agents20", 100),
    ("100x100, 40 cars", "clcbs/map100by100/agents40", 100),
    ("100x100, 50 cars", "clcbs/map100by100/agents50", 98),
)
"""Title, folder below the instances, and the least share that has to be solved [%]."""
CHECKS = 32
"""Poses of each step that the referees look at."""
_BUDGET_S = 10.0
_FEW = 6
"""Instances of a quick run."""
_DEPTH_M2 = 1e-6
"""Bodies that share less only touch [m^2]."""


@dataclass(frozen=True, kw_only=True)
class Solved:
    """What became of one problem."""

    plan: OpenFloorPlan
    cpu_s: float
    wrong: bool
    """The referee objects."""
    disputed: bool
    """The other judge does not say the same."""


def measure_open_floor(trial: Trial) -> Iterable[Row]:
    """Plan for all cars at once, again and again."""
    shapely = package("shapely", trial, "O5")
    OpenFloorPlanner().plan(generate_open_floor(50.0, 4, 4, seed=0))  # loads the kernels
    judged: list[Solved] = []
    for title, folder, least in SETS:
        found = [] if package("yaml", trial, f"O1 {title}") is None else _instances(folder, trial, f"O1 {title}")
        if not found:
            continue
        problems = [problem for problem in _legal(found, title, trial)]
        solved = [solve(problem, _BUDGET_S, shapely) for problem in problems[: _FEW if trial.quick else None]]
        judged += solved
        yield from _rows(f"O1 {title}", solved, least, median_s=0.15)
    for title, size_m, n_cars, n_discs, n_seeds, within_s, least in (
        ("O2 own, 50x50, 25 cars", 50.0, 25, 25, 60, 1.0, 95),
        ("O3 own, 100x100, 100 cars", 100.0, 100, 50, 12, 10.0, 50),
    ):
        seeds = range(n_seeds if not trial.quick else max(2, n_seeds // 10))
        own = (generate_open_floor(size_m, n_cars, n_discs, seed=seed) for seed in seeds)
        solved = [solve(problem, within_s, shapely) for problem in own]
        judged += solved
        yield from _rows(f"{title}, within {within_s:g} s", solved, least, median_s=None)
    legal = [one for one in judged if one.plan.status is Status.FEASIBLE]
    trial.check(not any(one.wrong for one in legal), f"{sum(one.wrong for one in legal)} plans that are not legal")
    yield Row(name="O1 plans with an overlap at 32 checks a step", value=sum(one.wrong for one in legal), unit="plans",
              target="<= 0")  # fmt: skip
    if shapely is not None:
        yield Row(name=f"O5 verdicts of shapely that differ, of {len(legal)}",
                  value=sum(one.disputed for one in legal), unit="plans", target="<= 0")  # fmt: skip


def solve(problem: OpenFloorProblem, budget_s: float, shapely: Any) -> Solved:
    """Plan and judge.

    Args:
        problem: What is to be planned.
        budget_s: Computing time.
        shapely: The other judge, if there is one.
    """
    begin = time.process_time()
    plan = OpenFloorPlanner().plan(problem, Deadline(wall_s=budget_s, clock=time.process_time))
    cpu_s = time.process_time() - begin
    if plan.status is not Status.FEASIBLE:
        return Solved(plan=plan, cpu_s=cpu_s, wrong=False, disputed=False)
    wrong = bool(breaches(problem, plan, checks=CHECKS))
    disputed = shapely is not None and wrong == legal_by_shapely(problem, plan, shapely)
    return Solved(plan=plan, cpu_s=cpu_s, wrong=wrong, disputed=disputed)


def legal_by_shapely(problem: OpenFloorProblem, plan: OpenFloorPlan, shapely: Any) -> bool:
    """Whether polygons of shapely find no body in another one, or in an obstacle, at any check of a plan."""
    times = np.arange(0, int(np.ceil(plan.makespan_s / plan.step_s * CHECKS)) + 1) * (plan.step_s / CHECKS)
    poses = np.stack([way.poses(times) for way in plan.ways if way is not None])
    bodies = shapely.polygons(corners_of(problem.car, poses))
    centres = shapely.points(problem.discs[:, :2])
    for body in bodies:
        near = shapely.STRtree(body)
        for centre, radius in zip(centres, problem.discs[:, 2], strict=True):
            if len(near.query(centre, predicate="dwithin", distance=radius - 1e-6)):
                return False
    for k in range(len(times)):
        first, second = shapely.STRtree(bodies[:, k]).query(bodies[:, k], predicate="intersects")
        pairs = first < second
        shared = shapely.area(shapely.intersection(bodies[first[pairs], k], bodies[second[pairs], k]))
        if (shared > _DEPTH_M2).any():
            return False
    return True


def _rows(title: str, solved: list[Solved], least: float, median_s: float | None) -> Iterator[Row]:
    done = [one for one in solved if one.plan.status is Status.FEASIBLE]
    share = 100.0 * len(done) / max(len(solved), 1)
    yield Row(name=f"{title}: solved of {len(solved)}", value=share, unit="%", target=f">= {least}")
    target = "" if median_s is None else f"<= {median_s}"
    times = [one.cpu_s for one in solved]
    yield Row(name=f"{title}: median", value=float(np.median(times)), unit="s", target=target, kind=Kind.TIME)
    yield Row(name=f"{title}: longest", value=max(times), unit="s", kind=Kind.TIME)


def _instances(folder: str, trial: Trial, what: str) -> list[Path]:
    """Files of a set, by number; with a note if there are none."""
    number: Callable[[Path], int] = lambda path: int(re.findall(r"\d+", path.stem)[-1])  # noqa: E731
    found = sorted((INSTANCES / folder).rglob("*obst[1-9]*.yaml"), key=number)
    if not found:
        trial.notes.append(f"{what}: left out, no instances {folder} in FLEET_INSTANCES={INSTANCES}")
    return found


def _legal(found: list[Path], title: str, trial: Trial) -> Iterator[OpenFloorProblem]:
    """The problems that can be solved, and a note on the others."""
    illegal = []
    for path in found:
        given = read_car_instance(path)
        problem = OpenFloorProblem(
            size_m=given.size_m, car=BENCHMARK_CAR, starts=given.starts, goals=given.goals, discs=given.discs
        )
        reasons = illegal_poses(problem)
        if reasons:
            illegal.append(f"{path.stem.rpartition('_')[2]} ({reasons[0]})")
        else:
            yield problem
    trial.notes.append(f"O1 {title}: {len(illegal)} of {len(found)} are illegal: {', '.join(illegal)}")
