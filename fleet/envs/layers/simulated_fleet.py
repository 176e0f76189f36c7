"""SimulatedFleet: the whole fleet, kinematic or in physics, as far as it is alike whatever agents decide."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.abstract.fleet import TIMESTEP_S
from fleet.abstract.kernel import Counts, Phase
from fleet.arrays import FloatArray
from fleet.missions.phases import NUMBER_OF_PHASE, CarPhase
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import Task, TaskState

PHASE = dict.fromkeys(CarPhase, Phase.OUT) | {
    CarPhase.IDLE: Phase.FREE,
    CarPhase.TO_PICK: Phase.TO_PICK,
    CarPhase.LOADING: Phase.LOADING,
    CarPhase.TO_DROP: Phase.TO_DROP,
    CarPhase.UNLOADING: Phase.UNLOADING,
}
"""What agents are told of a phase; a car that is held is told what it waits to do."""
_NOT_PICKED = (TaskState.BACKLOG, TaskState.READY, TaskState.ASSIGNED, TaskState.LOADING)


class FleetCounter:
    """Counts what a simulation's fleet has done, as `GridFleet` does.

    Args:
        simulation: The run, before its first tick.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.counts = Counts.of(simulation.world.n_cars, np.float64)
        self._simulation = simulation
        self._n_ticks = round(TIMESTEP_S / simulation.tick_s)
        simulation.events.subscribe(self._note)

    def tick(self) -> None:
        """Count after a tick."""
        simulation = self._simulation
        to_pick = simulation.missions.cars_in(CarPhase.TO_PICK)
        way_m = np.abs(simulation.world.car_speeds()[to_pick]) * simulation.tick_s
        self.counts.empty[to_pick] += way_m / simulation.site.grid.cell_m
        if simulation.now % self._n_ticks == 0:
            self.counts.open[0] += sum(simulation.board.count(state) for state in _NOT_PICKED)

    def _note(self, event: Event) -> None:
        if event.kind == "task" and event.facts["state"] is TaskState.DELIVERED:
            task = self._simulation.board.named(str(event.facts["task"]))
            if task.car is not None:
                self.counts.delivered[task.car] += 1
                self.counts.late[task.car] += max(0.0, self._simulation.sim_s - task.order.due_s) / TIMESTEP_S


class SimulatedFleet:
    """A `Fleet` that is a whole simulation.

    Args:
        simulation: The run, before its first tick.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._run = simulation
        self._counter = FleetCounter(simulation)
        self.counts = self._counter.counts

    def run(self, duration_s: float) -> None:
        """Let time pass."""
        for _ in range(round(duration_s / self._run.tick_s)):
            self._run.tick()
            self._counter.tick()

    def poses(self) -> FloatArray:
        """See `Fleet`."""
        return self._run.world.car_poses()

    def forget(self) -> None:
        """See `Fleet`."""
        self.counts.forget()

    def copy(self) -> None:
        """See `Fleet`."""

    def close(self) -> None:
        """See `Fleet`."""
        self._run.close()

    def _phases(self) -> npt.NDArray[np.int8]:
        """What agents are told that each car is about, shape (n_cars,)."""
        missions = self._run.missions
        phases = [phase_of(phase, missions.task_of[car]) for car, phase in enumerate(missions.phase)]
        return np.array(phases, dtype=np.int8)

    def _held(self) -> npt.NDArray[np.bool_]:
        """Cars that are held back, shape (n_cars,)."""
        held: npt.NDArray[np.bool_] = self._run.missions.phase_index == NUMBER_OF_PHASE[CarPhase.HELD]
        return held


def phase_of(phase: CarPhase, task: Task | None) -> Phase:
    """What agents are told that a car is about."""
    if phase is CarPhase.HELD and task is not None:
        return Phase.TO_DROP if task.state is TaskState.CARRIED else Phase.TO_PICK
    return PHASE[phase]
