"""VisitQueue: visits that no car has yet: which may begin, and which chargers they need."""

from __future__ import annotations

from fleet.missions.places import Places
from fleet.missions.state import Missions
from fleet.missions.ways import Ways
from fleet.tasks.backlog import Backlog
from fleet.tasks.board import TaskState
from fleet.tasks.reasons import ReasonBook, TaskReason


class VisitQueue:
    """Visits without a car.

    Args:
        missions: What cars are about.
        places: Where cars can be sent.
        ways: Tells which places are blocked.
        backlog: Tells which tasks wait for others.
        reasons: Tells why a task waits.
    """

    def __init__(self, missions: Missions, places: Places, ways: Ways, backlog: Backlog, reasons: ReasonBook) -> None:
        self._missions = missions
        self._places = places
        self._ways = ways
        self._backlog = backlog
        self._reasons = reasons
        self._any = any(task.visit is not None for task in missions.board.tasks)
        self._counts = (0, 0)

    def release(self, now_s: float) -> None:
        """Make those visits ready that wait for nobody."""
        if not self._any:
            return
        board = self._missions.board
        counts = board.n_released, board.n_closed
        if counts == self._counts:
            return  # nobody's turn has come
        self._counts = counts
        for task in board.in_state(TaskState.BACKLOG):
            if task.visit is not None and self._backlog.may_begin(task, now_s):
                board.move(task, TaskState.READY, now_s, "nothing comes before it")
                self._missions.changed = True

    def chargers_wanted(self) -> set[int]:
        """Numbers of chargers to be left to visits, for which a car would be free: one for each such visit."""
        wanted: set[int] = set()
        if not self._any:
            return wanted
        chargers = [n for n in self._places.charger_numbers if not self._ways.blocked[self._places.cells[n]]]
        for task in self._missions.board.in_state(TaskState.READY):
            if task.visit is not None and self._reasons.present(task) is TaskReason.STATION_FULL:
                numbers = [self._places.named(name).number for name in task.next_errand]
                free = [number for number in numbers if number in chargers and number not in wanted]
                wanted.update(free[:1])
        # Who is held with a visit waits there already.
        return wanted | {number for number in chargers if self._missions.bookings.waiting(number)}
