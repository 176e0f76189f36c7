"""SimulatedTraffic: the whole fleet, kinematic or in physics, whose moves are chosen by agents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fleet.abstract.fleet import TIMESTEP_S
from fleet.abstract.kernel import Ints
from fleet.arrays import FloatArray
from fleet.assembly import Parts
from fleet.config import AllocationConfig, ArmConfig, Fidelity, RunConfig, TrafficConfig
from fleet.envs.layers.simulated_fleet import SimulatedFleet
from fleet.envs.traffic.view import TrafficView
from fleet.simulation import Simulation
from fleet.tasks.order import Delivery
from fleet.traffic.executor import Executor
from fleet.traffic.floor_distances import FloorDistances
from fleet.traffic.replanning import Traffic
from maps.lane_graph import LaneGraph
from planners.mapf.pibt import Stepper
from planners.mapf.problem import NO_GOAL, Plan
from planners.status import Status

N_MOVES_LEFT = 1
"""Granted moves that a car may still have to make when its next one is chosen, so that it need not stop."""


class AgentTraffic(Traffic):
    """Plans no moves: it takes those that agents wish for, as far as they can be made together.

    A plan of one timestep is handed to the executor whenever there are wishes. The cars make its moves in the order
    that the dependency graph allows, whatever their speeds, so nobody collides whatever agents do.
    """

    def __init__(
        self,
        graph: LaneGraph,
        executor: Executor,
        config: TrafficConfig,
        tick_s: float,
        seed: int,
        free: FloorDistances | None = None,
    ) -> None:
        super().__init__(graph, executor, config, tick_s, seed, free)
        self.wanted: Ints | None = None
        """Where each car wishes to go; None once that is decided."""
        self.sent = executor.tail_states().copy()
        """Where each car was sent last."""
        self._stepper = Stepper(graph, self.blocked, seed=seed)

    def tick(self, tick: int) -> bool:
        """Decide on the wishes, if there are new ones; see `Traffic`."""
        if self.wanted is None:
            return False
        wanted, self.wanted = self.wanted, None
        states, self.sent = self.executor.tail_states(), self._decide(tick, wanted)
        self.executor.accept(Plan(states=np.stack((states, self.sent)), status=Status.FEASIBLE, iterations=1))
        self.n_plans += 1
        return True

    def proposed(self, tick: int) -> Ints:
        """Where PIBT would send each car, shape (n_cars,); its chance is not drawn on."""
        salt = self._stepper.salt
        after = self._decide(tick, None)
        self._stepper.salt = salt
        return after

    def locked(self) -> npt.NDArray[np.bool_]:
        """Cars that cannot choose: they are served, stand at their dock, or have not made their moves yet."""
        executor = self.executor
        dependencies, states = executor.dependencies, executor.tail_states()
        busy = [
            dependencies.n_queued(car) > 0 or dependencies.n_granted(car) > N_MOVES_LEFT
            for car in range(len(self.goals))
        ]
        locked: npt.NDArray[np.bool_] = self.fixed | (self.stay & (states == self.goals)) | np.array(busy)
        return locked

    def priority(self, tick: int) -> FloatArray:
        """Who goes first, larger = earlier, shape (n_cars,); see `TrafficView`."""
        waited_s = (tick - self._goal_since) * self._tick_s + self.rank
        content = (self.goals == NO_GOAL) | (self.executor.tail_states() == self.goals)
        priority: FloatArray = np.where(content, -1.0, waited_s / TIMESTEP_S)
        return priority

    def _decide(self, tick: int, wished: Ints | None) -> Ints:
        if not self._stepper.fits(self.graph, self.blocked):
            self._stepper = Stepper(self.graph, self.blocked, seed=self._stepper.salt)
        states = self.executor.tail_states()
        after = np.empty_like(states)
        distances, row = self.ways.rows(self.goals)
        self._stepper.step(
            states,
            after,
            distances=distances,
            row=row,
            order=np.argsort(-self.priority(tick), kind="stable").astype(np.int32),
            locked=self.locked(),
            allow_rotation=False,
            wished=wished,
        )
        return after


class TrafficSimulation(Simulation):
    """A `Simulation` whose cars agents send from state to state."""

    traffic: AgentTraffic


class SimulatedTraffic(SimulatedFleet):
    """A `TrafficFleet` that is a whole simulation.

    Args:
        simulation: The run, before its first tick.
    """

    def __init__(self, simulation: TrafficSimulation) -> None:
        super().__init__(simulation)
        self.simulation = simulation

    @classmethod
    def begun(
        cls,
        site: str,
        n_cars: int,
        orders: Sequence[Delivery],
        seed: int,
        fidelity: Fidelity,
        duration_s: float,
    ) -> SimulatedTraffic:
        """The fleet of a new run, after its first tick.

        Args:
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
            allocation=AllocationConfig(allocator="greedy"),
            arms=ArmConfig(workers_n=0),
        )
        parts = Parts(orders=orders, traffic=AgentTraffic, figures=False)
        fleet = cls(TrafficSimulation(config, parts=parts))
        # The first tasks are given out, and goals with them.
        fleet.run(fleet.simulation.tick_s)
        return fleet

    def view(self) -> TrafficView:
        """See `TrafficFleet`."""
        simulation = self.simulation
        traffic = simulation.traffic
        return TrafficView(
            state=simulation.executor.tail_states(),
            goal=traffic.goals.copy(),
            phase=self._phases(),
            held=self._held(),
            locked=traffic.locked(),
            priority=traffic.priority(simulation.now),
            proposed=traffic.proposed(simulation.now),
        )

    def move(self, wanted: Ints) -> Ints:
        """See `TrafficFleet`."""
        self.simulation.traffic.wanted = wanted.astype(np.int32)
        self.run(TIMESTEP_S)
        return self.simulation.traffic.sent
