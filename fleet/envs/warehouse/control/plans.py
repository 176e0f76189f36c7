"""Plans: the classical fleet's motions for the transfers that agents' arms are asked for, played beside the run."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.config import ArmConfig
from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_controller import ArmController, ArmPhase
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
        self._manager = ArmManager(planner, ArmConfig(latency_s=0.0), scene, simulation.tick_s)
        self._tick_s = simulation.tick_s
        self._max_velocity = scene.arms.max_velocity_radps
        self._paces = [1.0] * len(scene.arm_start)
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
        for arm, pace in enumerate(self._paces):
            possible = self._most_pace(arm, pace)
            if possible != self.player(arm).speed:
                self._manager.slow(arm, possible)
        self._manager.tick(self._tick, held)
        self._tick += 1

    def asked(self, arm: int) -> TransferRequest | None:
        """The transfer that a plan was asked for last."""
        return self._asked[arm]

    def player(self, arm: int) -> ArmController:
        """What plays an arm's plans."""
        return self._manager.services[arm]

    def pace(self, arm: int, factor: float) -> None:
        """Play an arm's plans at a multiple of their speed, as far as its joints can turn so fast."""
        self._paces[arm] = max(factor, LEAST_PACE)

    def _most_pace(self, arm: int, pace: float) -> float:
        """The greatest pace, up to the one that is wanted, at which no joint exceeds its speed limit in a tick."""
        if pace <= 1.0:
            return pace
        if self.player(arm).state is not ArmPhase.MOVING:
            return 1.0  # a plan that lands in this tick begins in it
        for motion, done_s in self.player(arm).ahead:
            if done_s + self._tick_s * pace <= 0.0:
                break
            first = max(int(np.searchsorted(motion.t, done_s, side="right")) - 1, 0)
            last = min(int(np.searchsorted(motion.t, done_s + self._tick_s * pace)), len(motion.t) - 1)
            shares = (np.abs(motion.qd[first : last + 1]) / self._max_velocity[arm, : motion.qd.shape[1]]).max(axis=1)
            # Slow enough for a sample, or so slow that not even the one before it is passed.
            before = motion.t[np.maximum(np.arange(first, last + 1) - 1, first)]
            reached = (before - done_s) / self._tick_s
            pace = min(pace, float(np.maximum(reached, 1.0 / np.maximum(shares, 1e-9)).min()))
        return max(pace, 1.0)


def planner_of(simulation: AgentSimulation) -> ArmPlanner:
    """The planner of a run's arms."""
    names = tuple(station.name for station in simulation.stations)
    cells = arm_cells(simulation.site, simulation.scene)
    return make_arm_planner(cells, names, simulation.scene.arms, simulation.config)
