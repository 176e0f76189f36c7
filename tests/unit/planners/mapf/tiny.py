"""Tiny problems by number, for planners that are held against exhaustion."""

from __future__ import annotations

import numpy as np

from maps.grid import GridMap
from maps.lane_graph import LaneGraph, build_lane_graph, grid_lane_graph
from maps.site import Site
from planners.mapf.problem import Instance
from tests.unit.planners.mapf.lanes import instance_of, king_grid, one_way_grid, one_way_loop, random_starts

_SIZES = [(2, 2), (2, 3), (3, 3), (1, 5), (2, 4), (3, 4)]
_FILL = {"pebble": 0.5, "rotating": 0.4}
"""Greatest share of the cells that agents start in; beyond it a search for the optimum can take minutes."""
MODELS = ("pebble", "rotating", "carlike", "diagonal")


def tiny_instance(model: str, number: int) -> Instance:
    """A problem with two to four agents on at most a dozen cells.

    Every third one allows rings, every fourth has an agent without a goal, every fifth one that never moves, every
    sixth a closed cell; about half of the agents stay at their goal once they are there.
    """
    rng = np.random.default_rng((MODELS.index(model), number))
    graph, n = _graph(model, rng)
    n_cells = len(set(graph.state_cell.tolist()))
    n = max(2, min(n, int(_FILL.get(model, 1.0) * n_cells)))
    starts, goals = random_starts(graph, n, rng), random_starts(graph, n, rng)
    fixed = [number % 5 == 0 and agent == 0 for agent in range(n)]
    if fixed[0]:
        goals = [starts[0], *goals][:n]
        fixed = fixed[: len(goals)]
    if number % 4 == 0:
        goals[-1] = -1
    used = set(graph.state_cell[[*starts, *goals]].tolist())
    closed = [cell for cell in set(graph.state_cell.tolist()) - used][:1] if number % 6 == 0 else []
    return instance_of(
        graph,
        starts[: len(goals)],
        goals,
        stay=(rng.random(len(goals)) < 0.5).tolist(),
        fixed=fixed,
        blocked=closed,
        allow_rotation=number % 3 == 0,
        horizon=1000,
    )


def _graph(model: str, rng: np.random.Generator) -> tuple[LaneGraph, int]:
    """A floor and how many agents it gets."""
    if model == "carlike":
        graph = _car_floor(rng)
        return graph, int(rng.integers(2, 5 if graph.n_states < 10 else 4))
    if model == "diagonal":
        return king_grid(*_SIZES[rng.integers(4)]), int(rng.integers(2, 4))
    rows, cols = _SIZES[rng.integers(6 if model == "pebble" else 4)]
    free = rng.random((rows, cols)) >= 0.15
    free[0, :2] = True
    return grid_lane_graph(GridMap(free), model), int(rng.integers(2, 5 if model == "pebble" else 4))


def _car_floor(rng: np.random.Generator) -> LaneGraph:
    """Lanes of one direction around a block, in rows that alternate, or of both directions; some allow reversing."""
    kind = rng.integers(3)
    if kind == 0:
        return one_way_loop(int(rng.integers(4, 9)))
    rows, cols = [(2, 2), (2, 4), (2, 3), (3, 3)][rng.integers(4)]
    if kind == 1:
        return one_way_grid(4, 2 * (cols // 2))
    lanes = [
        (cell, other)
        for cell in range(rows * cols)
        for other in (cell + 1, cell - 1, cell + cols, cell - cols)
        if 0 <= other < rows * cols and (cell // cols == other // cols or cell % cols == other % cols)
    ]
    nothing = np.zeros((rows, cols), dtype=np.bool_)
    site = Site(
        name="tiny",
        grid=GridMap(~nothing),
        walls=nothing,
        shelves=nothing,
        lanes=np.array(sorted(lanes), dtype=np.int32),
        stations=(),
        parking=(),
        chargers=(),
        cut_cells=(),
        allow_reverse=bool(rng.integers(2)),
        plan=(),
    )
    return build_lane_graph(site)
