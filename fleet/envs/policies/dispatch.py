"""Scripted policies of the dispatch layer: every car for itself, or all together by an allocator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fleet.arrays import FloatArray
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.dispatch.view import DispatchObserver, DispatchView
from planners.allocation import allocator_named
from planners.allocation.apparent_tardiness import tardiness_index
from planners.allocation.problem import AllocationProblem


class Nearest:
    """Every car takes its nearest candidate, whatever the others do; where two take the same, one waits.

    Args:
        seed: Not used; every policy of the table takes one.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed

    def act(self, env: DispatchEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del env
        return {agent: int(seen["action_mask"][1]) for agent, seen in observations.items()}


class Allocated:
    """An allocator of `planners.allocation` decides for all cars at once, among their candidates.

    A task costs what it costs in any run (`DispatchObserver.cost_s`): travel and lateness, less what it presses for.

    Args:
        allocator: Name in `planners.allocation.ALLOCATORS`.
    """

    def __init__(self, allocator: str) -> None:
        self._allocator = allocator_named(allocator)

    def act(self, env: DispatchEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        actions: dict[str, Any] = dict.fromkeys(observations, 0)
        view, candidates = env.view, env.candidates
        cars, places = np.nonzero(candidates >= 0)
        if not len(cars):
            return actions
        # Most of what is ready is nobody's candidate.
        view = view.only(np.searchsorted(view.task, np.unique(candidates[cars, places])))
        columns = np.searchsorted(view.task, candidates[cars, places])
        cost = np.full((len(candidates), len(view.task)), np.inf)
        cost[cars, columns] = self._cost(env.observer, view)[cars, columns]
        able = np.unique(cars)
        problem = AllocationProblem(cost=cost[able], class_of=view.rank.astype(np.int32), since_s=-view.age_s)
        for row, column in self._allocator.allocate(problem).pairs.tolist():
            car = int(able[row])
            place = int(np.flatnonzero(candidates[car] == view.task[column])[0])
            actions[env.possible_agents[car]] = place + 1
        return actions

    def _cost(self, observer: DispatchObserver, view: DispatchView) -> FloatArray:
        return observer.cost_s(view)


class ApparentTardinessDispatch(Allocated):
    """The pair that is best by the apparent tardiness cost rule first, see `planners.allocation.apparent_tardiness`.

    Args:
        seed: Not used.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed
        super().__init__("greedy")

    def _cost(self, observer: DispatchObserver, view: DispatchView) -> FloatArray:
        return -tardiness_index(observer.takes_s(view), view.due_s)


class GreedyDispatch(Allocated):
    """The cheapest pair of a car and a task first.

    Args:
        seed: Not used.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed
        super().__init__("greedy")


class HungarianDispatch(Allocated):
    """The cheapest assignment of all cars that can choose, the most urgent classes first.

    Args:
        seed: Not used.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed
        super().__init__("hungarian")
