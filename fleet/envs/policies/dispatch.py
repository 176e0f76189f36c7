"""Scripted policies of the dispatch layer: every car for itself, or all together by an allocator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.abstract.kernel import NONE
from fleet.arrays import FloatArray
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.dispatch.view import N_OWN, N_PER_CANDIDATE, TIME_S, DispatchObserver, DispatchView
from planners.allocation import allocator_named
from planners.allocation.apparent_tardiness import tardiness_index
from planners.allocation.costs import LOOK_AHEAD
from planners.allocation.problem import AllocationProblem, Allocator


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


MEAN_TASK_S = 80.0
"""Mean time of a task, where it is not worked out [s]."""
Score = Callable[[npt.NDArray[np.float32], npt.NDArray[np.int8]], npt.NDArray[Any]]
"""From observations and legal actions to how much each action is wanted."""
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
        rest_below: Cars with less charge than this take no task while there is a charger for them.
    """

    def __init__(
        self,
        allocator: str,
        seed: int = 0,
        *,
        cost: Price = DispatchObserver.cost_s,
        classes: bool = True,
        rest_below: float = 0.0,
    ) -> None:
        del seed
        self._rest_below = rest_below
        self._allocator = allocator_named(allocator)
        self._cost = cost
        self._classes = classes

    def act(self, env: DispatchEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        view, candidates = env.view, env.candidates
        on_offer = candidates != NONE
        on_offer[self._resting(env)] = False
        cars, places = np.nonzero(on_offer)
        if not len(cars):
            return dict.fromkeys(observations, 0)
        # Most of what is ready is nobody's candidate.
        view = view.only(np.searchsorted(view.task, np.unique(candidates[cars, places])))
        columns = np.searchsorted(view.task, candidates[cars, places])
        cost = np.full(candidates.shape, np.inf)
        cost[cars, places] = self._cost(env.observer, view)[cars, columns]
        return matched(env, observations, cost, self._allocator, classes=self._classes)

    def _resting(self, env: DispatchEnv) -> npt.NDArray[np.bool_]:
        """Cars that stay at their charger, and the emptiest of the others, one for each charger that is left."""
        view, chargers = env.view, env.place.floor.charger_state
        low = view.free & (view.charge < self._rest_below)
        resting: npt.NDArray[np.bool_] = low & np.isin(view.goal, chargers)
        others = np.flatnonzero(low & ~resting)
        n_left = round(view.chargers_left * len(chargers))
        resting[others[np.argsort(view.charge[others], kind="stable")][:n_left]] = True
        return resting


def observed_tardiness(rows: npt.NDArray[np.float32], mask: npt.NDArray[np.int8]) -> FloatArray:
    """The apparent tardiness cost rule from what cars observe: logarithm of its index, shape (n, n_actions).

    Args:
        rows: Observations, shape (n, n_numbers).
        mask: Legal actions, shape (n, n_actions).
    """
    n, n_actions = mask.shape
    end = N_OWN + (n_actions - 1) * N_PER_CANDIDATE
    each = rows[:, N_OWN:end].reshape(n, n_actions - 1, N_PER_CANDIDATE)
    takes = each[:, :, 1] + each[:, :, 2]
    # In units of the longest way and of 300 s: the mean of a task is the first, time to spare the second.
    spare = np.where(each[:, :, 4] > 0.0, np.maximum(each[:, :, 5], 0.0), 1.0)
    scores = np.full((n, n_actions), -np.inf)
    scores[:, 1:] = -np.log(np.maximum(takes, 0.1)) - TIME_S * spare / (LOOK_AHEAD * MEAN_TASK_S)
    return scores


class ScoredMatching:
    """Cars say how much they want each of their candidates, and get what makes the sum of it greatest.

    So what is learned may be one number for each car and candidate, and two cars never choose the same task. A
    candidate that a car wants less than to take nothing is not given to it.

    Args:
        seed: Not used; every policy of the table takes one.
        score: From observations, shape (n, n_numbers), and legal actions, shape (n, n_actions), to how much each
            action is wanted, same shape as these; -inf for 0 = anything is better than nothing. As it stands it is a
            rule.
    """

    def __init__(self, seed: int = 0, *, score: Score = observed_tardiness) -> None:
        del seed
        self._score = score
        self._allocator = allocator_named("hungarian")

    def act(self, env: DispatchEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        # Only who can choose is asked.
        able = np.flatnonzero(env.view.free & (env.candidates[:, 0] != NONE))
        cost = np.full(env.candidates.shape, np.inf)
        if len(able):
            seen = [observations[env.possible_agents[car]] for car in able]
            mask = np.stack([one["action_mask"] for one in seen])
            scores = self._score(np.stack([one["observation"] for one in seen]), mask)
            wanted = (mask[:, 1:] == 1) & (scores[:, 1:] > scores[:, :1])
            cost[able] = np.where(wanted, -scores[:, 1:], np.inf)
        return matched(env, observations, cost, self._allocator, classes=False)


def matched(
    env: DispatchEnv, observations: Mapping[str, Any], cost: FloatArray, allocator: Allocator, *, classes: bool
) -> dict[str, Any]:
    """Actions that an allocator chooses.

    Args:
        env: The environment.
        observations: By agent.
        cost: Of each candidate of each car, inf = not to be had, shape (n_cars, candidates_n).
        allocator: Chooses.
        classes: Whether tasks of a class go before those of the next, at any cost.
    """
    actions: dict[str, Any] = dict.fromkeys(observations, 0)
    view, candidates = env.view, env.candidates
    cars, places = np.nonzero(np.isfinite(cost))
    if not len(cars):
        return actions
    able, rows = np.unique(cars, return_inverse=True)
    known = np.searchsorted(view.task, candidates[cars, places])
    _, one_of_each, columns = np.unique(view.order[known], return_index=True, return_inverse=True)
    known = known[one_of_each]
    # Of the tasks of an order each car would take the one that costs it least.
    of_order = np.full((len(able), len(known)), np.inf)
    np.minimum.at(of_order, (rows, columns), cost[cars, places])
    class_of = view.rank[known].astype(np.int32) if classes else np.zeros(len(known), dtype=np.int32)
    problem = AllocationProblem(cost=of_order, class_of=class_of, since_s=-view.age_s[known])
    for row, column in allocator.allocate(problem).pairs.tolist():
        own = np.flatnonzero((rows == row) & (columns == column))
        place = places[own[np.argmin(cost[able[row], places[own]])]]
        actions[env.possible_agents[int(able[row])]] = int(place) + 1
    return actions
