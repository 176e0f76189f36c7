"""SimulatedDispatch: the whole fleet, kinematic or in physics, whose tasks are given out by agents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.allotment import Allotment, Choice, Situation
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.envs.dispatch_view import DispatchView
from fleet.envs.grid_fleet import TIMESTEP_S, FleetSite
from fleet.envs.grid_kernel import Counts, Phase
from fleet.roster import CarPhase
from fleet.simulation import Event, Simulation
from fleet.tasks.board import UNDER_WAY, Task, TaskState
from fleet.tasks.order import Delivery
from fleet.tasks.order_file import OrderBook
from fleet.world.protocol import FloatArray

PHASE = dict.fromkeys(CarPhase, Phase.OUT) | {
    CarPhase.IDLE: Phase.FREE,
    CarPhase.TO_PICK: Phase.TO_PICK,
    CarPhase.LOADING: Phase.LOADING,
    CarPhase.TO_DROP: Phase.TO_DROP,
    CarPhase.UNLOADING: Phase.UNLOADING,
}
"""What agents are told of a phase; a car that is held is told what it waits to do."""
_NOT_PICKED = (TaskState.BACKLOG, TaskState.READY, TaskState.ASSIGNED, TaskState.LOADING)


class AgentAllotment(Allotment):
    """Gives the tasks out as agents have chosen, each choice once; nobody changes hands afterwards."""

    chosen: Sequence[tuple[int, Task]] = ()
    """Cars and the tasks they are to have."""

    def choose(self, situation: Situation, now_s: float) -> Choice:
        """See `Allotment`."""
        del now_s
        chosen, self.chosen = self.chosen, ()
        legal = [(car, task) for car, task in chosen if situation.standing[car] is None]
        return Choice(taken=[], given=[(car, task) for car, task in legal if task.state is TaskState.READY])

    def plan_filling(self, situation: Situation, now_s: float) -> None:
        """See `Allotment`; slots are filled in the order of the classes and of the releases."""


class OrderedSimulation(Simulation):
    """A `Simulation` of given deliveries.

    Args:
        config: Everything else that decides the outcome.
        orders: Deliveries, ascending in release.
    """

    books = False

    def __init__(self, config: RunConfig, orders: Sequence[Delivery]) -> None:
        self._given_orders = tuple(orders)
        super().__init__(config)

    def _orders(self, rng: np.random.Generator) -> OrderBook:
        del rng
        return OrderBook(orders=self._given_orders)


class DispatchSimulation(OrderedSimulation):
    """A `Simulation` whose tasks agents give out."""

    allotment_type = AgentAllotment


class FleetCounter:
    """Counts what a simulation's fleet has done, as `GridFleet` does.

    Args:
        simulation: The run, before its first tick.
    """

    def __init__(self, simulation: Simulation) -> None:
        n = simulation.world.n_cars
        self.counts = Counts(delivered=_zero(n), late=_zero(n), empty=_zero(n), open=_zero(1))
        self._simulation = simulation
        self._ticks_n = round(TIMESTEP_S / simulation.tick_s)
        simulation.on_event = self._note

    def tick(self) -> None:
        """Count after a tick."""
        simulation, phase = self._simulation, self._simulation.dispatcher.roster.phase
        to_pick = [car for car, now in enumerate(phase) if now is CarPhase.TO_PICK]
        way_m = np.abs(simulation.world.car_speeds()[to_pick]) * simulation.tick_s
        self.counts.empty[to_pick] += way_m / simulation.site.grid.cell_m
        if simulation.now % self._ticks_n == 0:
            self.counts.open[0] += sum(simulation.board.count(state) for state in _NOT_PICKED)

    def _note(self, event: Event) -> None:
        if event.kind == "task" and event.facts["state"] is TaskState.DELIVERED:
            task = self._simulation.board.named(str(event.facts["task"]))
            if task.car is not None:
                self.counts.delivered[task.car] += 1
                self.counts.late[task.car] += max(0.0, self._simulation.sim_s - task.order.due_s) / TIMESTEP_S


class SimulatedDispatch:
    """A `DispatchFleet` that is a whole simulation.

    Args:
        place: The site.
        site: Its name or path.
        n_cars: Number of cars.
        orders: Deliveries, ascending in release.
        seed: Seed of the run.
        fidelity: `kinematic` or `physics`.
        duration_s: Length of the episode [s].
    """

    def __init__(
        self,
        place: FleetSite,
        site: str,
        n_cars: int,
        orders: Sequence[Delivery],
        seed: int,
        fidelity: Fidelity,
        duration_s: float,
    ) -> None:
        config = RunConfig(
            site=site,
            robots=n_cars,
            fidelity=fidelity,
            seed=seed,
            duration_s=duration_s,
            arms=ArmConfig(workers_n=0),
        )
        self._place = place
        self.simulation = DispatchSimulation(config, orders)
        self._number = {station.name: k for k, station in enumerate(place.site.stations)}
        self._counter = FleetCounter(self.simulation)
        self.counts = self._counter.counts
        # The first tasks become ready in the first tick.
        self.run(self.simulation.tick_s)

    def view(self, left: float) -> DispatchView:
        """See `DispatchFleet`."""
        simulation, number = self.simulation, self._number
        roster, board, now_s = simulation.dispatcher.roster, simulation.board, simulation.sim_s
        ready = board.in_state(TaskState.READY)
        phases = [phase_of(phase, roster.task_of[car]) for car, phase in enumerate(roster.phase)]
        under_way = np.zeros(len(number), dtype=np.int32)
        for task in board.in_state(*UNDER_WAY):
            under_way[number[task.delivery.drop]] += 1
            under_way[number[task.pick]] += task.state in (TaskState.ASSIGNED, TaskState.LOADING)
        return DispatchView(
            now_s=now_s,
            left=left,
            pose=simulation.world.car_poses(),
            state=simulation.executor.tail_states(),
            goal=simulation.traffic.goals.copy(),
            phase=np.array(phases, dtype=np.int8),
            held=np.array([phase is CarPhase.HELD for phase in roster.phase]),
            free=np.array([phase is CarPhase.IDLE for phase in roster.phase]),
            task=np.array([task.index for task in ready], dtype=np.int32),
            pick=np.array([number[task.pick] for task in ready], dtype=np.int32),
            drop=np.array([number[task.delivery.drop] for task in ready], dtype=np.int32),
            rank=np.array([task.order.priority.rank for task in ready], dtype=np.int8),
            age_s=np.array([now_s - task.order.release_s for task in ready], dtype=np.float64),
            due_s=np.array([task.order.due_s - now_s for task in ready], dtype=np.float64),
            under_way=under_way,
            backlog_n=board.count(TaskState.BACKLOG),
        )

    def give(self, pairs: Sequence[tuple[int, int]]) -> None:
        """See `DispatchFleet`; the tasks are given out in the first tick of the next `run`."""
        simulation = self.simulation
        allotment = simulation.dispatcher.allotment
        if pairs and isinstance(allotment, AgentAllotment):
            allotment.chosen = [(car, simulation.board.tasks[task]) for car, task in pairs]
            simulation.dispatcher.roster.changed = True

    def run(self, duration_s: float) -> None:
        """See `DispatchFleet`."""
        for _ in range(round(duration_s / self.simulation.tick_s)):
            self.simulation.tick()
            self._counter.tick()

    def poses(self) -> FloatArray:
        """See `DispatchFleet`."""
        return self.simulation.world.car_poses()

    def forget(self) -> None:
        """See `DispatchFleet`."""
        for count in self.counts:
            count[:] = 0

    def copy(self) -> None:
        """See `DispatchFleet`."""

    def close(self) -> None:
        """See `DispatchFleet`."""
        self.simulation.close()


def phase_of(phase: CarPhase, task: Task | None) -> Phase:
    """What agents are told that a car is about."""
    if phase is CarPhase.HELD and task is not None:
        return Phase.TO_DROP if task.state is TaskState.CARRIED else Phase.TO_PICK
    return PHASE[phase]


def _zero(n: int) -> FloatArray:
    return np.zeros(n)
