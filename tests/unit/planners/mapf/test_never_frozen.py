"""A floor with hardly a free cell goes on working, whatever its pockets, docks and shared goals."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.mapf.distance_table import DistanceTable
from planners.mapf.multi_step.pockets import pocket_depth
from planners.mapf.multi_step.priorities import Priorities
from planners.mapf.pibt import Pibt
from planners.mapf.problem import Instance
from planners.mapf.validate import breaches
from tests.unit.planners.mapf.lanes import random_starts

STEPS = 1600


def cluttered(seed: int, side: int = 16) -> LaneGraph:
    """A fifth of the cells are obstacles; the largest connected part of the rest, with dead ends and pockets."""
    rng = np.random.default_rng(seed)
    free = rng.random((side, side)) > 0.2
    floor = nx.grid_2d_graph(side, side).subgraph([tuple(cell) for cell in np.argwhere(free)])
    largest = np.zeros_like(free)
    for cell in max(nx.connected_components(floor), key=len):
        largest[cell] = True
    return grid_lane_graph(GridMap(largest), "pebble")


def lifelong(graph: LaneGraph, n: int, *, allow_rotation: bool, goals_of: np.ndarray, seed: int = 0) -> np.ndarray:
    """Goals reached in each timestep, shape (STEPS,); each agent gets a new one at once, which others may have too."""
    rng = np.random.default_rng(seed)
    blocked = np.zeros(graph.n_cells, dtype=np.bool_)
    tables, planner, priorities = DistanceTable(graph, blocked), Pibt(seed=seed), Priorities(graph, n, seed=seed)
    states = np.array(random_starts(graph, n, rng), dtype=np.int32)
    goals = rng.choice(goals_of, size=n).astype(np.int32)
    reached = np.zeros(STEPS, dtype=np.int64)
    no = np.zeros(n, dtype=np.bool_)
    for step in range(STEPS):
        instance = Instance(
            graph=graph,
            starts=states,
            goals=goals,
            priorities=priorities.values,
            stay=no,
            fixed=no,
            blocked=blocked,
            allow_rotation=allow_rotation,
            horizon=1,
        )
        plan = planner.plan(instance, tables)
        if step % 200 == 0:
            assert breaches(instance, plan) == []
        states = plan.states[1]
        priorities.advance(states, goals)
        there = states == goals
        reached[step] = np.count_nonzero(there)
        goals = np.where(there, rng.choice(goals_of, size=n), goals).astype(np.int32)
    return reached


@pytest.mark.parametrize("allow_rotation", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_a_full_floor_with_pockets_never_freezes(seed: int, allow_rotation: bool) -> None:
    graph = cluttered(seed)
    assert pocket_depth(graph).max() >= 1
    n = round(0.9 * graph.n_states)
    reached = lifelong(graph, n, allow_rotation=allow_rotation, goals_of=np.arange(graph.n_states), seed=seed)
    quarters = reached.reshape(4, -1).sum(axis=1)
    assert quarters[3] >= 0.6 * quarters[0]


@pytest.mark.parametrize("allow_rotation", [True, False])
def test_docks_at_the_ends_of_pockets_that_many_share_never_freeze(allow_rotation: bool) -> None:
    """Everybody wants into the same few pockets."""
    graph = cluttered(1)
    depth = pocket_depth(graph)[graph.state_cell]
    docks = np.argsort(-depth, kind="stable")[:6]
    assert (depth[docks] >= 1).all()
    n = graph.n_states // 2
    reached = lifelong(graph, n, allow_rotation=allow_rotation, goals_of=docks)
    quarters = reached.reshape(4, -1).sum(axis=1)
    assert quarters[3] >= 0.6 * quarters[0] > 0
