"""Visits: cars go to places without a parcel, stand there, and go on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fleet.missions.admission import EMERGENCY_RANK_S
from fleet.missions.charging import Charging
from fleet.missions.places import NOT_BOOKED, Place, Places
from fleet.missions.roster import CarPhase, Roster
from fleet.missions.visit_routes import VisitRoutes
from fleet.stations.booking import Bookings
from fleet.tasks.backlog import Backlog
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.order import Priority, Visit
from fleet.tasks.reasons import ReasonBook, TaskReason
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic
from fleet.world.protocol import World
from planners.mapf.distance_table import UNREACHABLE


class Visits:
    """Cars on visits: moves, patrols, inspections, charging and parking that somebody has ordered.

    A dock, charger or parking place is booked before a car sets off, so that nobody queues for it in the lanes; where
    a place further on has no room, the car waits in a parking place until there is. A visit that changes hands goes on
    at the stop that had not been made.

    Args:
        places: Where cars can be sent.
        ways: Tells where there is room.
        board: The tasks.
        backlog: Tells which tasks wait for others.
        reasons: Tells why a task waits.
        roster: What cars are about.
        bookings: Room at the places.
        charging: Fills batteries; None = cars have none.
        traffic: Takes goals.
        executor: Tells where cars are.
        world: Where cars really stand.
        log: Called as ``log(kind, **facts)`` when a stop is made, when a car is held, and when something is inspected.
    """

    def __init__(
        self,
        *,
        places: Places,
        ways: VisitRoutes,
        board: TaskBoard,
        backlog: Backlog,
        reasons: ReasonBook,
        roster: Roster,
        bookings: Bookings,
        charging: Charging | None,
        traffic: Traffic,
        executor: Executor,
        world: World,
        log: Callable[..., None],
    ) -> None:
        self.progress_s = 0.0
        """When a stop was last made [s]."""
        self._places = places
        self._ways = ways
        self._board = board
        self._backlog = backlog
        self._reasons = reasons
        self._roster = roster
        self._bookings = bookings
        self._charging = charging
        self._traffic = traffic
        self._executor = executor
        self._world = world
        self._log = log
        self._any = any(task.visit is not None for task in board.tasks)
        self._counts = (0, 0)
        self._came_s = np.zeros(world.n_cars)

    def release(self, now_s: float) -> None:
        """Make those visits ready that wait for nobody."""
        if not self._any:
            return
        counts = self._board.released_n, self._board.closed_n
        if counts == self._counts:
            return  # nobody's turn has come
        self._counts = counts
        for task in self._board.in_state(TaskState.BACKLOG):
            if task.visit is not None and self._backlog.may_begin(task, now_s):
                self._board.move(task, TaskState.READY, now_s, "nothing comes before it")
                self._roster.changed = True

    def book(self, car: int, task: Task) -> bool:
        """Let a car have the nearest place with room of those that come next; False if there is none.

        Only a car that gets one gives up the place that it had.
        """
        place = self._nearest(car, task)
        if place is None:
            return False
        self._roster.leave(car)
        if place.number != NOT_BOOKED:
            self._bookings.bind(car, place.number)
            self._bookings.book(car)
        task.place = place.name
        return True

    def send(self, car: int, task: Task, tick: int) -> None:
        """Send a car to the place that it has."""
        place = self._places.named(task.place)
        self._roster.enter(car, CarPhase.TO_PLACE)
        # Who is parked there makes room.
        self._roster.changed = True
        self._traffic.rank[car] = EMERGENCY_RANK_S * (task.order.priority is Priority.EMERGENCY)
        goal = self._places.nearest_state(place, int(self._executor.tail_states()[car]))
        self._traffic.send(car, goal, stay=True, tick=tick)

    def call(self, tick: int) -> None:
        """Let cars that are held back go on when there is room."""
        for car, task in self._visiting(CarPhase.HELD):
            if self._bookings.book(car):
                task.reason = f"car_{car} may go on to {task.place}"
                self._log("called", car=f"car_{car}", task=task.order.name, place=task.place)
                self.send(car, task, tick)

    def chargers_wanted(self) -> set[int]:
        """Numbers of chargers to be left to visits, for which a car would be free: one for each such visit."""
        wanted: set[int] = set()
        if not self._any:
            return wanted
        chargers = [n for n in self._places.charger_numbers if not self._traffic.blocked[self._places.cells[n]]]
        for task in self._board.in_state(TaskState.READY):
            if task.visit is not None and self._reasons.present(task) is TaskReason.STATION_FULL:
                numbers = [self._places.named(name).number for name in task.next_stop]
                free = [number for number in numbers if number in chargers and number not in wanted]
                wanted.update(free[:1])
        # Who is held with a visit waits there already.
        return wanted | {number for number in chargers if self._bookings.waiting(number)}

    def leave_s(self, car: int) -> float | None:
        """When a car that stands on a visit goes on [s]; None if that is not known."""
        task = self._roster.task_of[car]
        if task is None or task.visit is None or task.visit.until_full:
            return None
        return float(self._came_s[car]) + task.visit.stand_s

    def has_way(self, car: int, task: Task) -> bool:
        """Whether a car can come to its place."""
        tail = int(self._executor.tail_states()[car])
        if self._roster.phase[car] is CarPhase.TO_PLACE:
            return self._traffic.reachable(tail, int(self._traffic.goals[car]))
        return self._places.reachable(self._places.named(task.place), tail)

    def tick(self, tick: int, now_s: float) -> None:
        """Note who has come, and let those go on who have stood long enough."""
        if not self._any:
            return
        tails = self._executor.tail_states()
        for car, task in self._visiting(CarPhase.TO_PLACE):
            if tails[car] == self._traffic.goals[car] and self._executor.idle(car):
                self._arrive(car, task, now_s)
        for car, task in self._visiting(CarPhase.STANDING, CarPhase.CHARGING):
            if self._has_stood(car, task, now_s):
                self._end_stop(car, task, tick, now_s)

    def _visiting(self, *phases: CarPhase) -> list[tuple[int, Task]]:
        """Cars on visits in some phases, and their tasks."""
        found = [(car, self._roster.task_of[car]) for car, phase in enumerate(self._roster.phase) if phase in phases]
        return [(car, task) for car, task in found if task is not None and task.visit is not None]

    def _nearest(self, car: int, task: Task) -> Place | None:
        tail = self._executor.tail_states()[[car]]
        best, best_n = None, float(UNREACHABLE)
        for place in map(self._places.named, task.next_stop):
            moves_n = float(self._places.moves(place, tail)[0])
            if moves_n < best_n and self._ways.room(place) > 0:
                best, best_n = place, moves_n
        return best

    def _arrive(self, car: int, task: Task, now_s: float) -> None:
        self._came_s[car] = self.progress_s = now_s
        if task.state is TaskState.ASSIGNED:
            self._board.move(task, TaskState.VISITING, now_s, f"car_{car} is at {task.place}")
        if _visit(task).until_full and self._charging is not None:
            self._charging.begin(car)
        else:
            self._roster.enter(car, CarPhase.STANDING)

    def _has_stood(self, car: int, task: Task, now_s: float) -> bool:
        visit = _visit(task)
        if visit.until_full and self._charging is not None:
            return self._charging.is_full(car)
        return bool(now_s - self._came_s[car] >= visit.stand_s)

    def _end_stop(self, car: int, task: Task, tick: int, now_s: float) -> None:
        visit = _visit(task)
        self.progress_s = now_s
        x, y, yaw = (round(float(v), 3) for v in self._world.car_poses()[car])
        pose = {"x": x, "y": y, "yaw": yaw} if visit.inspects else {}
        kind = "inspected" if visit.inspects else "visited"
        self._log(kind, task=task.order.name, car=f"car_{car}", place=task.place, **pose)
        task.stops_n += 1
        if task.stops_n == len(visit.stops):
            self._board.move(task, TaskState.DONE, now_s, f"car_{car} was at {task.place}")
            self._roster.release(car)
        elif self.book(car, task):
            self.send(car, task, tick)
        else:
            self._hold(car, task, now_s)

    def _hold(self, car: int, task: Task, now_s: float) -> None:
        """Let a car wait in a parking place until there is room where it goes next; give up if there is no way."""
        tail = int(self._executor.tail_states()[car])
        places = [place for place in map(self._places.named, task.next_stop) if self._places.reachable(place, tail)]
        if not places:
            self._roster.unassign(task, now_s, f"car_{car} has no way to {task.next_words}")
            self._roster.release(car)
            return
        place = places[0]
        why = self._bookings.full_words(place.number, place.name)
        task.place, task.reason = place.name, f"car_{car} is held: {why}"
        self._roster.leave(car)
        self._bookings.bind(car, place.number)
        self._roster.enter(car, CarPhase.HELD)
        self._roster.changed = True
        self._log("held", car=f"car_{car}", task=task.order.name, cause=why)


def _visit(task: Task) -> Visit:
    if task.visit is None:
        raise AssertionError(f"task {task.order.name} is no visit")
    return task.visit
