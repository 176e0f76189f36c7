"""WorkLeft: which tasks can still be done, by a search that shares no code with the fleet.

The search is generous: cars turn on the spot and drive every lane both ways, through all cells that are not under a
wreck or a box that stays, and live cars make room for each other. Where it says no, no fleet can do the task.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fleet.config.events import CELL, EVENT_KINDS, FOR_GOOD_S
from fleet.missions.phases import CarPhase
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import Task, TaskState

EVERY_S = 1.0
"""How often the search looks [s]."""
WAITS = frozenset({TaskState.BACKLOG, TaskState.READY, TaskState.ASSIGNED})
"""States of a task whose parcel is on its rack, or not there yet."""
SEARCHED = WAITS | {TaskState.CARRIED}
"""States in which the search has an opinion: else an arm is at work, or nothing is left to do."""


def middle(simulation: Simulation, car: int) -> tuple[int, int]:
    """The cell that the middle of a car's body is in, row and column."""
    x, y, yaw = simulation.world.car_poses()[car]
    spec = simulation.scene.car
    ahead_m = (spec.front_m - spec.rear_m) / 2
    row, col = simulation.site.grid.cell_at(float(x + ahead_m * np.cos(yaw)), float(y + ahead_m * np.sin(yaw)))
    return int(row), int(col)


