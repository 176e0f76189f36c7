"""Classes of one's own, good and bad, that tests name by their dotted names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from planners.allocation.greedy import Greedy
from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.mapf.pibt import Pibt
from planners.mapf.problem import Instance, Plan
from planners.status import Status


@dataclass(frozen=True, kw_only=True)
class MineConfig:
    """Settings of `MinePlanner` and `MineAllocator`."""

    patience: int = 3
    calm: bool = False
    share: float = 0.5


class MinePlanner(Pibt):
    """A planner with settings of its own."""

    def __init__(self, config: MineConfig | None = None, *, seed: int = 0) -> None:
        super().__init__(seed=seed)
        self.mine = MineConfig() if config is None else config
        self.seed = seed


class MineAllocator(Greedy):
    """An allocator with settings of its own, which plans ahead."""

    plans_ahead = True
    soon_s = 4.0

    def __init__(self, config: MineConfig | None = None) -> None:
        self.mine = MineConfig() if config is None else config


class PlainPlanner(Pibt):
    """A planner without settings."""

    def __init__(self, *, seed: int = 0) -> None:
        super().__init__(seed=seed)


class Seedless:
    """A planner that cannot be made with a seed."""

    def plan(self, instance: Instance, *others: Any) -> Plan:
        raise NotImplementedError


class ListPlanner:
    """Answers with a list."""

    def __init__(self, seed: int = 0) -> None:
        pass

    def plan(self, instance: Instance, *others: Any) -> Any:
        return [instance.starts]


class ArrayPlanner(ListPlanner):
    """Answers with a plan whose states are what a test says."""

    states: Any = None
    status: Any = Status.FEASIBLE

    def plan(self, instance: Instance, *others: Any) -> Any:
        return Plan(states=self.states, status=self.status, iterations=0)


class BrokenPlanner(ListPlanner):
    """Fails, and not in a line of its own."""

    def plan(self, instance: Instance, *others: Any) -> Any:
        return np.linalg.inv(instance.starts)


class BrokenAllocator:
    """Fails."""

    def allocate(self, problem: AllocationProblem) -> Any:
        return {}["pairs"]


class DictAllocator:
    """Answers with a dictionary."""

    def allocate(self, problem: AllocationProblem) -> Any:
        return {0: 0}


class FlatAllocator:
    """Answers with pairs that are no rows."""

    def allocate(self, problem: AllocationProblem) -> Assignment:
        return Assignment(pairs=np.array([0, 0], dtype=np.int32), cost=0.0, status=Status.FEASIBLE)


class AllToOne:
    """Gives every vehicle the first task."""

    def allocate(self, problem: AllocationProblem) -> Assignment:
        return assignment(problem, [(vehicle, 0) for vehicle in range(len(problem.cost))], Status.FEASIBLE)


def a_function(seed: int = 0) -> None:
    """No class."""
