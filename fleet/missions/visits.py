"""Visits: cars go to places without a parcel, stand there, and go on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fleet.missions.charging import Charging
from fleet.missions.phases import CarPhase
from fleet.missions.places import NOT_BOOKED, Place, Places
from fleet.missions.state import Missions
from fleet.missions.visit_routes import VisitRoutes
from fleet.missions.ways import EMERGENCY_RANK_S, Ways
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Priority, Visit
from fleet.world.protocol import World
from planners.mapf.distance_table import UNREACHABLE


class Visits:
    """Cars on visits: moves, patrols, inspections, charging and parking that somebody has ordered.

    A dock, charger or parking place is booked before a car sets off, so that nobody queues for it in the lanes; where
    a place further on has no room, the car waits in a parking place until there is. A visit that changes hands goes on
    at the errand that had not been done.

    Args:
        missions: What cars are about.
        places: Where cars can be sent.
        routes: Tells where there is room.
        ways: How far cars are from places.
        charging: Fills batteries; None = cars have none.
        world: Where cars really stand.
        log: Called as ``log(kind, **facts)`` when an errand is done, when a car is held, and when something is
            inspected.
    """

    def __init__(
        self,
        missions: Missions,
        places: Places,
        routes: VisitRoutes,
        ways: Ways,
        charging: Charging | None,
        world: World,
        log: Callable[..., None],
    ) -> None:
        self.progress_s = 0.0
        """When an errand was last done [s]."""
        self._missions = missions
        self._places = places
        self._routes = routes
        self._ways = ways
        self._charging = charging
        self._world = world
        self._log = log
        self._came_s = np.zeros(world.n_cars)

    def book(self, car: int, task: Task) -> bool:
        """Let a car have the nearest place with room of those that come next; False if there is none.

        Only a car that gets one gives up the place that it had.
        """
        place = self._nearest(car, task)
        if place is None:
            return False
        self._missions.leave(car)
        if place.number != NOT_BOOKED:
            self._missions.bookings.bind(car, place.number)
            self._missions.bookings.book(car)
        task.place = place.name
        return True

    def send(self, car: int, task: Task, tick: int) -> None:
        """Send a car to the place that it has."""
        place = self._places.named(task.place)
        self._missions.enter(car, CarPhase.TO_PLACE)
        # Who is parked there makes room.
        self._missions.changed = True
        goal = self._ways.nearest_state(place, int(self._ways.tails[car]))
        rank_s = EMERGENCY_RANK_S * (task.order.priority is Priority.EMERGENCY)
        self._ways.send(car, goal, rank_s=rank_s, stay=True, tick=tick)

    def call(self, tick: int) -> None:
        """Let cars that are held back go on when there is room."""
        if not self._missions.board.has_visits:
            return
        for car, task in self._visiting(CarPhase.HELD):
            if self._missions.bookings.book(car):
                task.reason = f"car_{car} may go on to {task.place}"
                self._log("called", car=f"car_{car}", task=task.order.name, place=task.place)
                self.send(car, task, tick)

    def leave_s(self, car: int) -> float | None:
        """When a car that stands on a visit goes on [s]; None if that is not known."""
        task = self._missions.task_of[car]
        if task is None or task.visit is None or task.visit.until_full:
            return None
        return float(self._came_s[car]) + task.visit.stand_s

    def has_way(self, car: int, task: Task) -> bool:
        """Whether a car can come to its place."""
        if self._missions.phase[car] is CarPhase.TO_PLACE:
            return self._ways.reaches(car, int(self._ways.goals[car]))
        return self._ways.reaches_place(car, self._places.named(task.place))

    def tick(self, tick: int, now_s: float) -> None:
        """Note who has come, and let those go on who have stood long enough."""
        if not self._missions.board.has_visits:
            return
        for car, task in self._visiting(CarPhase.TO_PLACE):
            if self._ways.has_come(car):
                self._arrive(car, task, now_s)
        for car, task in self._visiting(CarPhase.STANDING, CarPhase.CHARGING):
            if self._has_stood(car, task, now_s):
                self._end_errand(car, task, tick, now_s)

    def _visiting(self, *phases: CarPhase) -> list[tuple[int, Task]]:
        """Cars on visits in some phases, and their tasks."""
        found = [(car, self._missions.task_of[car]) for car in self._missions.cars_in(*phases)]
        return [(car, task) for car, task in found if task is not None and task.visit is not None]

    def _nearest(self, car: int, task: Task) -> Place | None:
        tail = self._ways.tails[[car]]
        best, fewest = None, float(UNREACHABLE)
        for place in map(self._places.named, task.next_errand):
            n_moves = float(self._ways.to_place(place, tail)[0])
            if n_moves < fewest and self._routes.room(place) > 0:
                best, fewest = place, n_moves
        return best

    def _arrive(self, car: int, task: Task, now_s: float) -> None:
        self._came_s[car] = self.progress_s = now_s
        if task.state is TaskState.ASSIGNED:
            self._missions.board.move(task, TaskState.VISITING, now_s, f"car_{car} is at {task.place}")
        if _visit(task).until_full and self._charging is not None:
            self._charging.begin(car)
        else:
            self._missions.enter(car, CarPhase.STANDING)

    def _has_stood(self, car: int, task: Task, now_s: float) -> bool:
        visit = _visit(task)
        if visit.until_full and self._charging is not None:
            return self._charging.is_full(car)
        return bool(now_s - self._came_s[car] >= visit.stand_s)

    def _end_errand(self, car: int, task: Task, tick: int, now_s: float) -> None:
        visit = _visit(task)
        self.progress_s = now_s
        x, y, yaw = (round(float(v), 3) for v in self._world.car_poses()[car])
        pose = {"x": x, "y": y, "yaw": yaw} if visit.inspects else {}
        kind = "inspected" if visit.inspects else "visited"
        self._log(kind, task=task.order.name, car=f"car_{car}", place=task.place, **pose)
        task.n_errands_done += 1
        if task.n_errands_done == len(visit.errands):
            self._missions.board.move(task, TaskState.DONE, now_s, f"car_{car} was at {task.place}")
            self._missions.release(car)
        elif self.book(car, task):
            self.send(car, task, tick)
        else:
            self._hold(car, task, now_s)

    def _hold(self, car: int, task: Task, now_s: float) -> None:
        """Let a car wait in a parking place until there is room where it goes next; give up if there is no way."""
        missions = self._missions
        places = [place for place in map(self._places.named, task.next_errand) if self._ways.reaches_place(car, place)]
        if not places:
            missions.unassign(task, now_s, f"car_{car} has no way to {task.next_words}")
            missions.release(car)
            return
        place = places[0]
        why = missions.bookings.full_words(place.number, place.name)
        task.place = place.name
        missions.bind(car, place.number)
        missions.hold(car, task, why)
        self._log("held", car=f"car_{car}", task=task.order.name, cause=why)


def _visit(task: Task) -> Visit:
    if task.visit is None:
        raise AssertionError(f"task {task.order.name} is no visit")
    return task.visit
