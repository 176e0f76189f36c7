"""Scripted policies of the traffic layer: every car on its shortest way, or all together by PIBT."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.envs.grid.kernel import NONE
from fleet.envs.traffic.env import TrafficEnv
from maps.lane_graph import LaneGraph
from planners.mapf.pibt import Stepper


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
        seed: Seed of the tie-breaking.
    """

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._graph: LaneGraph | None = None
        self._stepper: Stepper | None = None

    def act(self, env: TrafficEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del observations
        view, place = env.view, env.place
        if self._stepper is None or self._graph is not place.graph:
            nothing = np.zeros(place.graph.n_cells, dtype=np.bool_)
            self._graph, self._stepper = place.graph, Stepper(place.graph, nothing, seed=self._seed)
        after = np.empty_like(view.state)
        self._stepper.step(
            view.state,
            after,
            distances=place.floor.distance,
            row=np.where(view.goal != NONE, place.goal_row[view.goal], NONE).astype(np.int32),
            order=np.argsort(-view.priority, kind="stable").astype(np.int32),
            locked=view.locked,
            allow_rotation=False,
        )
        kind: npt.NDArray[np.intp] = (place.move_to[view.state] == after[:, None]).argmax(axis=1) + 1
        return dict(zip(env.possible_agents, np.where(after == view.state, 0, kind).tolist(), strict=True))
