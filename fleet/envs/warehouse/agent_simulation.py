"""AgentSimulation: a run in which agents decide for some robots and the classical fleet for the others."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.config import Fidelity, RunConfig, require
from fleet.envs.warehouse.agent_arm_manager import AgentArmManager
from fleet.envs.warehouse.agent_driver import AgentDriver
from fleet.simulation import RunSetup, Simulation
from fleet.stations.arms.arm_manager import ArmPlanner


class AgentSimulation(Simulation):
    """A `Simulation` whose driver and desk watch what agents do; every tick needs their `Actions`.

    Orders, allocation, right of way and the judgement of transfers are those of any run. It leaves its world and its
    arm planner open, for the next episode.

    Args:
        config: Everything that decides the outcome, but for the actions.
        ground: Site and world.
        planner: Plans for the arms that are not agents'; its answers depend on the requests alone.
        cars_n: Cars that agents drive, first ones first.
        arms_n: Arms that agents move, first ones first.

    Raises:
        ConfigError: The grid has no steering to decide about.
    """

    books = False
    driver: AgentDriver
    arm_manager: AgentArmManager

    def __init__(self, config: RunConfig, *, ground: RunSetup, planner: ArmPlanner, cars_n: int, arms_n: int) -> None:
        require(config.fidelity is not Fidelity.GRID, "fidelity", str(config.fidelity), "kinematic, physics")
        self.cars_n = cars_n
        self.arms_n = arms_n
        self._planner = planner
        super().__init__(config, ground=ground)

    def close(self) -> None:
        """Nothing to free: world and planner are not its own."""

    def _arm_planner(self) -> ArmPlanner:
        return self._planner

    def _arm_manager(self) -> AgentArmManager:
        scene = self.scene
        return AgentArmManager(
            self.arm_planner,
            self.config.arms,
            scene.car,
            scene.arm_start,
            self.tick_s,
            lost=self._parcel_lost,
            by_agent=frozenset(range(self.arms_n)),
        )

    def _driver(self, start_states: npt.NDArray[np.int32], rng: np.random.Generator) -> AgentDriver:
        return AgentDriver(
            self.graph,
            self.scene.car,
            start_states,
            self.tick_s,
            self.config.estimate,
            rng,
            by_agent=np.arange(len(start_states)) < self.cars_n,
        )
