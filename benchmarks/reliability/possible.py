"""WorkLeft: which tasks can still be done, by a search that shares no code with the fleet.

The search is generous: cars drive every lane forwards and backwards and take every turn there is from lane to lane,
through all cells that are not under a wreck or a box that stays, and live cars make room for each other. But they are
cars: nobody turns on the spot, and no lane is driven nose first against its direction. Where it says no, no fleet that
keeps to its lanes can do the task.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fleet.config.events import CELL, EVENT_KINDS, FOR_GOOD_S
from fleet.missions.phases import GONE, CarPhase
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import Task, TaskState
from maps.site import Site

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


class Parts:
    """Parts of a floor that hang together for cars that drive forwards and backwards along its lanes.

    A car stands in the lane by which its cell is entered. From there it drives on into any lane that leaves the cell,
    but for the one straight back, or backwards into any from which it could have come.

    Args:
        site: The floor.
    """

    def __init__(self, site: Site) -> None:
        self._into, leaving = defaultdict(list), defaultdict(list)
        lanes = [(int(a), int(b)) for a, b in site.lanes]
        for lane, (origin, cell) in enumerate(lanes):
            self._into[cell].append(lane)
            leaving[origin].append(lane)
        self._cell = np.array([cell for _, cell in lanes], dtype=np.int64)
        self._next = np.array(
            [
                (lane, after)
                for lane, (origin, cell) in enumerate(lanes)
                for after in leaving[cell]
                if lanes[after][1] != origin
            ],
            dtype=np.int64,
        ).reshape(-1, 2)
        self._free = site.grid.free.ravel()
        self.cover(np.zeros(len(self._free), dtype=np.bool_))

    def cover(self, covered: npt.NDArray[np.bool_]) -> None:
        """Find the parts anew where nobody can enter the covered cells, shape (n_cells,)."""
        is_open = (self._free & ~covered)[self._cell]
        used = self._next[is_open[self._next].all(axis=1)]
        joined = coo_array((np.ones(len(used)), tuple(used.T)), shape=(len(is_open), len(is_open)))
        numbers: npt.NDArray[np.int32] = connected_components(joined, directed=False)[1]
        self._part = np.where(is_open, numbers, -1)

    def at(self, cell: int) -> frozenset[int]:
        """The parts that a car in a cell may be in, whichever way it came; none in a covered cell."""
        return frozenset(self._part[self._into[cell]].tolist()) - {-1}


class WorkLeft:
    """Follows a run and notes since when each task that is open cannot be done any more.

    Args:
        simulation: The run; `hear` must be told its events.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._parts = Parts(simulation.site)
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
        self._parts.cover(self._covered().ravel())
        tasks = simulation.board.tasks
        for index, before in self._failed:
            if before not in SEARCHED:
                continue
            if self._possible(tasks[index], before):
                self.failed_while_possible.append(f"{tasks[index].order.name}: {tasks[index].reason}")
            else:
                now_s = simulation.sim_s
                self.ended_after_s.append(now_s - self._impossible_since.get(index, now_s))
        self._failed.clear()
        for task in tasks:
            if task.state not in SEARCHED or self._possible(task, task.state):
                self._impossible_since.pop(task.index, None)
            else:
                self._impossible_since.setdefault(task.index, simulation.sim_s)

    def open_while_possible(self) -> list[str]:
        """Names of the tasks that have not ended and can be done."""
        self._parts.cover(self._covered().ravel())
        open_tasks = [task for task in self._simulation.board.tasks if task.state in SEARCHED]
        return [task.order.name for task in open_tasks if self._possible(task, task.state)]

    def open_too_long(self, longest_s: float) -> list[str]:
        """Names of the tasks that have been impossible for longer than so many seconds, and have not ended."""
        tasks, now_s = self._simulation.board.tasks, self._simulation.sim_s
        return [tasks[k].order.name for k, since_s in self._impossible_since.items() if now_s - since_s > longest_s]

    def _possible(self, task: Task, state: TaskState) -> bool:
        """Whether a live car can come to where the parcel is, and on to where it goes, with live arms at both.

        A car that is taken out of service delivers what it carries.
        """
        phases, drop = self._simulation.missions.phase, self._dock(task.delivery.drop)
        if not drop:
            return False
        if state is TaskState.CARRIED:
            car = task.car
            return car is not None and phases[car] is not CarPhase.DEAD and bool(self._parts_of(car) & drop)
        picks = (task.pick,) if task.pick_slot is not None else task.delivery.picks
        both = drop.intersection(frozenset().union(*(self._dock(name) for name in picks)))
        cars = [
            car for car, phase in enumerate(phases) if phase not in GONE and not self._stays("car_out", f"car_{car}")
        ]
        return any(self._parts_of(car) & both for car in cars)

    def _dock(self, name: str) -> frozenset[int]:
        """The parts of the floor that a station's dock is in; none if it is covered, or the arm is dead for good."""
        simulation = self._simulation
        arm = next(station.arm for station in simulation.view.stations if station.name == name)
        if self._stays("arm_dead", f"arm_{arm}") or self._stays("station_closed", name):
            return frozenset()
        return self._parts.at(simulation.site.bays()[name])

    def _parts_of(self, car: int) -> frozenset[int]:
        """The parts of the floor that the middle of a car is in."""
        return self._parts.at(int(self._simulation.site.grid.index(*middle(self._simulation, car))))

    def _stays(self, kind: str, target: str) -> bool:
        """Whether something that has happened lasts for good."""
        until_s = self._going.get((kind, target))
        return until_s is not None and until_s - self._simulation.sim_s > FOR_GOOD_S

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
