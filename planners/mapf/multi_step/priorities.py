"""Priorities on floors with pockets: by what is left, or such as grow until the goal is reached."""

from __future__ import annotations

import numpy as np

from maps.lane_graph import LaneGraph
from planners.mapf.arrays import FloatArray, IntArray
from planners.mapf.multi_step.pockets import pocket_depth

_PER_BOTTLENECK = 10.0
"""Times that waiting counts more behind a bottleneck. With 3 some full floors froze, with 100 they worked less."""
_LONGEST = 50.0
"""What waiting comes to in the end, so that those inside need no longer to outrank those who have waited for ages."""
_DEEPEST = 200
"""Bottlenecks that count; beyond them the numbers would grow out of a float."""
_KEPT = 0.9
"""Share of its priority that an agent keeps with each timestep outside the pocket that it has left."""
_DEEPER = 2**20
"""More than any way costs, so that who is in a pocket goes before all who are not."""


class Priorities:
    """Priority of each agent over a lifelong run.

    Priority grows with the time since the agent was last at a goal, ever more slowly and to 50 at most; a fraction of
    its own breaks ties. In a pocket it counts tenfold for each bottleneck between the agent and the open floor, so that
    an agent inside soon outranks all who wait outside; else the first in front of a full pocket would stay there for
    ever, and nobody inside could make room. Whoever has left a pocket keeps its priority for a moment, so as not to be
    pushed back.

    Args:
        graph: Lane graph.
        n: Number of agents.
        seed: Seed of the fractions.

    Source: Okumura et al., "Priority Inheritance with Backtracking for Iterative Multi-agent Path Finding", Artificial
    Intelligence 310, 2022, section 4.2, https://doi.org/10.1016/j.artint.2022.103752 (growth until the goal). The
    start kit of the League of Robot Runners adds a constant in dead ends, which cures only those; pockets are our own.
    """

    def __init__(self, graph: LaneGraph, n: int, *, seed: int | np.random.Generator = 0) -> None:
        self._state_cell = graph.state_cell
        self._weight = _PER_BOTTLENECK ** np.minimum(pocket_depth(graph), _DEEPEST)
        self._fraction = np.random.default_rng(seed).random(n)
        self._waited = self._fraction.copy()
        self.values: FloatArray = self._fraction.copy()
        """Larger goes first, shape (n,)."""

    def order(self) -> IntArray:
        """Agents, the one that chooses first in front, shape (n,)."""
        return np.argsort(-self.values, kind="stable").astype(np.int32)

    def advance(self, states: IntArray, goals: IntArray) -> None:
        """Count one timestep that has brought the agents to these states, each array of shape (n,)."""
        there = (states == goals) | (goals < 0)
        self._waited = np.where(there, self._fraction, self._waited + 1.0)
        here = self._waited / (1.0 + self._waited / _LONGEST) * self._weight[self._state_cell[states]]
        self.values = np.where(there, self._fraction, np.maximum(here, _KEPT * self.values + (1.0 - _KEPT) * here))


class NearestFirst:
    """Order of the agents in which who has least to go is first, before that who is in a pocket.

    Args:
        graph: Lane graph.
    """

    def __init__(self, graph: LaneGraph) -> None:
        self._depth = pocket_depth(graph)[graph.state_cell]

    def of(self, states: IntArray, to_go: IntArray) -> IntArray:
        """Agents, the one that chooses first in front, shape (n,), by their states and what is left to them."""
        return np.argsort(to_go - self._depth[states] * _DEEPER, kind="stable").astype(np.int32)
