"""Speed of PIBT: the call alone, and, on rows of their own, the order of the agents, new distances and start-up."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.mapf.instances import find_map
from benchmarks.mapf.lifelong import run_lifelong
from maps.lane_graph import grid_lane_graph
from planners.mapf.distance_table import DistanceTable

CASES = (
    ("random-32-32-20", 400, 1000, "<= 0.037"),
    ("warehouse_large", 1000, 500, "<= 0.17"),
    ("warehouse_large", 5000, 500, "<= 1.3"),
    ("warehouse_large", 10000, 500, "<= 3.1"),
)
"""Map, robots, timesteps, target for the PIBT call [ms]."""
QUICK_STEPS = 100
FILLED_GOALS = 1000

START = """
import time
import numba
begin = time.process_time()
import numpy as np
from maps.grid import GridMap
from maps.lane_graph import grid_lane_graph
from planners.mapf import PLANNERS
from planners.mapf.problem import Instance
graph = grid_lane_graph(GridMap(np.ones((9, 9), dtype=bool)), "pebble")
no, n = np.zeros(20, dtype=bool), np.arange(20)
instance = Instance(graph=graph, starts=n.astype(np.int32), goals=(80 - n).astype(np.int32), priorities=n * 1.0,
    stay=no, fixed=no, blocked=np.zeros(81, dtype=bool), allow_rotation=False, horizon=9)
PLANNERS["pibt"](seed=0).plan(instance)
print(time.process_time() - begin)
"""
"""What a process does from importing the planners to its first plan, above importing numba."""


def measure_pibt(trial: Trial) -> Iterable[Row]:
    """Pebble motion, a new random goal on arrival; CPU time."""
    yield from _calls(trial)
    yield from _tables(trial)
    yield from _start()


def _calls(trial: Trial) -> Iterable[Row]:
    for name, n, steps, target in CASES:
        grid = find_map(trial, name, what=f"PIBT call, {n} robots")
        if grid is None:
            continue
        run_lifelong(trial, grid, 10, steps=2)  # compiles
        run = run_lifelong(trial, grid, n, steps=QUICK_STEPS if trial.quick else steps, seed=trial.seeds[0])
        yield Row(
            name=f"PIBT call, {name}, {n} robots", value=1e3 * run.step_s, unit="ms CPU", kind=Kind.TIME, target=target
        )
        yield Row(name="  order of the agents", value=1e3 * run.order_s, unit="ms CPU", kind=Kind.TIME)
        yield Row(name="  distances to new goals", value=1e3 * run.tables_s, unit="ms CPU", kind=Kind.TIME)
        yield Row(name="  goals reached", value=int(run.finished.sum()), unit="")


def _tables(trial: Trial) -> Iterable[Row]:
    grid = find_map(trial, "warehouse_large", what="distances to 1,000 goals")
    if grid is None:
        return
    graph = grid_lane_graph(grid, "pebble")
    goals = np.random.default_rng(trial.seeds[0]).permutation(graph.n_states)[:FILLED_GOALS].astype(np.int32)
    tables = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_))
    tables.to(int(goals[0]))
    begin = time.process_time()
    distances, row = tables.rows(goals)
    spent = time.process_time() - begin
    trial.check(bool((distances[row, goals] == 0).all()), "a goal is not at distance 0 from itself")
    yield Row(
        name=f"distances to {FILLED_GOALS} goals, {graph.n_states} states",
        value=spent,
        unit="s CPU",
        kind=Kind.TIME,
        target="<= 1",
    )


def _start() -> Iterable[Row]:
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
        compiled, cached = (_start_s(environment) for _ in range(2))
    yield Row(
        name="first use, with compilation, above importing numba",
        value=compiled,
        unit="s CPU",
        kind=Kind.TIME,
        target="<= 4",
    )
    yield Row(
        name="first plan with cache, above importing numba", value=cached, unit="s CPU", kind=Kind.TIME, target="<= 0.6"
    )


def _start_s(environment: dict[str, str]) -> float:
    done = subprocess.run(
        [sys.executable, "-c", START],
        cwd=Path(__file__).resolve().parents[2],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    return float(done.stdout)
