"""Scripted policies of the dispatch layer: every car for itself, or all together by an allocator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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


Price = Callable[[DispatchObserver, DispatchView], FloatArray]
"""What each task costs each car, shape (n_cars, n_tasks) [s]."""


def apparent_tardiness(observer: DispatchObserver, view: DispatchView) -> FloatArray:
    """What tasks cost by the apparent tardiness cost rule, see `planners.allocation.apparent_tardiness`."""
    return -tardiness_index(observer.takes_s(view), view.due_s)


class Allocated:
    """An allocator of `planners.allocation` decides for all cars at once, among their candidates.

    Args:
        allocator: Name in `planners.allocation.ALLOCATORS`.
        seed: Not used; every policy of the table takes one.
        cost: What each task costs each car. As it stands it is what it costs in any run: travel and lateness, less what
            the task presses for.
        classes: Whether tasks of a class go before those of the next, at any cost.
    """

    def __init__(
        self, allocator: str, seed: int = 0, *, cost: Price = DispatchObserver.cost_s, classes: bool = True
    ) -> None:
        del seed
        self._allocator = allocator_named(allocator)
        self._cost = cost
        self._classes = classes

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
        rank = view.rank.astype(np.int32)
        class_of = rank if self._classes else np.zeros_like(rank)
        problem = AllocationProblem(cost=cost[able], class_of=class_of, since_s=-view.age_s)
        for row, column in self._allocator.allocate(problem).pairs.tolist():
            car = int(able[row])
            place = int(np.flatnonzero(candidates[car] == view.task[column])[0])
            actions[env.possible_agents[car]] = place + 1
        return actions
