"""WhyIdle: which task a car without one could have, and why it has not got it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.insight.causes import DETAIL_OF, NONE, Cause, CauseRows, Column
from fleet.run.view import RunView
from fleet.stations.station import Station
from fleet.tasks.board import DONE_STATES, Task, TaskState
from fleet.tasks.reasons import CODE_OF_REASON, PAIR_REASONS, PairReason, TaskReason

_PASSED = frozenset(
    {PairReason.CAR_BUSY, PairReason.CAR_OUT, PairReason.CAR_CHARGES, PairReason.CHOSEN, PairReason.NOT_ASKED}
)
"""What was true when tasks were last given out, and is not of a car that is idle."""
_DETAIL_OF_CODE = np.array(
    [DETAIL_OF["next_round" if reason in _PASSED else reason] for reason in PAIR_REASONS], dtype=np.int32
)
_NOT_OFFERED, _NO_WAY = CODE_OF_REASON[PairReason.NOT_OFFERED], CODE_OF_REASON[PairReason.NO_WAY]


class WhyIdle:
    """Reads the reasons that the allocation has left.

    A car is told about one task: of those that a car could begin the one that has waited longest; else of those that
    are released, and else of those that are ordered, the first one.

    Args:
        run: The run that is watched.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run

    def fill(self, rows: CauseRows, cars: npt.NDArray[np.intp]) -> None:
        """Fill the rows of idle cars."""
        board = self._run.board
        first = next(filter(None, map(board.first_in, (TaskState.READY, TaskState.BACKLOG, TaskState.ORDERED))), None)
        closed = self._closed(first) if first is not None and first.state is TaskState.READY else None
        if closed is not None:
            other = next((task for task in board.in_state(TaskState.READY) if not self._closed(task)), None)
            first, closed = (first, closed) if other is None else (other, None)
        row = np.full(len(Column), NONE, dtype=np.int32)
        row[Column.CAUSE], row[Column.DETAIL] = Cause.NO_TASK, 0
        row[Column.TASK] = NONE if first is None else first.index
        if first is not None and first.state is TaskState.BACKLOG:
            self._backlog(row, first)
        elif first is not None and first.state is TaskState.ORDERED:
            row[Column.DETAIL] = DETAIL_OF[TaskReason.NOT_RELEASED]
            row[Column.UNTIL] = round(first.order.release_s / self._run.tick_s)
        elif closed is not None:
            row[Column.DETAIL], row[Column.PLACE] = DETAIL_OF["station_closed"], closed.arm
            row[Column.BY] = self._run.world.n_cars + closed.arm if self._run.arm_manager.dead[closed.arm] else NONE
        if first is not None and first.state is TaskState.READY and closed is None:
            self._ready(rows, cars, row, first)
        else:
            rows[cars] = row
        if self._run.charging is not None:
            for car in filter(self._must_charge, cars.tolist()):
                self._charger(rows[car])

    def _must_charge(self, car: int) -> bool:
        charging = self._run.charging
        return charging is not None and not charging.spares(car)

    def _charger(self, row: CauseRows) -> None:
        """All chargers are taken: the one is named whose car has the most charge."""
        run, batteries = self._run, self._run.batteries
        row[Column.CAUSE], row[Column.TASK] = Cause.CHARGER, NONE
        row[Column.DETAIL] = DETAIL_OF[PairReason.LOW_CHARGE]
        if run.charging is None or batteries is None:
            return
        taken = [(other, place) for place in run.charging.places for other in run.bookings.cars(place)]
        if taken:
            row[Column.BY], row[Column.PLACE] = max(taken, key=lambda pair: float(batteries.charge[pair[0]]))

    def _ready(self, rows: CauseRows, cars: npt.NDArray[np.intp], row: CauseRows, task: Task) -> None:
        """A car that is free could begin with the task."""
        reasons = self._run.reasons
        decision, present = reasons.decision(task), reasons.present(task)
        if decision is None:
            row[Column.DETAIL] = DETAIL_OF["next_round"]
            rows[cars] = row
            return
        row_of_code = np.tile(row, (len(_DETAIL_OF_CODE), 1))
        row_of_code[:, Column.DETAIL] = _DETAIL_OF_CODE
        if present is TaskReason.STATION_FULL:
            full = row_of_code[_NOT_OFFERED]
            full[Column.DETAIL] = DETAIL_OF[present]
            full[Column.PLACE], full[Column.BY] = self._full(task)
        codes = decision.codes[cars]
        rows[cars] = row_of_code[codes]
        cut_off = cars if present is TaskReason.UNREACHABLE else cars[codes == _NO_WAY]
        for car in cut_off.tolist():
            self._no_way(rows[car], car, task)

    def _closed(self, task: Task) -> Station | None:
        """A station that a delivery needs and that is closed."""
        if task.visit is not None:
            return None
        stations = self._run.stations
        picks = task.delivery.picks if task.pick_slot is None else (task.pick,)
        needed = picks if not any(map(stations.is_open, picks)) else ()
        shut = (name for name in (*needed, task.delivery.drop) if not stations.is_open(name))
        name = next(shut, None)
        return None if name is None else stations.named(name)

    def _backlog(self, row: CauseRows, task: Task) -> None:
        """The task waits itself."""
        run = self._run
        reason = run.reasons.present(task)
        row[Column.DETAIL] = 0 if reason is None else DETAIL_OF[reason]
        before = run.board.waits_for(task)
        if before is not None:
            row[Column.DETAIL] = DETAIL_OF[TaskReason.WAITS_FOR_PREDECESSOR]
            row[Column.BY] = NONE if before.car is None or before.state in DONE_STATES else before.car

    def _no_way(self, row: CauseRows, car: int, task: Task) -> None:
        """The first blocked cell on the way to a task, or on from its first errand, and the dead car in it."""
        run = self._run
        traffic, places = run.traffic, run.places
        names = task.next_errand if task.visit is not None else (task.pick, task.delivery.drop)
        start = run.graph.place_of(int(run.executor.tail_states()[car]))
        for name in names:
            goal = places.named(name).states[0]
            if start != goal and not traffic.reachable(start, goal):
                cell = traffic.obstacle(start, goal)
                row[Column.DETAIL], row[Column.CELL] = DETAIL_OF[PairReason.NO_WAY], cell
                row[Column.BY] = NONE if cell == NONE else traffic.wreck_of[cell]
                return
            start = goal if task.visit is None else start
        row[Column.DETAIL] = DETAIL_OF["next_round"]  # it is open again

    def _full(self, task: Task) -> tuple[int, int]:
        """The place of a visit that has no room, and a car there."""
        run = self._run
        bookings = run.bookings
        numbers = [run.places.named(name).number for name in task.next_errand]
        taken = [number for number in numbers if number >= 0 and bookings.cars(number)]
        return (taken[0], bookings.cars(taken[0])[0]) if taken else (NONE, NONE)
