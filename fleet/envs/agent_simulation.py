"""AgentSimulation: a run in which agents decide for some robots and the classical fleet for the others."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.config import Fidelity, RunConfig, require
from fleet.envs.agent_desk import AgentDesk, NoPlanner
from fleet.envs.agent_driver import AgentDriver
from fleet.simulation import Simulation
from fleet.stations.arm_desk import ArmPlanner


class AgentSimulation(Simulation):
    """A `Simulation` whose driver and desk watch what agents do; every tick needs their `Actions`.

    Orders, allocation, right of way and the judgement of transfers are those of any run.

    Args:
        config: Everything that decides the outcome, but for the actions.
        cars: True if agents drive the cars.
        arms: True if agents move the arms.

    Raises:
        ConfigError: The grid has no steering to decide about, or the site has no room for that many robots.
    """

    driver: AgentDriver
    desk: AgentDesk

    def __init__(self, config: RunConfig, *, cars: bool, arms: bool) -> None:
        require(config.fidelity is not Fidelity.GRID, "fidelity", str(config.fidelity), "kinematic, physics")
        self.cars_by_agent = cars
        self.arms_by_agent = arms
        super().__init__(config)

    def _arm_planner(self) -> ArmPlanner:
        return NoPlanner() if self.arms_by_agent else super()._arm_planner()

    def _desk(self) -> AgentDesk:
        by_agent = frozenset(range(self.world.n_arms)) if self.arms_by_agent else frozenset()
        scene = self.scene
        return AgentDesk(
            self.arm_planner,
            self.config.arms,
            scene.car,
            scene.arm_start,
            self.tick_s,
            lost=self._parcel_lost,
            by_agent=by_agent,
        )

    def _driver(self, start_states: npt.NDArray[np.int32], rng: np.random.Generator) -> AgentDriver:
        return AgentDriver(
            self.graph,
            self.scene.car,
            start_states,
            self.tick_s,
            self.config.estimate,
            rng,
            by_agent=np.full(len(start_states), self.cars_by_agent),
        )
