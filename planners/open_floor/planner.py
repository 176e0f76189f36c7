"""OpenFloorPlanner: ways of cars on a floor without lanes, one by one, with repairs by negotiation.

Cars get their ways by the length of their tasks, longest first, each around those that have one. A car that cannot do
without touching others takes the way that costs least; those it touches give theirs up, get another at once, and are
worth more from then on. So priorities come out of the conflicts, as in priority-based search, but none is for good.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from planners.deadline import Deadline
from planners.open_floor.arrays import FloatArray
from planners.open_floor.car_search import CarSearch, OpenFloorConfig
from planners.open_floor.kernels.body import body_of
from planners.open_floor.kernels.standing import KeptMargins, margins_kept
from planners.open_floor.plan import CarWay, OpenFloorPlan
from planners.open_floor.problem import OpenFloorProblem
from planners.status import Status

_FIRST_POSES = 4096
"""Poses that a first search for a car may look at; each further one may look at four times as many."""
_FINER = 4
"""A plan is looked at so many times as finely as it was searched, without a margin. If cars touch, which they may where
they start or end so near to something that the margin is small, all is searched again with twice the checks."""


class OpenFloorPlanner:
    """Plans for cars that all start at once.

    Args:
        config: Settings.
    """

    def __init__(self, config: OpenFloorConfig | None = None) -> None:
        self._config = config or OpenFloorConfig()

    def plan(self, problem: OpenFloorProblem, deadline: Deadline | None = None) -> OpenFloorPlan:
        """Plan.

        Args:
            problem: Who stands where and wants to go where.
            deadline: An iteration is a pose that a search looks at; it ends after the search in which it is used up.

        Returns:
            Ways without conflicts of all cars, or the reason why there are none: one that cannot be solved, or not in
            time, is a result with a status, not an error.
        """
        config, deadline, n = self._config, deadline or Deadline(), problem.n_cars
        body = body_of(problem.car)
        margins = margins_kept(problem, body, config.margin_radii * problem.car.turning_radius_m)
        if margins is None:
            return OpenFloorPlan(ways=(None,) * n, status=Status.INFEASIBLE, step_s=0.0, iterations=0, repairs=0)
        iterations, repairs = 0, 0
        for finer in (1, 2, 4):
            search = CarSearch(problem, body, margins, replace(config, checks=finer * config.checks))
            legs, status, given_up = self._negotiate(problem, search, deadline)
            iterations, repairs = iterations + search.looked, repairs + given_up
            check = CarSearch(
                problem, body, KeptMargins(0.0, 0.0), replace(config, checks=_FINER * finer * config.checks)
            )
            if status is not Status.FEASIBLE or all(
                check.is_clear(car, problem.starts[car], way) for car, way in enumerate(legs) if way is not None
            ):
                break
            status = Status.TIMEOUT
        step = np.array([search.step_s, 1.0, 1.0])
        ways = tuple(
            None if way is None else CarWay(start=problem.starts[car], legs=way * step) for car, way in enumerate(legs)
        )
        return OpenFloorPlan(ways=ways, status=status, step_s=search.step_s, iterations=iterations, repairs=repairs)

    def _negotiate(
        self, problem: OpenFloorProblem, search: CarSearch, deadline: Deadline
    ) -> tuple[list[FloatArray | None], Status, int]:
        """Legs of each car, how it ended, and how many ways were given up."""
        config, n = self._config, problem.n_cars
        length = [search.distance(start, goal) for start, goal in zip(problem.starts, problem.goals, strict=True)]
        waiting = deque(np.argsort(-np.array(length), kind="stable").tolist())
        legs: list[FloatArray | None] = [None] * n
        given_up, most = np.zeros(n), np.full(n, min(_FIRST_POSES, config.most_poses))
        while waiting:
            car, before = waiting.popleft(), search.looked
            start, goal = problem.starts[car], problem.goals[car]
            way, exhausted = search.find(start, goal, config.worth * (1.0 + given_up), int(most[car]))
            if not deadline.spend(search.looked - before) or given_up.sum() > config.most_repairs * n:
                return legs, Status.TIMEOUT, int(given_up.sum())
            if way is None:
                if exhausted or most[car] == config.most_poses:
                    status = Status.INFEASIBLE if exhausted else Status.TIMEOUT
                    return legs, status, int(given_up.sum())
                most[car] = min(4 * most[car], config.most_poses)
                waiting.appendleft(car)
                continue
            legs[car] = way
            for other in search.settle(car, start, way):
                search.give_up(int(other))
                legs[other] = None
                given_up[other] += 1
                waiting.appendleft(int(other))
        return legs, Status.FEASIBLE, int(given_up.sum())
