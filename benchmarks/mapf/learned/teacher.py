"""Teacher: what agents should do wherever a student has led them."""

from __future__ import annotations

import numpy as np

from benchmarks.mapf.learned.floors import Lesson
from benchmarks.mapf.learned.players import MultiStepPlayer
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step.goal_costs import left
from planners.mapf.multi_step.guidance import UNIT
from planners.mapf.multi_step.multi_step_kernel import Wishes
from planners.mapf.multi_step.priorities import NearestFirst
from planners.mapf.window_search.rolling_plan import RollingPlan

_WINDOW, _NODES = 12, 60_000
_ROUNDS = 20
_JAM = 0.15
"""Share of the agents that get nowhere in the whole window, from which on multi-step PIBT knows better."""
_SPELL = 8
"""Timesteps that it is asked for then."""


class Teacher:
    """Window search that begins anew in every state it is shown, and multi-step PIBT in jams.

    Args:
        lesson: The floor.
        seed: Seed of the choices.
    """

    def __init__(self, lesson: Lesson, *, seed: int) -> None:
        graph, n = lesson.graph, lesson.episode.n
        self._lesson, self._order = lesson, NearestFirst(graph)
        nobody = np.zeros(graph.n_cells, dtype=np.bool_)
        self._search = RollingPlan(
            graph, nobody, n, window=_WINDOW, move_cost=lesson.move_cost, unit=UNIT, seed=np.random.default_rng(seed)
        )
        self._pushing = MultiStepPlayer(graph, n, lesson.costs, rounds=_ROUNDS, seed=seed)
        self._jammed = 0

    def step(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        """Decide a timestep; see `OnlinePlanner`."""
        if self._jammed == 0:
            after = self._searched(states, goals, next_goals)
            if self._search.stuck_share <= _JAM:
                return after
            self._jammed = _SPELL
        self._jammed -= 1
        return self._pushing.step(states, goals, next_goals)

    def _searched(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        graph, costs = self._lesson.graph, self._lesson.costs
        row, next_row = costs.rows(goals), costs.rows(next_goals)
        onward = left(costs.costs, graph.state_index[goals, 0], next_row)
        self._search.begin(states)
        return self._search.step(
            costs.costs.table,
            Wishes(row=row, cell=goals, next_row=next_row, onward=onward),
            self._order.of(states, left(costs.costs, states, row)),
            nodes=_NODES,
            allow_rotation=True,
        )
