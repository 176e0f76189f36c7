"""Planners of this project as POGEMA asks them: one timestep at a time, with costs learnt beforehand for the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.mapf.pogema.episode import Floor
from maps.lane_graph import LaneGraph
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step.goal_costs import GoalCosts, left
from planners.mapf.multi_step.guidance import Errands, GuidanceConfig, learn_guidance
from planners.mapf.multi_step.multi_step_kernel import Wishes
from planners.mapf.multi_step.multi_step_pibt import Mover, rank_weights
from planners.mapf.multi_step.pockets import pocket_depth

_LEARNING_STEPS = 150
"""Timesteps of a round of learning."""
_DEEPER = 2**20
"""More than any way costs, so that who is in a pocket goes before all who are not."""


def learnt_costs(floor: Floor, graph: LaneGraph, n: int, *, rounds: int, seed: int) -> GoalCosts:
    """Costs to all goals of a map, with guidance that a fleet has learnt on it.

    The fleet starts anywhere and is sent to the goals of the map alike; it does not know the episodes.

    Args:
        floor: The map.
        graph: Its lane graph, of pebbles.
        n: Number of robots.
        rounds: Rounds of learning.
        seed: Seed of its draws.
    """
    costs = GoalCosts(graph, graph)
    rng = np.random.default_rng(seed)
    main = np.bincount(floor.parts[floor.parts >= 0]).argmax()
    goals = floor.goals[floor.parts[floor.goals] == main].astype(np.int32)
    room = np.flatnonzero(floor.parts == main)
    starts = graph.state_index[rng.permutation(room)[: min(n, len(room))], 0]
    errands = Errands(ptr=np.arange(len(goals) + 1, dtype=np.int32), cell=goals)
    config = GuidanceConfig(candidates=1, rounds=rounds, timesteps=_LEARNING_STEPS)
    learn_guidance(graph, costs, starts, errands, config=config, seed=rng)
    return costs


@dataclass(frozen=True, kw_only=True)
class MultiStepSettings:
    """Settings of `MultiStep`."""

    length: int = 3
    """Timesteps of an operation."""
    rounds: int = 5
    """Rounds of improvement in a timestep."""
    most_tries: int = 1000
    """Operations that a chain of pushes tries before it gives up."""


class MultiStep:
    """Multi-step PIBT; whoever has least to go chooses first, before that whoever is in a pocket.

    Args:
        graph: Lane graph.
        costs: Costs to goals.
        n: Number of agents.
        settings: Settings.
        seed: Seed of the tie-breaking.
    """

    def __init__(
        self, graph: LaneGraph, costs: GoalCosts, n: int, settings: MultiStepSettings | None = None, *, seed: int
    ) -> None:
        self._graph, self._costs = graph, costs
        self._settings = MultiStepSettings() if settings is None else settings
        self._mover = Mover(
            graph,
            np.zeros(graph.n_cells, dtype=np.bool_),
            n,
            length=self._settings.length,
            look=costs.look,
            dearest=costs.dearest,
            seed=seed,
        )
        self._depth = pocket_depth(graph)
        self._begun = False

    def step(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        """Decide a timestep; see `OnlinePlanner`."""
        if not self._begun:
            self._mover.begin(states)
            self._begun = True
        costs = self._costs
        row, next_row = costs.rows(goals), costs.rows(next_goals)
        onward = left(costs.costs, self._graph.state_index[goals, 0], next_row)
        sequence = np.argsort(
            left(costs.costs, states, row) - self._depth[self._graph.state_cell[states]] * _DEEPER, kind="stable"
        ).astype(np.int32)
        return self._mover.step(
            costs.costs,
            Wishes(row=row, cell=goals, next_row=next_row, onward=onward),
            sequence,
            weight=rank_weights(sequence),
            most_tries=self._settings.most_tries,
            allow_rotation=True,
            polish=lambda: True,
            rounds=self._settings.rounds,
        )
