"""Floors to learn on: random obstacles, mazes and racks, with costs of moves that a fleet has learnt or with none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.mapf.drawn import largest_part
from benchmarks.mapf.pogema.episode import Episode, Floor
from benchmarks.mapf.pogema.online import anywhere, guide
from fleet.arrays import BoolArray
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step.goal_costs import GoalCosts
from planners.mapf.multi_step.guidance import UNIT

_MOST_AGENTS = 220
_GUIDED = 0.6
"""Share of floors with guidance."""
_ROUNDS = 8
"""Rounds in which it is learnt."""
_STRENGTHS = (0.25, 0.5, 1.0)
"""Shares of what guidance adds to the costs of moves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lesson:
    """A floor, its fleet, and what moves cost."""

    episode: Episode
    graph: LaneGraph
    move_cost: IntArray
    costs: GoalCosts


def draw_lesson(seed: int) -> Lesson:
    """Draw a floor of 14 to 45 cells a side and a fleet on 6 to 40 % of its cells.

    Args:
        seed: Seed of everything.
    """
    rng = np.random.default_rng([77, seed])
    shape = (_scattered, _maze, _racks)[seed % 3]
    free = largest_part(shape(rng))
    lines = tuple("".join(".#"[not cell] for cell in row) for row in free)
    floor = Floor(f"floor_{seed}", lines)
    share = rng.uniform(0.06, 0.33 if shape is _maze else 0.40)
    n = int(np.clip(share * free.sum(), 8, min(_MOST_AGENTS, free.sum() // 2)))
    graph = grid_lane_graph(floor.grid, "pebble")
    move_cost = np.full(graph.n_moves, UNIT, dtype=np.int32)
    if rng.random() < _GUIDED:
        learnt = guide_on(floor, graph, n, rng)
        move_cost = np.round(UNIT + rng.choice(_STRENGTHS) * (learnt - UNIT)).astype(np.int32)
    return Lesson(
        episode=Episode(floor, n, seed=seed),
        graph=graph,
        move_cost=move_cost,
        costs=GoalCosts(graph, graph, move_cost=move_cost),
    )


def guide_on(floor: Floor, graph: LaneGraph, n: int, rng: np.random.Generator) -> IntArray:
    """Guidance that a fleet learns on a floor, which it does not know the episodes of, shape (n_moves,)."""
    starts, goals = anywhere(floor, graph, n, rng)
    return guide(graph, GoalCosts(graph, graph), starts, goals, rounds=_ROUNDS, rng=rng)


def _scattered(rng: np.random.Generator) -> BoolArray:
    """Free cells, the others at random."""
    rows, cols = rng.integers(14, 30, size=2)
    free: BoolArray = rng.random((rows, cols)) > rng.uniform(0.05, 0.32)
    return free


def _maze(rng: np.random.Generator) -> BoolArray:
    """Free cells of a maze, dug depth-first, whose walls are taken away here and there."""
    rows, cols = 2 * rng.integers(7, 14, size=2) + 1
    free = np.zeros((rows, cols), dtype=np.bool_)
    free[1, 1] = True
    way = [(1, 1)]
    while way:
        row, col = way[-1]
        ahead = [
            (row + down, col + right)
            for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0))
            if 0 < row + 2 * down < rows and 0 < col + 2 * right < cols and not free[row + 2 * down, col + 2 * right]
        ]
        if not ahead:
            way.pop()
            continue
        wall_row, wall_col = ahead[rng.integers(len(ahead))]
        way.append((2 * wall_row - row, 2 * wall_col - col))
        free[wall_row, wall_col] = free[way[-1]] = True
    taken: BoolArray = np.asarray(rng.random(free.shape) < rng.uniform(0.05, 0.5))
    free[1:-1, 1:-1] |= taken[1:-1, 1:-1]
    if rng.random() < 0.5:
        free[[0, -1]] = free[:, [0, -1]] = True
    return free


def _racks(rng: np.random.Generator) -> BoolArray:
    """Free cells between racks, with aisles of one or two cells."""
    aisle, cross = int(rng.choice([1, 1, 1, 2])), int(rng.choice([1, 1, 2, 3]))
    length, depth, side = int(rng.integers(3, 11)), int(rng.choice([1, 2, 2, 3])), int(rng.integers(1, 5))
    rows, cols = int(rng.integers(16, 34)), int(rng.integers(18, 46))
    free = np.ones((rows, cols), dtype=np.bool_)
    for top in range(aisle, rows - aisle, depth + aisle):
        for left in range(side, cols - side, length + cross):
            free[top : min(top + depth, rows - aisle), left : min(left + length, cols - side)] = False
    return free