class WorkLeft:
    """Follows a run and notes since when each task that is open cannot be done any more.

    Args:
        simulation: The run; `hear` must be told its events.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._going: dict[tuple[str, str], float] = {}
        self._failed: list[tuple[int, TaskState]] = []
        self._impossible_since: dict[int, float] = {}
        self._every_ticks = max(1, round(EVERY_S / simulation.view.tick_s))
        self.failed_while_possible: list[str] = []
        """Tasks that failed although the search found a way, with the reason that was given."""
        self.ended_after_s: list[float] = []
        """How long after it had become impossible each task failed [s]."""

    def hear(self, event: Event) -> None:
        """Take in an event of the run."""
        if event.kind in ("disturbance", "disturbance_over"):
            key = str(event.facts["disturbance"]), str(event.facts["target"])
            if event.kind == "disturbance_over":
                self._going.pop(key, None)
            elif EVENT_KINDS[key[0]].lasts:
                lasts_s = event.facts.get("duration_s", EVENT_KINDS[key[0]].lasts_s)
                self._going[key] = event.sim_s + float(str(lasts_s))
        elif event.kind == "task" and event.facts["state"] == TaskState.FAILED:
            task = self._simulation.board.named(str(event.facts["task"]))
            self._failed.append((task.index, TaskState(str(event.facts["before"]))))

    def tick(self) -> None:
        """Look at the run after a tick."""
        simulation = self._simulation
        if not self._failed and simulation.view.now % self._every_ticks:
            return
        parts = self._parts()
        tasks = simulation.board.tasks
        for index, before in self._failed:
            if before not in SEARCHED:
                continue
            if self._possible(tasks[index], before, parts):
                self.failed_while_possible.append(f"{tasks[index].order.name}: {tasks[index].reason}")
            else:
                now_s = simulation.sim_s
                self.ended_after_s.append(now_s - self._impossible_since.get(index, now_s))
        self._failed.clear()
        for task in tasks:
            if task.state not in SEARCHED or self._possible(task, task.state, parts):
                self._impossible_since.pop(task.index, None)
            else:
                self._impossible_since.setdefault(task.index, simulation.sim_s)

    def open_while_possible(self) -> list[str]:
        """Names of the tasks that have not ended and can be done."""
        parts = self._parts()
        open_tasks = [task for task in self._simulation.board.tasks if task.state in SEARCHED]
        return [task.order.name for task in open_tasks if self._possible(task, task.state, parts)]

    def open_too_long(self, longest_s: float) -> list[str]:
        """Names of the tasks that have been impossible for longer than so many seconds, and have not ended."""
        tasks, now_s = self._simulation.board.tasks, self._simulation.sim_s
        return [tasks[k].order.name for k, since_s in self._impossible_since.items() if now_s - since_s > longest_s]

    def _possible(self, task: Task, state: TaskState, parts: npt.NDArray[np.int32]) -> bool:
        """Whether a live car can come to where the parcel is, and on to where it goes, with live arms at both."""
        drop = self._dock(task.delivery.drop, parts)
        if drop == 0:
            return False
        if state is TaskState.CARRIED:
            return task.car is not None and not self._is_dead(task.car) and self._part_of(task.car, parts) == drop
        picks = (task.pick,) if task.pick_slot is not None else task.delivery.picks
        if drop not in (self._dock(name, parts) for name in picks):
            return False
        phases = self._simulation.missions.phase
        cars = [car for car in range(len(phases)) if not self._is_dead(car) and phases[car] is not CarPhase.RETIRED]
        return any(self._part_of(car, parts) == drop for car in cars)

    def _dock(self, name: str, parts: npt.NDArray[np.int32]) -> int:
        """The part of the floor that a station's dock is in; 0 if it is covered, or the arm is dead for good."""
        simulation = self._simulation
        arm = next(station.arm for station in simulation.view.stations if station.name == name)
        if self._stays("arm_dead", f"arm_{arm}") or self._stays("station_closed", name):
            return 0
        return int(parts[simulation.site.grid.row_col(simulation.site.bays()[name])])

    def _part_of(self, car: int, parts: npt.NDArray[np.int32]) -> int:
        """The part of the floor that the middle of a car is in."""
        return int(parts[middle(self._simulation, car)])

    def _is_dead(self, car: int) -> bool:
        return self._simulation.missions.phase[car] is CarPhase.DEAD or self._stays("car_out", f"car_{car}")

    def _stays(self, kind: str, target: str) -> bool:
        """Whether something that has happened lasts for good."""
        until_s = self._going.get((kind, target))
        return until_s is not None and until_s - self._simulation.sim_s > FOR_GOOD_S

    def _parts(self) -> npt.NDArray[np.int32]:
        """Parts of the floor that hang together by lanes, from 1, 0 where nobody can be, shape (rows, cols)."""
        site = self._simulation.site
        free = site.grid.free & ~self._covered()
        lanes = site.lanes[free.ravel()[site.lanes].all(axis=1)]
        n_cells = site.grid.n_cells
        joined = coo_array((np.ones(len(lanes)), (lanes[:, 0], lanes[:, 1])), shape=(n_cells, n_cells))
        parts: npt.NDArray[np.int32] = connected_components(joined, directed=False)[1].reshape(free.shape) + 1
        return np.where(free, parts, 0)

    def _covered(self) -> npt.NDArray[np.bool_]:
        """Cells with any part of a wreck, or with a box that stays, shape (rows, cols)."""
        simulation = self._simulation
        grid, spec = simulation.site.grid, simulation.scene.car
        covered = np.zeros((grid.rows, grid.cols), dtype=np.bool_)
        ahead, left = np.meshgrid(
            np.linspace(-spec.rear_m, spec.front_m, 21), np.linspace(-spec.half_width_m, spec.half_width_m, 11)
        )
        for car, (x, y, yaw) in enumerate(simulation.world.car_poses()):
            if simulation.missions.phase[car] is not CarPhase.DEAD:
                continue
            xs, ys = x + ahead * np.cos(yaw) - left * np.sin(yaw), y + ahead * np.sin(yaw) + left * np.cos(yaw)
            for at in zip(xs.flat, ys.flat, strict=True):
                covered[grid.cell_at(*at)] = True
        for kind, target in self._going:
            if CELL in EVENT_KINDS[kind].targets and self._stays(kind, target):
                row, col = (int(part) for part in target.split(","))
                covered[row, col] = True
        return covered
