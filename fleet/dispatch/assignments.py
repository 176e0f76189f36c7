"""Assignments: tasks are given to cars that are free, and change hands where much is gained."""

from __future__ import annotations

from fleet.dispatch.allocation import TaskAllocation
from fleet.dispatch.situation import situation_of
from fleet.missions.admission import Admission
from fleet.missions.charging import Charging
from fleet.missions.state import Missions
from fleet.missions.visits import Visits
from fleet.missions.ways import Ways
from fleet.tasks.board import Task
from fleet.tasks.reasons import ReasonBook, TaskReason


class Assignments:
    """Carries out what the allocation says.

    Args:
        missions: What cars are about.
        ways: Where they will be.
        allocation: Says which car should take which task.
        admission: Sends cars to stations.
        visits: Sends cars to places.
        charging: Tells which cars have to charge; None = cars have no batteries.
        reasons: Told why a task has no car.
    """

    def __init__(
        self,
        missions: Missions,
        ways: Ways,
        allocation: TaskAllocation,
        admission: Admission,
        visits: Visits,
        charging: Charging | None,
        reasons: ReasonBook,
    ) -> None:
        self.allocation = allocation
        self.n_allocations = 0
        """How often tasks were given out."""
        self._missions = missions
        self._ways = ways
        self._admission = admission
        self._visits = visits
        self._charging = charging
        self._reasons = reasons

    def give_out(self, tick: int, now_s: float, *, exchange: bool) -> None:
        """Give tasks to cars that are free, and exchange those that are not picked yet where much is gained.

        Args:
            tick: Present tick.
            now_s: Simulated time [s].
            exchange: Whether tasks that are not picked yet may change hands.
        """
        missions = self._missions
        missions.changed = False
        self.n_allocations += 1
        exchange = exchange or missions.lost_a_car or self.allocation.plans_ahead
        situation = situation_of(missions, self._ways, self._charging, now_s, exchange=exchange)
        choice = self.allocation.choose(situation, now_s)
        for car, reason in choice.taken:
            missions.unassign(situation.held[car], now_s, reason)
            missions.stand_down(car)
        missions.lost_a_car = False
        missions.changed |= choice.more
        for car, task, why in choice.given:
            self._assign(car, task, why, tick, now_s)

    def _assign(self, car: int, task: Task, why: str, tick: int, now_s: float) -> None:
        # A visit has to find room where it goes first; a delivery waits its turn.
        if task.visit is not None and not self._visits.book(car, task):
            # Another visit that was given out with it took the only place.
            text = f"{task.next_words} has no room for one more car"
            self._reasons.note(task, TaskReason.STATION_FULL, text, now_s)
            self._missions.changed = True
            return
        self._missions.assign(car, task, now_s, why)
        self._reasons.forget(task)
        if task.visit is not None:
            self._visits.send(car, task, tick)
        else:
            self._admission.set_off(car, task, tick, now_s)
