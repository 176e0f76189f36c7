"""Allotment: which idle car should take which ready task, by the allocator that the run names."""

from __future__ import annotations

import numpy as np

from fleet.config import AllocationConfig
from fleet.executor import Executor
from fleet.stations.booking import Bookings
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
        bookings: Room at the stations.
        traffic: Gives distances on the lane graph.
        executor: Gives the states cars can be sent from.
    """

    def __init__(
        self,
        config: AllocationConfig,
        board: TaskBoard,
        stations: list[Station],
        bookings: Bookings,
        traffic: Traffic,
        executor: Executor,
    ) -> None:
        self._config = config
        self._board = board
        self._by_name = {station.name: station for station in stations}
        self._bookings = bookings
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
        pick_room, drop_room = {}, {}
        for name, station in self._by_name.items():
            pick_room[name] = self._bookings.room(station.arm)
            # A drop station may have one more under way: it is held back if it arrives too early.
            drop_room[name] = self._bookings.caps[station.arm] + 1
        for task in self._board.in_state(*UNDER_WAY):
            drop_room[task.order.drop] -= 1
        chosen = []
        for task in self._board.in_state(TaskState.READY):
            pick, drop = task.order.pick, task.order.drop
            if pick_room[pick] > 0 and drop_room[drop] > 0:
                pick_room[pick] -= 1
                drop_room[drop] -= 1
                chosen.append(task)
        return chosen
