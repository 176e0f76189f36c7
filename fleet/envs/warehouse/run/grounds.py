"""Grounds: sites, worlds and the arm planner, which last from episode to episode."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from fleet.arrays import FloatArray
from fleet.config import Fidelity, RunConfig
from fleet.envs.warehouse.run.agent_arm_manager import NoPlanner
from fleet.run.setup import RunSetup
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_manager import ArmPlanner
from fleet.stations.arms.arm_planner import make_arm_planner
from fleet.world.kinematic import KinematicConfig, KinematicWorld
from fleet.world.protocol import OpenWorld


@dataclass(kw_only=True)
class Ground:
    """Where runs with so many cars take place."""

    setup: RunSetup
    """With the world."""
    world: OpenWorld
    first: object
    """Its first moment."""
    hits: FloatArray | None = None
    """What the rays of all agents' cars meet at that moment, once it is known."""


class Grounds:
    """The grounds of an environment, one for each number of cars, made when they are first needed.

    Args:
        tick_s: Length of a tick [s].
        physics_hz: Least rate of physics steps.
        plans: Whether arms are planned for.
    """

    def __init__(self, tick_s: float, physics_hz: float, *, plans: bool) -> None:
        self._tick_s = tick_s
        self._physics_hz = physics_hz
        self._plans = plans
        self._grounds: dict[int, Ground] = {}
        self.planner: ArmPlanner = NoPlanner()
        """Plans for the arms that are not agents'."""

    def open(self, config: RunConfig) -> Ground:
        """The ground of a run."""
        if config.robots not in self._grounds:
            setup = RunSetup.of(config)
            world = self._world(setup, config.fidelity)
            # Also the first episode begins as a return to the start, so that it is like all others.
            ground = Ground(setup=replace(setup, world=world), world=world, first=world.save(settle=True))
            self._grounds[config.robots] = ground
            if self._plans and isinstance(self.planner, NoPlanner):
                names = tuple(station.name for station in setup.site.stations)
                self.planner = make_arm_planner(arm_cells(setup.site, setup.scene), names, setup.scene.arms, config)
        return self._grounds[config.robots]

    def has(self, ground: Ground) -> bool:
        """Whether a ground is one of these, and open."""
        return any(ground is known for known in self._grounds.values())

    def close(self) -> None:
        """Free what they hold; calling twice is harmless."""
        for ground in self._grounds.values():
            ground.world.close()
        self.planner.close()
        self._grounds, self.planner = {}, NoPlanner()

    def _world(self, setup: RunSetup, fidelity: Fidelity) -> OpenWorld:
        if fidelity is Fidelity.KINEMATIC:
            return KinematicWorld(setup.scene, KinematicConfig(tick_s=self._tick_s))
        # The engine takes a moment to load and is needed by these worlds alone.
        if fidelity is Fidelity.MIXED:
            from fleet.world.mixed.config import MixedConfig
            from fleet.world.mixed.world import MixedWorld

            return MixedWorld(setup.scene, MixedConfig(tick_s=self._tick_s, images=False))
        from fleet.world.bullet.engine.config import BulletConfig, exact_tick_s
        from fleet.world.bullet.world import BulletWorld

        n_steps = max(1, math.ceil(self._physics_hz * self._tick_s - 1e-6))
        exact_s = exact_tick_s(n_steps, n_steps / self._tick_s)
        return BulletWorld(setup.scene, BulletConfig(tick_s=exact_s, n_steps_per_call=n_steps))
