"""Time of one exact matching on a large floor, from tables of distances that are there already to pairs."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from benchmarks.harness import Kind, Row, Trial
from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.allocation.hungarian import Hungarian
from planners.allocation.matching.prune import UNREACHABLE, nearest, travel_cost
from planners.allocation.matching.sparse_matching import match
from planners.allocation.problem import AllocationProblem
from planners.allocation.validate import faults
from planners.mapf.distance_table import DistanceTable
from planners.status import Status

Integers = npt.NDArray[np.int32]

FLOOR = (175, 180)
"""Rows and columns; racks of 2 x 5 cells between aisles leave 14,100 cells to drive on."""
CASES = ((200, 5000, "<= 30"), (1000, 20_000, "<= 300"))
"""Vehicles, tasks, target [ms CPU]."""
N_STATIONS = 100
PRUNED = 10_000
"""Vehicles and tasks of the largest case, each at a place of its own."""
N_NEAREST = 16
PRUNED_TARGET = "<= 4"
MOST_MS_PER_CELL = 3.0
"""Ageing: a task gets cheaper by up to so many cells."""
REPEATS, QUICK_REPEATS = 7, 3


def measure_matching(trial: Trial) -> Iterable[Row]:
    """Tasks at 100 stations, as in a warehouse, and at cells all over the floor, which no cache holds."""
    graph = _floor()
    rng = np.random.default_rng(trial.seeds[0])
    cells = rng.permutation(graph.n_states).astype(np.int32)
    tables = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_))
    distances, row = tables.rows(np.arange(graph.n_states, dtype=np.int32))
    yield Row(name="cells of the floor", value=graph.n_states, unit="")
    for n_vehicles, n_tasks, target in CASES:
        state = rng.choice(cells, n_vehicles, replace=False)
        for where, goals in (("stations", cells[:N_STATIONS]), ("cells", cells)):
            row_of = row[rng.choice(goals, n_tasks)]
            spent_ms = _match_ms(trial, distances, row_of, state, rng.uniform(0.0, MOST_MS_PER_CELL, n_tasks))
            yield Row(
                name=f"{n_vehicles:,} vehicles x {n_tasks:,} tasks at {len(goals):,} {where}",
                value=spent_ms,
                unit="ms CPU",
                kind=Kind.TIME,
                target=target if where == "stations" else "",
            )
    yield from _pruned(trial, distances, row[cells[:PRUNED]], rng.permutation(graph.n_states)[:PRUNED].astype(np.int32))


def _floor() -> LaneGraph:
    row, col = np.indices(FLOOR)
    return grid_lane_graph(GridMap((row % 3 == 0) | (col % 6 == 0)), "pebble")


def _match_ms(
    trial: Trial, distances: npt.NDArray[np.uint16], row: Integers, state: Integers, younger: npt.NDArray[np.float64]
) -> float:
    """Median over repetitions, into the same memory, as a dispatcher has it."""
    cost = np.zeros((len(state), len(row)))
    spent_s = []
    for _ in range(QUICK_REPEATS if trial.quick else REPEATS):
        begin_s = time.process_time()
        travel_cost(distances, row, state, cost)
        cost += younger
        problem = AllocationProblem(cost=cost)
        assignment = Hungarian().allocate(problem)
        spent_s.append(time.process_time() - begin_s)
        trial.check(faults(problem, assignment) == [], f"{len(state)} x {len(row)}: the assignment has faults")
        trial.check(assignment.status is Status.OPTIMAL, f"{len(state)} x {len(row)}: not proven to be optimal")
        trial.check(len(assignment.pairs) == len(state), f"{len(state)} x {len(row)}: a vehicle has no task")
    return 1e3 * float(np.median(spent_s[1:]))  # the first compiles, and writes to new memory


def _pruned(trial: Trial, distances: npt.NDArray[np.uint16], row: Integers, state: Integers) -> Iterable[Row]:
    match(nearest(distances, row[:8], state[:8], 2), 1.0)  # compiles
    begin_s = time.process_time()
    candidates = nearest(distances, row, state, N_NEAREST)
    task_of, _ = match(candidates, float(UNREACHABLE) * PRUNED)
    spent_s = time.process_time() - begin_s
    served = np.flatnonzero(task_of >= 0)
    pairs = np.column_stack((served, task_of[served]))
    size = f"{len(state):,} x {len(row):,}"
    taken = distances[row[pairs[:, 1]], state[pairs[:, 0]]]
    for axis, what in enumerate(("vehicle", "task")):
        trial.check(len(np.unique(pairs[:, axis])) == len(pairs), f"{size}: a {what} is in two pairs")
    trial.check(bool((taken < UNREACHABLE).all()), f"{size}: a pair has no way")
    yield Row(
        name=f"{size}, {N_NEAREST} nearest tasks each",
        value=spent_s,
        unit="s CPU",
        kind=Kind.TIME,
        target=PRUNED_TARGET,
    )
    yield Row(name="  vehicles without a task", value=len(state) - len(pairs), unit="")
    yield Row(name="  mean way", value=float(taken.mean()), unit="cells")
