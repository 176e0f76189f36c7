"""Plans: the classical fleet's motions for the transfers that agents' arms are asked for, played beside the run."""

from __future__ import annotations

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.config import ArmConfig
from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_controller import ArmController
from fleet.stations.arms.arm_manager import ArmManager, ArmPlanner
from fleet.stations.arms.arm_planner import make_arm_planner
from fleet.stations.arms.transfer import TransferRequest

LEAST_PACE = 0.1
"""Plans are played at least at this share of their speed."""


class Plans:
    """Plays the plans that the classical fleet makes for the transfers of a run, whatever the arms do.

    Args:
        simulation: The run.
        planner: Plans for its arms.
    """

    def __init__(self, simulation: AgentSimulation, planner: ArmPlanner) -> None:
        scene = simulation.scene
        self._asked: list[TransferRequest | None] = [None] * len(scene.arm_start)
        self._manager = ArmManager(planner, ArmConfig(latency_s=0.0), scene.car, scene.arm_start, simulation.tick_s)
        self._tick = 0

    @property
    def q(self) -> FloatArray:
        """Joint positions [rad], shape (n_arms, n_joints)."""
        return self._manager.q

    @property
    def qd(self) -> FloatArray:
        """Joint velocities [rad/s], shape (n_arms, n_joints)."""
        return self._manager.qd

    @property
    def grip(self) -> BoolArray:
        """Whether tools hold, shape (n_arms,)."""
        return self._manager.grip

    def ask(self, simulation: AgentSimulation) -> None:
        """Ask for plans of the transfers that agents' arms were asked for and that no plan is played for yet."""
        for arm in range(simulation.n_arms):
            transfer = simulation.arm_manager.transfer(arm)
            if transfer is not None and transfer is not self._asked[arm] and self._manager.is_idle(arm):
                self._asked[arm] = transfer
                self._manager.submit(transfer, self._tick)

    def tick(self, held: IntArray) -> None:
        """Play for one tick; `held` is the parcel in each grip, -1 = none, shape (n_arms,)."""
        self._manager.tick(self._tick, held)
        self._tick += 1

    def asked(self, arm: int) -> TransferRequest | None:
        """The transfer that a plan was asked for last."""
        return self._asked[arm]

    def player(self, arm: int) -> ArmController:
        """What plays an arm's plans."""
        return self._manager.services[arm]

    def pace(self, arm: int, factor: float) -> None:
        """Play an arm's plans at a multiple of their speed."""
        self._manager.slow(arm, max(factor, LEAST_PACE))


def planner_of(simulation: AgentSimulation) -> ArmPlanner:
    """The planner of a run's arms."""
    names = tuple(station.name for station in simulation.stations)
    cells = arm_cells(simulation.site, simulation.scene)
    return make_arm_planner(cells, names, simulation.scene.arm, simulation.config)
