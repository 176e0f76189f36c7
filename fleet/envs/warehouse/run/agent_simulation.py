"""AgentSimulation: a run in which agents decide for some robots and the classical fleet for the others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fleet.assembly import Lost, Parts
from fleet.config import Fidelity, RunConfig, require
from fleet.envs.warehouse.run.agent_arm_manager import AgentArmManager
from fleet.envs.warehouse.run.agent_driver import STOP_M, STOP_RAD, AgentCars, AgentDriver
from fleet.envs.warehouse.run.starts import Beginning, dock_states
from fleet.run.setup import RunSetup
from fleet.simulation import Simulation
from fleet.stations.arms.arm_manager import ArmPlanner
from fleet.tasks.board import TaskState
from fleet.world.protocol import World


@dataclass(frozen=True, kw_only=True)
class Agents:
    """Robots that agents decide for, and how exact they have to be."""

    n_cars: int
    """Cars that agents drive, first ones first."""
    n_arms: int
    """Arms that agents move, first ones first."""
    n_still_arms: int = 0
    """Arms behind them for which nobody plans: they stand still."""
    stop_m: float = STOP_M
    """A standing car is at its stop when it is this close [m]."""
    stop_rad: float = STOP_RAD
    """And this straight [rad]."""


class AgentSimulation(Simulation):
    """A `Simulation` whose driver and arm manager watch what agents do; every tick needs their `Actions`.

    Orders, allocation, right of way and the judgement of transfers are those of any run. It leaves its world and its
    arm planner open, for the next episode.

    Args:
        config: Everything that decides the outcome, but for the actions.
        setup: Site and world; its cars stand where the beginning says.
        planner: Plans for the arms that are not agents'; its answers depend on the requests alone.
        agents: Robots that agents decide for.
        beginning: Where cars are, and what they are about.

    Raises:
        ConfigError: The grid has no steering to decide about.
    """

    driver: AgentDriver
    arm_manager: AgentArmManager

    def __init__(
        self, config: RunConfig, *, setup: RunSetup, planner: ArmPlanner, agents: Agents, beginning: Beginning
    ) -> None:
        require(config.fidelity is not Fidelity.GRID, "fidelity", str(config.fidelity), "kinematic, physics")
        self.n_cars = agents.n_cars
        self.n_arms = agents.n_arms
        self._agents = agents
        self._beginning = beginning
        parts = Parts(
            orders=beginning.orders or None,
            arm_planner=planner,
            driver=self._driver,
            arm_manager=self._arm_manager,
            figures=False,
        )
        super().__init__(config, setup=replace(setup, start_states=beginning.states), parts=parts)
        self._send_on_errands()

    def _send_on_errands(self) -> None:
        """Let cars be on their way to their stations, with their parcels."""
        rules, board = self.dispatcher.rules, self.board
        rules.backlog.release(0.0)
        beginning = self._beginning
        for task, errand, lying in zip(board.tasks, beginning.errands, beginning.lying, strict=False):
            self.missions.assign(errand.car, task, 0.0)
            if errand.loaded:
                why = "the run begins with it in the tray"
                self.view.knowledge.inventory.enter_tray(task, errand.car, lying)
                board.move(task, TaskState.LOADING, 0.0, why)
                board.move(task, TaskState.CARRIED, 0.0, why)
            rules.admission.set_off(errand.car, task, 0, 0.0)

    def _arm_manager(
        self, planner: ArmPlanner, setup: RunSetup, config: RunConfig, tick_s: float, lost: Lost
    ) -> AgentArmManager:
        scene, by_agent = setup.scene, frozenset(range(self.n_arms + self._agents.n_still_arms))
        return AgentArmManager(planner, config.arms, scene, tick_s, lost=lost, by_agent=by_agent)

    def _driver(self, setup: RunSetup, world: World, config: RunConfig, rng: np.random.Generator) -> AgentDriver:
        agents = self._agents
        cars = AgentCars(
            by_agent=np.arange(len(setup.start_states)) < self.n_cars,
            poses=self._beginning.poses,
            docks=frozenset(dock_states(setup.graph, setup.site).ravel().tolist()),
            stop_m=agents.stop_m,
            stop_rad=agents.stop_rad,
        )
        return AgentDriver(
            setup.graph, setup.scene.cars, setup.start_states, world.tick_s, config.estimate, rng, agents=cars
        )
