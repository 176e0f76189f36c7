"""Lifelong runs on bare grids: every agent gets a new random goal when it has reached its own."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from benchmarks.harness import Trial
from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.mapf.distance_table import DistanceTable
from planners.mapf.multi_step.priorities import Priorities
from planners.mapf.pibt import Stepper
from planners.mapf.problem import Plan
from planners.mapf.validate import conflicts
from planners.status import Status


@dataclass(frozen=True, kw_only=True)
class LifelongRun:
    """What a run did and what it cost, in CPU time per timestep."""

    finished: npt.NDArray[np.int64]
    """Goals reached in each timestep, shape (steps,)."""
    step_s: float
    """The PIBT call alone [s]."""
    order_s: float
    """Priorities and their order [s]."""
    tables_s: float
    """Distances to new goals [s]."""

    @property
    def quarters(self) -> npt.NDArray[np.int64]:
        """Goals reached in each quarter of the run, shape (4,)."""
        return np.array([part.sum() for part in np.array_split(self.finished, 4)])


def run_lifelong(
    trial: Trial,
    grid: GridMap,
    n: int,
    *,
    steps: int,
    motion: Literal["pebble", "rotating"] = "pebble",
    allow_rotation: bool = True,
    seed: int = 0,
) -> LifelongRun:
    """Step `n` agents with PIBT; a goal is a cell, reached in whatever heading.

    Args:
        trial: Told what the referee finds wrong.
        grid: The floor.
        n: Number of agents, at most one per free cell.
        steps: Timesteps, at least 1; those before the last compilation are counted too.
        motion: Motion model.
        allow_rotation: Whether a closed ring of followers is legal.
        seed: Seed of starts, goals and tie-breaking.
    """
    graph = grid_lane_graph(grid, motion)
    rng = np.random.default_rng(seed)
    blocked = np.zeros(graph.n_cells, dtype=np.bool_)
    tables = DistanceTable(graph, blocked)
    stepper = Stepper(graph, blocked, seed=rng)
    priorities = Priorities(graph, n, seed=rng)
    locked = np.zeros(n, dtype=np.bool_)
    states = np.empty((steps + 1, n), dtype=np.int32)
    cells = rng.permutation(np.flatnonzero(grid.free))[:n]
    states[0] = _state_in(graph, cells, rng)
    goals = rng.integers(graph.n_states, size=n).astype(np.int32)
    finished = np.zeros(steps, dtype=np.int64)
    spent = np.zeros(3)
    distances, row = tables.rows(goals)
    for t in range(steps):
        begin = time.process_time()
        distances, row = tables.rows(goals)
        tables_end = time.process_time()
        order = priorities.order()
        order_end = time.process_time()
        stepper.step(
            states[t],
            states[t + 1],
            distances=distances,
            row=row,
            order=order,
            locked=locked,
            allow_rotation=allow_rotation,
        )
        step_end = time.process_time()
        there = graph.state_cell[states[t + 1]] == graph.state_cell[goals]
        priorities.advance(states[t + 1], np.where(there, states[t + 1], goals))
        spent += (step_end - order_end, order_end - tables_end + time.process_time() - step_end, tables_end - begin)
        finished[t] = np.count_nonzero(there)
        goals[there] = rng.integers(graph.n_states, size=finished[t])
    plan = Plan(states=states, status=Status.FEASIBLE, iterations=steps)
    wrong = conflicts(graph, plan, allow_rotation=allow_rotation)
    trial.check(not wrong, f"{n} agents, {motion}, seed {seed}: {len(wrong)} conflicts, first {wrong[:1]}")
    step_s, order_s, tables_s = (spent / steps).tolist()
    return LifelongRun(finished=finished, step_s=step_s, order_s=order_s, tables_s=tables_s)


def _state_in(graph: LaneGraph, cells: npt.NDArray[np.intp], rng: np.random.Generator) -> npt.NDArray[np.int32]:
    """A random state in each cell."""
    states = graph.state_index[cells]
    pick = np.argmax(np.where(states >= 0, rng.random(states.shape), -1.0), axis=1)
    chosen: npt.NDArray[np.int32] = states[np.arange(len(cells)), pick]
    return chosen
