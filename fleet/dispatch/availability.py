"""Outlook: where and when each car that is busy will be free again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fleet.missions.roster import CarPhase, Roster
from fleet.stations.service_time import ServiceTimes
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic
from planners.mapf.distance_table import UNREACHABLE

STEP_S = 1.0
"""Time of one move in traffic [s]: cells are 1 m, and cars in traffic average 1 m/s."""
_SOON_FREE = frozenset(
    {CarPhase.TO_PICK, CarPhase.LOADING, CarPhase.HELD, CarPhase.TO_DROP, CarPhase.UNLOADING, CarPhase.TO_CHARGER}
)


@dataclass(frozen=True, kw_only=True)
class Availability:
    """The end of what a car is about."""

    state: int
    """Lane-graph state in which it will be free."""
    free_s: float
    """Time until then [s]."""


class Availabilities:
    """Looks ahead by the ways that are left and the service times that were learnt; queues are not foreseen.

    Args:
        stations: By name.
        roster: What cars are about.
        service_times: How long the arms take.
        traffic: Gives distances.
        executor: Tells where cars are.
    """

    def __init__(
        self,
        stations: Mapping[str, Station],
        roster: Roster,
        service_times: ServiceTimes,
        traffic: Traffic,
        executor: Executor,
    ) -> None:
        self._stations = stations
        self._roster = roster
        self._service_times = service_times
        self._traffic = traffic
        self._executor = executor

    def of(self, car: int, now_s: float) -> Availability | None:
        """When a car with a delivery has made it; None if it has none, is out of service, or has no way."""
        task = self._roster.task_of[car]
        if task is None or task.visit is not None or self._roster.phase[car] not in _SOON_FREE:
            return None
        drop = self._stations[task.delivery.drop]
        moves, served_s = self._left(car, task, drop, now_s)
        if moves >= UNREACHABLE:
            return None
        return Availability(state=drop.dock_state, free_s=moves * STEP_S + served_s)

    def _left(self, car: int, task: Task, drop: Station, now_s: float) -> tuple[int, float]:
        """Moves and time at docks that are left until a task is delivered."""
        if task.state is TaskState.UNLOADING:
            return 0, self._service_times.left_s(drop.arm, now_s)
        unload_s = self._service_times.of(drop.arm, drop.direction).mean_s
        to_drop = self._traffic.tables.to(drop.dock_state)
        if task.state is TaskState.CARRIED:
            return int(to_drop[self._executor.tail_states()[car]]), unload_s
        pick = self._stations[task.pick]
        loading = task.state is TaskState.LOADING
        load_s = (
            self._service_times.left_s(pick.arm, now_s)
            if loading
            else self._service_times.of(pick.arm, pick.direction).mean_s
        )
        return int(to_drop[pick.dock_state]), load_s + unload_s
