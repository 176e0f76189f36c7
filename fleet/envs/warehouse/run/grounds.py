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
    planner: ArmPlanner
    """Plans for the arms that are not agents'; its answers depend on the requests alone."""
    hits: FloatArray | None = None
    """What the rays of all agents' cars meet at that moment, once it is known."""


class Grounds:
    """The grounds of an environment, one for each team of cars, made when they are first needed.

    Args:
        tick_s: Length of a tick [s].
        physics_hz: Least rate of physics steps.
        plans: Whether arms are planned for.
    """

    def __init__(self, tick_s: float, physics_hz: float, *, plans: bool) -> None:
        self._tick_s = tick_s
        self._physics_hz = physics_hz
        self._plans = plans
        self._grounds: dict[tuple[str, ...], Ground] = {}
        self._planners: dict[tuple[str, ...], ArmPlanner] = {}

    def open(self, config: RunConfig) -> Ground:
        """The ground of a run."""
        models = config.models
        if models not in self._grounds:
            setup = RunSetup.of(config)
            world = self._world(setup, config.fidelity)
            self._grounds[models] = Ground(
                setup=replace(setup, world=world),
                world=world,
                # Also the first episode begins as a return to the start, so that it is like all others.
                first=world.save(settle=True),
                planner=self._planner(setup, config),
            )
        return self._grounds[models]

    def has(self, ground: Ground) -> bool:
        """Whether a ground is one of these, and open."""
        return any(ground is known for known in self._grounds.values())

    def close(self) -> None:
        """Free what they hold; calling twice is harmless."""
        for ground in self._grounds.values():
            ground.world.close()
        for planner in self._planners.values():
            planner.close()
        self._grounds, self._planners = {}, {}

    def _planner(self, setup: RunSetup, config: RunConfig) -> ArmPlanner:
        """The planner for teams of such cars: how high arms stand, and what comes to them, depends on their models."""
        if not self._plans:
            return NoPlanner()
        kinds = tuple(kind.name for kind in setup.scene.car_kinds)
        if kinds not in self._planners:
            names = tuple(station.name for station in setup.site.stations)
            cells = arm_cells(setup.site, setup.scene)
            self._planners[kinds] = make_arm_planner(cells, names, setup.scene.arms, config)
        return self._planners[kinds]

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

        n_steps = physics_steps(self._physics_hz, self._tick_s)
        exact_s = exact_tick_s(n_steps, n_steps / self._tick_s)
        return BulletWorld(setup.scene, BulletConfig(tick_s=exact_s, n_steps_per_call=n_steps))


def physics_steps(physics_hz: float, tick_s: float) -> int:
    """Physics steps of a tick: as many as make at least so many a second."""
    return max(1, math.ceil(physics_hz * tick_s - 1e-6))
