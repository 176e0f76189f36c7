"""LaCAM* from start to goal: how soon there is a first plan, and how good the last one is."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from benchmarks.harness import Kind, Row, Trial
from benchmarks.mapf.instances import find, find_map
from maps.formats.movingai import read_map, starts_and_goals
from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.deadline import Deadline
from planners.mapf.distance_table import DistanceTable
from planners.mapf.lacam.lacam import Lacam, LacamConfig
from planners.mapf.metrics import lower_bound, sum_of_loss
from planners.mapf.problem import Instance, Plan
from planners.mapf.validate import breaches

Cells = npt.NDArray[np.int32]

HORIZON = 10_000
QUICK_S = 2.0


def measure_one_shot(trial: Trial) -> Iterable[Row]:
    """Pebble motion, closed rings legal, as in the programs compared with; wall time, tables included."""
    what = "one-shot, 400 robots"
    map_path = find(trial, "movingai/random-32-32-10.map", what=what)
    scenario = find(trial, "movingai/random-32-32-10-random-1.scen", what=what)
    if map_path is not None and scenario is not None:
        grid = read_map(map_path)
        starts, goals = starts_and_goals(scenario, grid, agents=400)
        yield from _rows(trial, "random-32-32-10", grid, starts, goals, first_s=0.3, budget_s=10.0, ratio=1.35)

    warehouse = find_map(trial, "warehouse_large", what="one-shot, 1,000 robots")
    if warehouse is not None:
        starts, goals = _drawn(warehouse, 1000, np.random.default_rng(trial.seeds[0]))
        yield from _rows(trial, "warehouse_large", warehouse, starts, goals, first_s=2.0, budget_s=20.0, ratio=1.02)


def _rows(
    trial: Trial,
    name: str,
    grid: GridMap,
    starts: Cells,
    goals: Cells,
    *,
    first_s: float,
    budget_s: float,
    ratio: float,
) -> Iterable[Row]:
    graph = grid_lane_graph(grid, "pebble")
    instance = _instance(graph, starts, goals)
    least = lower_bound(instance, DistanceTable(graph, instance.blocked))
    seed = trial.seeds[0]
    Lacam().plan(_instance(graph, starts[:200], goals[:200]), deadline=Deadline(500))  # compiles
    title = f"{name}, {len(starts)} robots"

    begin = time.perf_counter()
    first = Lacam(LacamConfig(refine=False, patience=0), seed=seed).plan(instance)
    elapsed_s = time.perf_counter() - begin
    _check(trial, instance, first, f"{title}, first plan")
    target = "" if trial.quick else f"<= {first_s}"
    yield Row(name=f"{title}: first plan", value=elapsed_s, unit="s", kind=Kind.TIME, target=target)
    yield Row(name="  sum of loss / lower bound", value=sum_of_loss(instance, first) / least, unit="")

    budget_s = QUICK_S if trial.quick else budget_s
    best = Lacam(seed=seed).plan(instance, deadline=Deadline(wall_s=budget_s))
    _check(trial, instance, best, f"{title}, plan after {budget_s:g} s")
    target = "" if trial.quick else f"<= {ratio}"
    yield Row(
        name=f"  after {budget_s:g} s: sum of loss / lower bound",
        value=sum_of_loss(instance, best) / least,
        unit="",
        target=target,
    )


def _check(trial: Trial, instance: Instance, plan: Plan, what: str) -> None:
    wrong = breaches(instance, plan)
    trial.check(not wrong, f"{what}: {len(wrong)} breaches, first {wrong[:1]}")
    away = int((plan.states[-1] != instance.goals).sum())
    trial.check(away == 0, f"{what}: {away} robots are not at their goals, status {plan.status}")


def _drawn(grid: GridMap, n: int, rng: np.random.Generator) -> tuple[Cells, Cells]:
    """Distinct random starts, and distinct random goals, all in the largest part of the floor that hangs together."""
    from scipy.ndimage import label

    region, _ = label(grid.free)
    cells = np.flatnonzero(region.ravel() == 1 + np.bincount(region[grid.free])[1:].argmax()).astype(np.int32)
    return rng.permutation(cells)[:n], rng.permutation(cells)[:n]


def _instance(graph: LaneGraph, starts: Cells, goals: Cells) -> Instance:
    n = len(starts)
    return Instance(
        graph=graph,
        starts=graph.state_index[starts, 0],
        goals=graph.state_index[goals, 0],
        priorities=np.zeros(n),
        stay=np.zeros(n, dtype=np.bool_),
        fixed=np.zeros(n, dtype=np.bool_),
        blocked=np.zeros(graph.n_cells, dtype=np.bool_),
        allow_rotation=True,
        horizon=HORIZON,
    )
