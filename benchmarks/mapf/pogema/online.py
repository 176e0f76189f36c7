"""Window search as POGEMA asks it: one timestep at a time, with costs learnt beforehand for the map."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from benchmarks.mapf.pogema.episode import Floor
from benchmarks.mapf.pogema.play import drive
from maps.lane_graph import LaneGraph
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step.goal_costs import GoalCosts, left
from planners.mapf.multi_step.guidance import UNIT, Errands, GuidanceConfig, learn_guidance
from planners.mapf.multi_step.multi_step_kernel import Wishes
from planners.mapf.multi_step.priorities import NearestFirst
from planners.mapf.window_search.steady_plan import SteadyPlan
from planners.mapf.window_search.window_search import WindowSearchConfig

LEARNING_STEPS = 150
"""Timesteps of a round of learning."""
TRIAL_STEPS = 256
"""Timesteps of the drive that decides how strong guidance shall be."""
STRENGTHS = (0.0, 0.125, 0.25, 0.5, 1.0)
"""Shares of what guidance adds to the costs of moves. It is learnt from PIBT, which needs more of it than a planner
that looks farther; on a map with much room none is best."""


class WindowPlanner:
    """Window search; among those who get nowhere, who has least to go may push first, before that who is in a pocket.

    Args:
        graph: Lane graph, of pebbles.
        move_cost: Cost of each move, shape (n_moves,).
        n: Number of agents.
        costs: Costs to goals with these moves; None = made here.
        config: Settings.
        seed: Seed of the choices.
    """

    def __init__(
        self,
        graph: LaneGraph,
        move_cost: IntArray,
        n: int,
        *,
        costs: GoalCosts | None = None,
        config: WindowSearchConfig | None = None,
        seed: int | np.random.Generator = 0,
    ) -> None:
        self._graph = graph
        self._config = WindowSearchConfig() if config is None else config
        self._costs = GoalCosts(graph, graph, move_cost=move_cost) if costs is None else costs
        self._plan = SteadyPlan(
            graph,
            np.zeros(graph.n_cells, dtype=np.bool_),
            n,
            window=self._config.window,
            move_cost=move_cost,
            unit=UNIT,
            seed=seed,
        )
        self._order = NearestFirst(graph)

    def step(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        """Decide a timestep; see `OnlinePlanner`."""
        costs = self._costs
        row, next_row = costs.rows(goals), costs.rows(next_goals)
        onward = left(costs.costs, self._graph.state_index[goals, 0], next_row)
        self._plan.begin(states)
        return self._plan.step(
            costs.costs.table,
            Wishes(row=row, cell=goals, next_row=next_row, onward=onward),
            self._order.of(states, left(costs.costs, states, row)),
            nodes=self._config.nodes,
            allow_rotation=True,
        )


def learnt_costs(floor: Floor, graph: LaneGraph, n: int, *, rounds: int, seed: int) -> IntArray:
    """Costs of moves on a map: guidance that a fleet has learnt on it, as strong as serves this planner best there.

    The fleet starts anywhere and is sent to the goals of the map alike; it does not know the episodes.

    Args:
        floor: The map.
        graph: Its lane graph, of pebbles.
        n: Number of robots.
        rounds: Rounds of learning.
        seed: Seed of its draws.

    Returns:
        Cost of each move, shape (n_moves,).
    """
    rng = np.random.default_rng(seed)
    starts, goals = anywhere(floor, graph, n, rng)
    costs = GoalCosts(graph, graph)
    learnt = guide(graph, costs, starts, goals, rounds=rounds, rng=rng)

    trial_seed = int(rng.integers(2**32))
    best, most = learnt, -1
    for strength in STRENGTHS:
        move_cost = np.round(UNIT + strength * (learnt - UNIT)).astype(np.int32)
        costs.weigh(move_cost)
        planner = WindowPlanner(graph, move_cost, len(starts), costs=costs, seed=trial_seed)
        streams = [_drawn(goals, one) for one in np.random.default_rng(trial_seed).spawn(len(starts))]
        n_done = int(drive(planner, graph, starts, streams, steps=TRIAL_STEPS).finished.sum())
        if n_done > most:
            best, most = move_cost, n_done
    return best


def anywhere(
    floor: Floor, graph: LaneGraph, n: int, rng: np.random.Generator
) -> tuple[IntArray, npt.NDArray[np.int32]]:
    """States of up to `n` robots anywhere in the largest part of a map, and the goal cells there."""
    main = np.bincount(floor.parts[floor.parts >= 0]).argmax()
    goals = floor.goals[floor.parts[floor.goals] == main].astype(np.int32)
    room = np.flatnonzero(floor.parts == main)
    return graph.state_index[rng.permutation(room)[: min(n, len(room))], 0], goals


def guide(
    graph: LaneGraph, costs: GoalCosts, starts: IntArray, goals: IntArray, *, rounds: int, rng: np.random.Generator
) -> IntArray:
    """Guidance that robots learn who are sent to goals alike, shape (n_moves,); `costs` hold it."""
    errands = Errands(ptr=np.arange(len(goals) + 1, dtype=np.int32), cell=goals)
    config = GuidanceConfig(candidates=1, rounds=rounds, timesteps=LEARNING_STEPS, memory=0.7)
    return learn_guidance(graph, costs, starts, errands, config=config, seed=rng)


def _drawn(goals: npt.NDArray[np.int32], rng: np.random.Generator) -> Iterator[int]:
    """Goals drawn at random, without end."""
    while True:
        yield int(goals[rng.integers(len(goals))])
