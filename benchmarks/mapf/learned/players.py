"""Planners that play an episode one timestep after the other with the same costs: PIBT, multi-step and learned PIBT."""

from __future__ import annotations

import numpy as np

from benchmarks.mapf.learned.learned_pibt import LearnedPibtConfig
from benchmarks.mapf.learned.learned_stepper import LearnedStepper, Moment
from benchmarks.mapf.learned.scores import Scores
from maps.lane_graph import LaneGraph
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step.goal_costs import GoalCosts, left
from planners.mapf.multi_step.guidance import UNIT
from planners.mapf.multi_step.multi_step_kernel import wishes_to_stay
from planners.mapf.multi_step.multi_step_pibt import Mover, rank_weights
from planners.mapf.multi_step.priorities import NearestFirst, Priorities
from planners.mapf.multi_step.stagnation import Stagnation
from planners.mapf.pibt import Stepper


class PibtPlayer:
    """One-step PIBT with priorities that grow."""

    def __init__(self, graph: LaneGraph, n: int, costs: GoalCosts, *, seed: int) -> None:
        self._graph, self._costs = graph, costs
        self._stepper = Stepper(graph, np.zeros(graph.n_cells, dtype=np.bool_), seed=seed)
        self._priorities = Priorities(graph, n, seed=seed)
        self._locked = np.zeros(n, dtype=np.bool_)

    def step(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        """Decide a timestep; see `OnlinePlanner`."""
        del next_goals
        row = self._costs.rows(goals)
        after = np.empty_like(states)
        self._stepper.step(
            states,
            after,
            distances=self._costs.costs.table,
            row=row,
            order=self._priorities.order(),
            locked=self._locked,
            allow_rotation=True,
        )
        self._priorities.advance(after, self._graph.state_index[goals, 0])
        return after


class MultiStepPlayer:
    """Multi-step PIBT with rounds of improvement."""

    def __init__(self, graph: LaneGraph, n: int, costs: GoalCosts, *, rounds: int = 5, seed: int) -> None:
        nobody = np.zeros(graph.n_cells, dtype=np.bool_)
        self._costs, self._order, self._rounds = costs, NearestFirst(graph), rounds
        self._mover = Mover(graph, nobody, n, length=3, look=costs.look, dearest=costs.dearest, seed=seed)
        self._wishes = wishes_to_stay(np.full(n, -1, dtype=np.int32))
        self._expected = np.full(n, -1, dtype=np.int32)

    def step(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        """Decide a timestep; see `OnlinePlanner`. Operations are kept while the agents are where they were led."""
        del next_goals
        row = self._costs.rows(goals)
        sequence = self._order.of(states, left(self._costs.costs, states, row))
        if not np.array_equal(states, self._expected):
            self._mover.begin(states)
        self._expected = self._mover.step(
            self._costs.costs,
            self._wishes._replace(row=row),
            sequence,
            weight=rank_weights(sequence),
            most_tries=1000,
            allow_rotation=True,
            polish=lambda: True,
            rounds=self._rounds,
        )
        return self._expected


class LearnedPlayer:
    """PIBT that goes by learned scores."""

    def __init__(
        self,
        graph: LaneGraph,
        n: int,
        costs: GoalCosts,
        scores: Scores,
        *,
        patience: int = LearnedPibtConfig.patience,
        eagerness: float = LearnedPibtConfig.eagerness,
        seed: int,
    ) -> None:
        self._costs, self._order, self._stagnation = costs, NearestFirst(graph), Stagnation(n)
        self._patience, self._eagerness = patience, eagerness
        self._locked = np.zeros(n, dtype=np.bool_)
        self.stepper = LearnedStepper(graph, np.zeros(graph.n_cells, dtype=np.bool_), n, scores, seed=seed)

    def moment(self, states: IntArray, goals: IntArray) -> Moment:
        """What is asked of a timestep; counts it."""
        row = self._costs.rows(goals)
        to_go = left(self._costs.costs, states, row)
        return Moment(
            distances=self._costs.costs.table,
            row=row,
            order=self._order.of(states, to_go),
            waited=self._stagnation.look(to_go, goals),
            locked=self._locked,
            unit=UNIT,
            patience=self._patience,
            eagerness=self._eagerness,
            allow_rotation=True,
        )

    def step(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        """Decide a timestep; see `OnlinePlanner`."""
        del next_goals
        after = np.empty_like(states)
        self.stepper.step(states, after, self.moment(states, goals))
        return after
