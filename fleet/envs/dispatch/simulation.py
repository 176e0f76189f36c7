"""SimulatedDispatch: the whole fleet, kinematic or in physics, whose tasks are given out by agents."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fleet.abstract.fleet import TIMESTEP_S, FleetSite
from fleet.abstract.kernel import NEVER, NONE
from fleet.assembly import Parts
from fleet.config import ArmConfig, Fidelity, RunConfig, TrafficConfig
from fleet.dispatch.allocation import Choice, TaskAllocation
from fleet.dispatch.situation import CAN_TAKE, Situation
from fleet.envs.dispatch.outlook import Jobs, Outlook
from fleet.envs.dispatch.view import DispatchView
from fleet.envs.layers.simulated_fleet import SimulatedFleet
from fleet.missions.phases import NUMBER_OF_PHASE, CarPhase
from fleet.simulation import Simulation
from fleet.tasks.board import UNDER_WAY, Task, TaskState
from fleet.tasks.order import Delivery


class AgentAllocation(TaskAllocation):
    """Gives the tasks out as agents have chosen, each choice once; nobody changes hands afterwards."""

    chosen: Sequence[tuple[int, Task]] = ()
    """Cars and the tasks they are to have."""

    def choose(self, situation: Situation, now_s: float) -> Choice:
        """See `TaskAllocation`."""
        del now_s
        chosen, self.chosen = self.chosen, ()
        legal = [(car, task) for car, task in chosen if situation.standing[car] == CAN_TAKE]
        ready = [(car, task) for car, task in legal if task.state is TaskState.READY]
        return Choice(taken=[], given=[(car, task, f"an agent chose car_{car}") for car, task in ready])


class SimulatedDispatch(SimulatedFleet):
    """A `DispatchFleet` that is a whole simulation.

    Args:
        place: The site.
        simulation: The run, before its first tick.
    """

    def __init__(self, place: FleetSite, simulation: Simulation) -> None:
        super().__init__(simulation)
        self.simulation = simulation
        self._number = {station.name: k for k, station in enumerate(place.site.stations)}

    @classmethod
    def begun(
        cls,
        place: FleetSite,
        site: str,
        n_cars: int,
        orders: Sequence[Delivery],
        seed: int,
        fidelity: Fidelity,
        duration_s: float,
    ) -> SimulatedDispatch:
        """The fleet of a new run, after its first tick.

        Args:
            place: The site.
            site: Its name or path.
            n_cars: Number of cars.
            orders: Deliveries, ascending in release.
            seed: Seed of the run.
            fidelity: `kinematic` or `physics`.
            duration_s: Length of the episode [s].
        """
        config = RunConfig(
            site=site,
            robots=n_cars,
            fidelity=fidelity,
            seed=seed,
            duration_s=duration_s,
            traffic=TrafficConfig(planner="pibt"),  # how cars drive is part of what a version of the environment means
            arms=ArmConfig(workers_n=0),
        )
        parts = Parts(orders=orders, allocation=AgentAllocation, figures=False)
        fleet = cls(place, Simulation(config, parts=parts))
        # The first tasks become ready in the first tick.
        fleet.run(fleet.simulation.tick_s)
        return fleet

    def view(self, left: float) -> DispatchView:
        """See `DispatchFleet`."""
        simulation, number = self.simulation, self._number
        missions, board, now_s = simulation.missions, simulation.board, simulation.sim_s
        ready = sorted(board.in_state(TaskState.READY), key=lambda task: task.index)
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
            phase=self._phases(),
            held=self._held(),
            free=missions.phase_index == NUMBER_OF_PHASE[CarPhase.IDLE],
            task=np.array([task.index for task in ready], dtype=np.int32),
            order=np.array([task.index for task in ready], dtype=np.int32),
            pick=np.array([number[task.pick] for task in ready], dtype=np.int32),
            drop=np.array([number[task.delivery.drop] for task in ready], dtype=np.int32),
            rank=np.array([task.order.rank for task in ready], dtype=np.int8),
            age_s=np.array([now_s - task.order.release_s for task in ready], dtype=np.float64),
            due_s=np.array([task.order.due_s - now_s for task in ready], dtype=np.float64),
            charge=np.ones(len(simulation.missions.phase)),
            chargers_left=0.0,
            under_way=under_way,
        )

    def outlook(self) -> Outlook:
        """See `DispatchFleet`; a service takes what is left of the mean time of its arm."""
        simulation, number = self.simulation, self._number
        missions, board, now_s = simulation.missions, simulation.board, simulation.sim_s
        known = sorted(board.in_state(TaskState.READY, *UNDER_WAY), key=lambda task: task.index)
        row = {task.index: k for k, task in enumerate(known)}
        job = [row.get(task.index, NONE) if task is not None else NONE for task in missions.task_of]
        left = np.zeros(len(job), dtype=np.int32)
        being_served = np.flatnonzero(missions.served >= 0)
        left_s = missions.stations.times.all_left_s(now_s)[being_served]
        left[missions.served[being_served]] = np.ceil(left_s / TIMESTEP_S)
        due_s = np.array([task.order.due_s for task in known], dtype=np.float64)
        jobs = (
            [math.ceil(task.order.release_s / TIMESTEP_S) for task in known],
            np.minimum(due_s / TIMESTEP_S, NEVER),
            [number[task.pick] for task in known],
            [number[task.delivery.drop] for task in known],
            [task.order.rank for task in known],
            [task.index for task in known],
        )
        return Outlook(
            now=math.ceil(now_s / TIMESTEP_S),
            state=simulation.executor.tail_states().astype(np.int32),
            phase=self._phases(),
            left=left,
            job=np.array(job, dtype=np.int32),
            jobs=Jobs(*(np.array(column, dtype=np.int32) for column in jobs)),
            number=np.array([task.index for task in known], dtype=np.int32),
        )

    def give(self, pairs: Sequence[tuple[int, int]]) -> None:
        """See `DispatchFleet`; the tasks are given out in the first tick of the next `run`."""
        simulation = self.simulation
        allocation = simulation.view.assignments.allocation
        if pairs and isinstance(allocation, AgentAllocation):
            allocation.chosen = [(car, simulation.board.tasks[task]) for car, task in pairs]
            simulation.missions.changed = True
