"""Scripted policies of the traffic layer: every car on its shortest way, or all together by a planner."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.abstract.kernel import NONE
from fleet.envs.traffic.env import TrafficEnv
from planners.mapf import planner_named
from planners.mapf.distance_table import DistanceTable
from planners.mapf.problem import Instance


class ShortestWay:
    """Every car makes the move that brings it nearest to its goal, or waits if none does; blind to all others.

    Args:
        seed: Not used; every policy of the table takes one.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed

    def act(self, env: TrafficEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del observations
        view, place = env.view, env.place
        row = np.where(view.goal != NONE, place.goal_row[view.goal], NONE)
        ways = np.column_stack((view.state, place.move_to[view.state]))  # wait, then the moves
        left = place.floor.distance[row[:, None], ways].astype(np.int64)
        left[ways == NONE] = np.iinfo(np.int64).max
        best = left.argmin(axis=1)
        best[(row == NONE) | view.locked] = 0
        return dict(zip(env.possible_agents, best.tolist(), strict=True))


class PibtTraffic:
    """Priority inheritance with backtracking for all cars at once, as in any run, one timestep at a time.

    Args:
        seed: Not used: the tie-breaking is that of the environment, which then grants every wish.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed

    def act(self, env: TrafficEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del observations
        return _actions(env, env.view.proposed)


class PlannedTraffic:
    """A planner of `planners.mapf.PLANNERS`, asked for the next timestep in every step.

    Args:
        seed: Seed of the planner.
        planner: Its name.
        settings: Its settings; the others keep their defaults.
    """

    def __init__(
        self,
        seed: int = 0,
        *,
        planner: str = "multi_step_pibt",
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        self._planner = planner_named(planner, settings or {}, seed=seed, what="planner")
        self._tables: DistanceTable | None = None

    def act(self, env: TrafficEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del observations
        view, graph = env.view, env.place.graph
        nothing = np.zeros(graph.n_cells, dtype=np.bool_)
        if self._tables is None or self._tables.graph is not graph:
            self._tables = DistanceTable(graph, nothing)
        instance = Instance(
            graph=graph,
            starts=view.state,
            goals=view.goal,
            priorities=view.priority,
            stay=view.locked,
            fixed=view.locked,
            blocked=nothing,
            allow_rotation=False,
            horizon=1,
        )
        return _actions(env, self._planner.plan(instance, self._tables).states[1])


def _actions(env: TrafficEnv, after: npt.NDArray[np.int32]) -> dict[str, Any]:
    """Actions that lead to states, shape (n_cars,)."""
    view, move_to = env.view, env.place.move_to
    kind: npt.NDArray[np.intp] = (move_to[view.state] == after[:, None]).argmax(axis=1) + 1
    return dict(zip(env.possible_agents, np.where(after == view.state, 0, kind).tolist(), strict=True))
