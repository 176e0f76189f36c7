"""Pods: who may have which, and the cells in which they stand, into which nobody else is let."""

from __future__ import annotations

import math
from collections.abc import Callable

from fleet.missions.places import Places
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.traffic.replanning import Traffic
from fleet.world.pods import NO_CAR, PodLifts
from maps.lane_graph import LaneGraph

_UNDER_WAY = (TaskState.ASSIGNED, TaskState.VISITING)


class Pods:
    """The pods of a site. Each has a storage place; it stands there, or a car has it.

    A cell with a pod is blocked, for carriers without a pod as for all. When the car that fetches the pod stands in the
    only lane that leads there, nobody else can come in before it, and the cell is opened. From when the pod is set down
    nobody is let in any more; when the car has gone, the cell is blocked again.

    Args:
        lifts: The pods of the world; None = there are none.
        places: Where they stand.
        graph: The lanes.
        board: Tells who fetches them.
        traffic: Told which cells are blocked.
        log: Called as ``log(kind, **facts)`` when a pod is lifted or set down.
    """

    def __init__(
        self,
        lifts: PodLifts | None,
        places: Places,
        graph: LaneGraph,
        board: TaskBoard,
        traffic: Traffic,
        log: Callable[..., None],
    ) -> None:
        self._lifts = lifts
        self._board = board
        self._traffic = traffic
        self._log = log
        self._cells: list[int] = graph.state_cell[list(places.storage)].tolist()
        self._homes = graph.state_pose[list(places.storage)]
        self._numbers = {f"pod_{k}": k - 1 for k in range(1, len(self._cells) + 1)}
        self._lost: dict[int, int] = {}  # cars that have given up pods which they had begun to lift, by pod
        self._closed = [False] * len(self._cells)
        self._blocked = [False] * len(self._cells)

    def is_free_for(self, task: Task) -> bool:
        """Whether no other car fetches or has the pod of a visit; True for one without."""
        visit = task.visit
        if visit is None or not visit.pod:
            return True
        others = (other.visit for other in self._board.in_state(*_UNDER_WAY) if other is not task)
        return not self.why_lost(task) and not any(other and other.pod == visit.pod for other in others)

    def number(self, task: Task) -> int:
        """The pod of a visit, -1 for none."""
        return self._numbers.get(task.visit.pod, -1) if task.visit is not None else -1

    def why_lost(self, task: Task) -> str:
        """Why nobody will ever fetch the pod of a visit; empty if somebody may."""
        car = self._lost.get(self.number(task))
        return "" if car is None else f"{task.visit.pod if task.visit else ''} is on car_{car}, which has given it up"

    def give_up(self, car: int, task: Task) -> None:
        """Leave a pod that was begun to be lifted on its car, wherever the plate comes to rest."""
        self._lost[self.number(task)] = car

    def keeps(self, car: int) -> bool:
        """Whether a car has a pod that it has given up."""
        return car in self._lost.values()

    def bring_home(self, car: int) -> bool:
        """Let people take the pod that a car has given up back to its place; False if something else is there."""
        pod = next((pod for pod, loser in self._lost.items() if loser == car), None)
        if pod is None or self._lifts is None:
            return True
        cell, executor = self._cells[pod], self._traffic.executor
        holder, wreck = executor.dependencies.holders()[cell], self._traffic.wreck_of[cell]
        blocked = executor.n_walkers[cell] or (self._traffic.blocked[cell] and wreck != car)
        if blocked or holder not in (NO_CAR, car):
            return False
        self._lifts.put(pod, self._homes[pod])
        del self._lost[pod]
        self._log("pod_brought_home", car=f"car_{car}", pod=f"pod_{pod + 1}")
        return True

    def stands_in(self, cell: int) -> bool:
        """Whether a pod stands in a cell."""
        if self._lifts is None or cell not in self._cells:
            return False
        return bool(self._lifts.carried_by()[self._cells.index(cell)] == NO_CAR)

    def tick(self) -> None:
        """Close and block the cells of pods that nobody fetches."""
        if self._lifts is None:
            return
        fetched = {self.number(task) for task in self._tasks() if task.n_errands_done > 0}
        for pod, cell in enumerate(self._cells):
            if self._blocked[pod] or pod in fetched or pod in self._lost or self._lifts.carried_by()[pod] != NO_CAR:
                continue
            self._closed[pod] = self._closed[pod] or self._traffic.executor.close_if_free(cell)
            if self._closed[pod] and self._traffic.executor.is_free(cell):
                self._blocked[pod] = True
                self._traffic.set_blocked(cell, True)

    def open(self, task: Task) -> None:
        """Let the car that fetches a pod in to it."""
        pod = self.number(task)
        if self._blocked[pod]:
            self._traffic.set_blocked(self._cells[pod], False)
        if self._closed[pod]:
            self._traffic.executor.open(self._cells[pod])
        self._blocked[pod] = self._closed[pod] = False

    def lift(self, car: int, task: Task) -> None:
        """Let a car that stands below a pod lift it."""
        if self._lifts is not None:
            self._lifts.lift(car, self.number(task))

    def lower(self, car: int, task: Task) -> None:
        """Let a car set down its pod where it stands, and nobody else in."""
        if self._lifts is not None:
            pod = self.number(task)
            self._lifts.lower(car)
            self._closed[pod] = True
            self._traffic.executor.close(self._cells[pod])
            self._traffic.executor.dependencies.avoid(self._cells[pod])

    def is_up(self, car: int) -> bool:
        """Whether a car may drive off with its pod."""
        return self._lifts is not None and self._lifts.is_up(car)

    def is_down(self, car: int) -> bool:
        """Whether a car may drive off without its pod."""
        return self._lifts is not None and self._lifts.is_down(car)

    def note(self, kind: str, car: int, task: Task) -> None:
        """Put into the log that a pod was lifted or set down, and how far from its place it is."""
        if self._lifts is None:
            return
        pod = self.number(task)
        x, y, _, _, _, qz, qw = self._lifts.poses()[pod].tolist()
        home_x, home_y, home_yaw = self._homes[pod].tolist()
        off_m = math.hypot(x - home_x, y - home_y)
        off_rad = abs(math.remainder(2.0 * math.atan2(qz, qw) - home_yaw, math.tau))
        self._log(
            kind,
            task=task.order.name,
            car=f"car_{car}",
            pod=task.visit.pod if task.visit else "",
            off_mm=round(1000.0 * off_m, 1),
            off_deg=round(math.degrees(off_rad), 2),
        )

    def _tasks(self) -> list[Task]:
        """Visits that cars are on."""
        return self._board.in_state(*_UNDER_WAY)
