"""AgentSimulation: a run in which agents decide for some robots and the classical fleet for the others."""

from __future__ import annotations

import numpy as np

from fleet.assembly import Lost, Parts
from fleet.config import Fidelity, RunConfig, require
from fleet.envs.warehouse.agent_arm_manager import AgentArmManager
from fleet.envs.warehouse.agent_driver import AgentDriver
from fleet.run.setup import RunSetup
from fleet.simulation import Simulation
from fleet.stations.arms.arm_manager import ArmPlanner
from fleet.world.protocol import World


class AgentSimulation(Simulation):
    """A `Simulation` whose driver and arm manager watch what agents do; every tick needs their `Actions`.

    Orders, allocation, right of way and the judgement of transfers are those of any run. It leaves its world and its
    arm planner open, for the next episode.

    Args:
        config: Everything that decides the outcome, but for the actions.
        setup: Site and world.
        planner: Plans for the arms that are not agents'; its answers depend on the requests alone.
        n_cars: Cars that agents drive, first ones first.
        n_arms: Arms that agents move, first ones first.

    Raises:
        ConfigError: The grid has no steering to decide about.
    """

    driver: AgentDriver
    arm_manager: AgentArmManager

    def __init__(self, config: RunConfig, *, setup: RunSetup, planner: ArmPlanner, n_cars: int, n_arms: int) -> None:
        require(config.fidelity is not Fidelity.GRID, "fidelity", str(config.fidelity), "kinematic, physics")
        self.n_cars = n_cars
        self.n_arms = n_arms
        parts = Parts(arm_planner=planner, driver=self._driver, arm_manager=self._arm_manager, figures=False)
        super().__init__(config, setup=setup, parts=parts)

    def _arm_manager(
        self, planner: ArmPlanner, setup: RunSetup, config: RunConfig, tick_s: float, lost: Lost
    ) -> AgentArmManager:
        scene, by_agent = setup.scene, frozenset(range(self.n_arms))
        return AgentArmManager(planner, config.arms, scene.car, scene.arm_start, tick_s, lost=lost, by_agent=by_agent)

    def _driver(self, setup: RunSetup, world: World, config: RunConfig, rng: np.random.Generator) -> AgentDriver:
        by_agent = np.arange(len(setup.start_states)) < self.n_cars
        return AgentDriver(
            setup.graph, setup.scene.car, setup.start_states, world.tick_s, config.estimate, rng, by_agent=by_agent
        )
