"""Allotment: which idle car should take which ready task, by the allocator that the run names."""

from __future__ import annotations

import numpy as np

from fleet.config import AllocationConfig
from fleet.executor import Executor
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.traffic import Traffic
from planners.allocation import ALLOCATORS
from planners.allocation.problem import AllocationProblem
from planners.mapf.distance_table import UNREACHABLE

UNDER_WAY = (TaskState.ASSIGNED, TaskState.LOADING, TaskState.CARRIED, TaskState.UNLOADING)


class Allotment:
    """Poses the allocation problem and hands on its answer.

    Args:
        config: Allocator, caps, ageing.
        board: The tasks.
        stations: All stations.
        traffic: Gives distances on the lane graph.
        executor: Gives the states cars can be sent from.
    """

    def __init__(
        self,
        config: AllocationConfig,
        board: TaskBoard,
        stations: list[Station],
        traffic: Traffic,
        executor: Executor,
    ) -> None:
        self._config = config
        self._board = board
        self._by_name = {station.name: station for station in stations}
        self._traffic = traffic
        self._executor = executor
        self._allocator = ALLOCATORS[config.allocator]()

    def choose(self, cars: list[int], now_s: float) -> list[tuple[int, Task]]:
        """Pairs of a car and a task, at most one for each.

        Args:
            cars: Cars that are free.
            now_s: Simulated time [s].
        """
        tasks = self._candidates() if cars else []
        if not tasks:
            return []
        tails = self._executor.tail_states()[cars]
        cost = np.empty((len(cars), len(tasks)))
        for k, task in enumerate(tasks):
            pick, drop = (self._by_name[name].dock_state for name in (task.order.pick, task.order.drop))
            distance = self._traffic.tables.to(pick)[tails].astype(np.float64)
            if not self._traffic.reachable(pick, drop):
                distance[:] = UNREACHABLE
            waited_s = now_s - task.since_s[TaskState.READY]
            cost[:, k] = distance - self._config.ageing_m_per_s * waited_s
            cost[distance >= UNREACHABLE, k] = np.inf
        pairs = self._allocator.allocate(AllocationProblem(cost=cost)).pairs
        return [(cars[int(row)], tasks[int(column)]) for row, column in pairs]

    def _candidates(self) -> list[Task]:
        """Ready tasks, oldest first, as many as the caps of their stations allow."""
        cap = self._config.station_cap_n
        bound: dict[str, int] = {}
        for task in self._board.in_state(*UNDER_WAY):
            if task.state in (TaskState.ASSIGNED, TaskState.LOADING):
                bound[task.order.pick] = bound.get(task.order.pick, 0) + 1
            bound[task.order.drop] = bound.get(task.order.drop, 0) + 1
        chosen = []
        for task in self._board.in_state(TaskState.READY):
            pick, drop = task.order.pick, task.order.drop
            # A drop station may have one more under way: its cars are still far when they are chosen.
            if bound.get(pick, 0) < cap and bound.get(drop, 0) < cap + 1:
                bound[pick] = bound.get(pick, 0) + 1
                bound[drop] = bound.get(drop, 0) + 1
                chosen.append(task)
        return chosen
