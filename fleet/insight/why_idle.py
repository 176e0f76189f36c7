"""WhyIdle: which task a car without one could have, and why it has not got it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fleet.insight.causes import DETAIL_OF, NONE, Cause, CauseRows, Column
from fleet.tasks.board import DONE_STATES, Task, TaskState
from fleet.tasks.reasons import PAIR_REASONS, PairReason, TaskReason

if TYPE_CHECKING:
    from fleet.simulation import Simulation

_PASSED = frozenset({PairReason.CAR_BUSY, PairReason.CAR_OUT, PairReason.CAR_CHARGES, PairReason.CHOSEN})
"""What was true when tasks were last given out, and is not of a car that is idle."""


class WhyIdle:
    """Reads the reasons that the allocation has left.

    A car is told about one task: of those that a car could begin the one that has waited longest; else of those that
    are released, and else of those that are ordered, the first one.

    Args:
        simulation: The run that is watched.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation

    def fill(self, rows: CauseRows, cars: list[int]) -> None:
        """Fill the rows of idle cars."""
        board = self._simulation.board
        first = next(filter(None, map(board.first_in, (TaskState.READY, TaskState.BACKLOG, TaskState.ORDERED))), None)
        for car in cars:
            row = rows[car]
            row[Column.CAUSE], row[Column.BY], row[Column.CELL] = Cause.NO_TASK, NONE, NONE
            row[Column.PLACE], row[Column.UNTIL], row[Column.DETAIL] = NONE, NONE, 0
            row[Column.TASK] = NONE if first is None else first.index
            if self._must_charge(car):
                self._charger(row, car)
            elif first is not None and first.state is TaskState.READY:
                self._ready(row, car, first)
            elif first is not None and first.state is TaskState.BACKLOG:
                self._backlog(row, first)
            elif first is not None:
                row[Column.DETAIL] = DETAIL_OF[TaskReason.NOT_RELEASED]
                row[Column.UNTIL] = round(first.order.release_s / self._simulation.tick_s)

    def _must_charge(self, car: int) -> bool:
        charging = self._simulation.dispatcher.charging
        return charging is not None and not charging.spares(car)

    def _charger(self, row: CauseRows, car: int) -> None:
        """All chargers are taken: the one is named whose car has the most charge."""
        dispatcher, batteries = self._simulation.dispatcher, self._simulation.batteries
        row[Column.CAUSE], row[Column.TASK] = Cause.CHARGER, NONE
        row[Column.DETAIL] = DETAIL_OF[PairReason.LOW_CHARGE]
        if dispatcher.charging is None or batteries is None:
            return
        taken = [(other, place) for place in dispatcher.charging.places for other in dispatcher.bookings.cars(place)]
        if taken:
            row[Column.BY], row[Column.PLACE] = max(taken, key=lambda pair: float(batteries.charge[pair[0]]))

    def _ready(self, row: CauseRows, car: int, task: Task) -> None:
        """A car that is free could begin with the task."""
        reasons = self._simulation.dispatcher.reasons
        decision, present = reasons.decision(task), reasons.present(task)
        own = PairReason.CHOSEN if decision is None else PAIR_REASONS[int(decision.codes[car])]
        if own in _PASSED:
            row[Column.DETAIL] = DETAIL_OF["next_round"]
        elif own is PairReason.NO_WAY or present is TaskReason.UNREACHABLE:
            self._no_way(row, car, task)
        elif own is PairReason.NOT_OFFERED and present is TaskReason.STATION_FULL:
            row[Column.DETAIL] = DETAIL_OF[present]
            row[Column.PLACE], row[Column.BY] = self._full(task)
        else:
            row[Column.DETAIL] = DETAIL_OF[own]

    def _backlog(self, row: CauseRows, task: Task) -> None:
        """The task waits itself."""
        simulation = self._simulation
        reason = simulation.dispatcher.reasons.present(task)
        row[Column.DETAIL] = 0 if reason is None else DETAIL_OF[reason]
        before = simulation.board.waits_for(task)
        if before is not None:
            row[Column.DETAIL] = DETAIL_OF[TaskReason.WAITS_FOR_PREDECESSOR]
            row[Column.BY] = NONE if before.car is None or before.state in DONE_STATES else before.car
        elif reason is TaskReason.WAITS_FOR_SLOT:
            arm = self._arm_of(task.pick)
            row[Column.PLACE], row[Column.BY] = arm, NONE if arm == NONE else simulation.world.n_cars + arm

    def _no_way(self, row: CauseRows, car: int, task: Task) -> None:
        """The first blocked cell on the way to a task, or on from its first stop, and the dead car in it."""
        simulation = self._simulation
        traffic, places = simulation.traffic, simulation.dispatcher.places
        names = task.next_stop if task.visit is not None else (task.pick, task.delivery.drop)
        start = int(simulation.executor.tail_states()[car])
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
        """The end of a task at which the most cars are, and its arm; of a visit the place and the car there."""
        simulation = self._simulation
        bookings = simulation.dispatcher.bookings
        if task.visit is not None:
            numbers = [simulation.dispatcher.places.named(name).number for name in task.next_stop]
            taken = [number for number in numbers if number >= 0 and bookings.cars(number)]
            return (taken[0], bookings.cars(taken[0])[0]) if taken else (NONE, NONE)
        arm = max((self._arm_of(task.pick), self._arm_of(task.delivery.drop)), key=lambda k: len(bookings.bound(k)))
        return arm, simulation.world.n_cars + arm

    def _arm_of(self, name: str) -> int:
        return next((station.arm for station in self._simulation.stations if station.name == name), NONE)
