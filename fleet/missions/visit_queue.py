"""VisitQueue: visits that no car has yet, and which chargers they need."""

from __future__ import annotations

from fleet.missions.places import Places
from fleet.missions.state import Missions
from fleet.missions.ways import Ways
from fleet.tasks.board import Task, TaskState
from fleet.tasks.reasons import ReasonBook, TaskReason


class VisitQueue:
    """Visits without a car.

    Args:
        missions: What cars are about.
        places: Where cars can be sent.
        ways: Tells which places are blocked.
        reasons: Tells why a task waits.
    """

    def __init__(self, missions: Missions, places: Places, ways: Ways, reasons: ReasonBook) -> None:
        self._missions = missions
        self._places = places
        self._ways = ways
        self._reasons = reasons
        self._ready: dict[int, Task] = {}
        missions.board.subscribe(self._task_moved)

    def ready(self) -> list[Task]:
        """Visits that a car can begin, in the order in which their turn came."""
        return list(self._ready.values())

    def chargers_wanted(self) -> set[int]:
        """Numbers of chargers to be left to visits, for which a car would be free: one for each such visit."""
        wanted: set[int] = set()
        if not self._missions.board.has_visits:
            return wanted
        chargers = [n for n in self._places.charger_numbers if not self._ways.blocked[self._places.cells[n]]]
        for task in self._ready.values():
            if self._reasons.present(task) is TaskReason.STATION_FULL:
                numbers = [self._places.named(name).number for name in task.next_errand]
                free = [number for number in numbers if number in chargers and number not in wanted]
                wanted.update(free[:1])
        # Who is held with a visit waits there already.
        return wanted | {number for number in chargers if self._missions.bookings.waiting(number)}

    def _task_moved(self, task: Task, before: TaskState, now_s: float) -> None:
        del before, now_s
        if task.visit is not None and task.state is TaskState.READY:
            self._ready[task.index] = task
        else:
            self._ready.pop(task.index, None)
