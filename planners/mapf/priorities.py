"""Priorities that outlive a window: they grow until the goal is reached, and faster where only others can help."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.mapf.problem import BoolArray, IntArray

_DEAD_END_HASTE = 10.0


class Priorities:
    """Priority of each agent over a lifelong run.

    An agent gains 1 with each timestep away from its goal and falls back to its own fraction of 1 when it is there.
    In a dead end it gains 10 more: whoever waits outside for its cell cannot help it, but it can push its way out.

    Args:
        graph: Lane graph.
        n: Number of agents.
        seed: Seed of the fractions, which order agents that have waited equally long.

    Source: Okumura et al., "Priority Inheritance with Backtracking for Iterative Multi-agent Path Finding", Artificial
    Intelligence 310, 2022, section 4.2 (growth until the goal); the League of Robot Runners' start kit (dead ends).
    """

    def __init__(self, graph: LaneGraph, n: int, *, seed: int | np.random.Generator = 0) -> None:
        self._state_cell = graph.state_cell
        self._gain = np.where(dead_ends(graph), 1.0 + _DEAD_END_HASTE, 1.0)
        self._fraction = np.random.default_rng(seed).random(n)
        self.values: npt.NDArray[np.float64] = self._fraction.copy()
        """Larger goes first, shape (n,)."""

    def order(self) -> IntArray:
        """Agents, the one that chooses first in front, shape (n,)."""
        return np.argsort(-self.values, kind="stable").astype(np.int32)

    def advance(self, states: IntArray, goals: IntArray) -> None:
        """Count one timestep that has brought the agents to these states, each array of shape (n,)."""
        gained = self.values + self._gain[self._state_cell[states]]
        self.values = np.where((states == goals) | (goals < 0), self._fraction, gained)


def dead_ends(graph: LaneGraph) -> BoolArray:
    """Cells on ways that lead nowhere else, shape (n_cells,): what is left over when cells with one neighbour go.

    A cell that no vehicle can stand in is none.
    """
    ends = np.column_stack((graph.state_cell[graph.move_from], graph.state_cell[graph.move_to]))
    ends = np.unique(np.sort(ends[ends[:, 0] != ends[:, 1]], axis=1), axis=0)
    alive = np.zeros(graph.n_cells, dtype=np.bool_)
    alive[graph.state_cell] = True
    dead = np.zeros(graph.n_cells, dtype=np.bool_)
    while True:
        peeled = alive & ~dead & (np.bincount(ends.ravel(), minlength=graph.n_cells) <= 1)
        if not peeled.any():
            return dead
        dead |= peeled
        ends = ends[~dead[ends].any(axis=1)]
