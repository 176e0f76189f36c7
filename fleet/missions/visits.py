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

LIFTING_S = 15.0
"""Longest time in which a pod is lifted or set down [s]; usual are 3 s."""
_LIFTS, _SETS_DOWN = 1, 3
"""Errands of a visit with a pod at which it is lifted and set down."""
_WORDS = {"lifts": "lift", "sets_down": "set down"}


class Visits:
    """Cars on visits: moves, patrols, inspections, charging and parking that somebody has ordered.

    A dock, charger or parking place is booked before a car sets off, so that nobody queues for it in the lanes; where
    a place further on has no room, the car waits in a parking place until there is. A visit that changes hands goes on
    at the errand that had not been done.

    Args:
        missions: What cars are about.
        places: Where cars can be sent.
        routes: Tells where there is room, and who has which pod.
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
        self._pods = routes.pods
        self._world = world
        self._log = log
        self._came_s = np.zeros(world.n_cars)

    def book(self, car: int, task: Task) -> bool:
        """Let a car have the nearest place with room of those that come next; False if there is none.

        Only a car that gets one gives up the place that it had. A visit with a pod needs the pod, too.
        """
        if not self._pods.is_free_for(task):
            return False
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
        if task is None or task.visit is None or task.visit.until_full or self.handles(car):
            return None
        return float(self._came_s[car]) + task.visit.stand_s

    def handles(self, car: int) -> str:
        """What a car that stands is doing with a pod, `lifts` or `sets_down`; empty if nothing."""
        task = self._missions.task_of[car]
        if task is None or task.visit is None or not task.visit.pod:
            return ""
        return {_LIFTS: "lifts", _SETS_DOWN: "sets_down"}.get(task.n_errands_done, "")

    def keeps_pod(self, car: int) -> bool:
        """Whether a car without a task has a pod on its plate."""
        return self._pods.keeps(car)

    def bring_pod_home(self, car: int) -> bool:
        """Let people take the pod from a car that has given it up back to its place; False if they cannot."""
        return self._pods.bring_home(car)

    def pod_stands_in(self, cell: int) -> bool:
        """Whether a pod stands in a cell."""
        return self._pods.stands_in(cell)

    def set_off_again(self, car: int, task: Task, tick: int, now_s: float) -> None:
        """Let a car go on with the visit that it has, from where it has come back to its lane."""
        if self.book(car, task):
            self.send(car, task, tick)
        else:
            self._hold(car, task, now_s)

    def give_up(self, car: int, task: Task, now_s: float, reason: str) -> None:
        """End a visit in vain; a car that has lifted a pod for it keeps the pod, and takes no other task."""
        pod = task.visit.pod if task.visit is not None and task.lifted else ""
        if pod:
            self._pods.give_up(car, task)
        text = f"{reason}; {pod} stays on car_{car}" if pod else reason
        self._missions.board.move(task, TaskState.FAILED, now_s, text)
        self._missions.release(car, CarPhase.RETIRED if pod else CarPhase.IDLE)

    def has_way(self, car: int, task: Task) -> bool:
        """Whether a car can come to its place."""
        if self._missions.phase[car] is CarPhase.TO_PLACE:
            return self._ways.reaches(car, int(self._ways.goals[car]))
        return self._ways.reaches_place(car, self._places.named(task.place))

    def tick(self, tick: int, now_s: float) -> None:
        """Note who has come, and let those go on who have stood long enough."""
        self._pods.tick()
        if not self._missions.board.has_visits:
            return
        for car, task in self._visiting(CarPhase.TO_PLACE):
            if self._ways.has_come(car):
                self._arrive(car, task, now_s)
        for car, task in self._visiting(CarPhase.STANDING, CarPhase.CHARGING):
            if self._has_stood(car, task, now_s):
                self._end_errand(car, task, tick, now_s)
            elif (does := self.handles(car)) and now_s - self._came_s[car] > LIFTING_S:
                self.give_up(car, task, now_s, f"car_{car} did not {_WORDS[does]} the pod within {LIFTING_S:g} s")

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
        if (does := self.handles(car)) == "lifts":
            self._pods.lift(car, task)
            task.lifted = True
        elif does:
            self._pods.lower(car, task)

    def _has_stood(self, car: int, task: Task, now_s: float) -> bool:
        visit = _visit(task)
        if visit.until_full and self._charging is not None:
            return self._charging.is_full(car)
        if visit.pod:
            if task.n_errands_done == 0:
                return True
            if does := self.handles(car):
                return self._pods.is_up(car) if does == "lifts" else self._pods.is_down(car)
        return bool(now_s - self._came_s[car] >= visit.stand_s)

    def _end_errand(self, car: int, task: Task, tick: int, now_s: float) -> None:
        visit = _visit(task)
        self.progress_s = now_s
        self._note_errand(car, task, visit)
        task.n_errands_done += 1
        if task.n_errands_done == _LIFTS and visit.pod:
            self._pods.open(task)
        if task.n_errands_done == len(visit.errands):
            self._missions.board.move(task, TaskState.DONE, now_s, f"car_{car} was at {task.place}")
            self._missions.release(car)
        else:
            self.set_off_again(car, task, tick, now_s)

    def _note_errand(self, car: int, task: Task, visit: Visit) -> None:
        """Put into the log that an errand is done; that a car is beside a pod is not worth a line."""
        if does := self.handles(car):
            self._pods.note("pod_lifted" if does == "lifts" else "pod_set_down", car, task)
            return
        if visit.pod and task.n_errands_done == 0:
            return
        x, y, yaw = (round(float(v), 3) for v in self._world.car_poses()[car])
        pose = {"x": x, "y": y, "yaw": yaw} if visit.inspects else {}
        kind = "inspected" if visit.inspects else "visited"
        self._log(kind, task=task.order.name, car=f"car_{car}", place=task.place, **pose)

    def _hold(self, car: int, task: Task, now_s: float) -> None:
        """Let a car wait in a parking place until there is room where it goes next; give up if there is no way.

        Who has lifted a pod waits in any case.
        """
        missions = self._missions
        every = [self._places.named(name) for name in task.next_errand]
        places = [place for place in every if self._ways.reaches_place(car, place)] or (every if task.lifted else [])
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
