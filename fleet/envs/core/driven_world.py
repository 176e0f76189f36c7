"""Driven world: where agents drive cars themselves, so that cars can run into each other and into what stands there."""

from __future__ import annotations

import math

from fleet.config import Fidelity, RunConfig, require
from fleet.world import make_world
from fleet.world.kinematic import TYRE_GRIP_MPS2, KinematicConfig, KinematicWorld
from fleet.world.protocol import World
from fleet.world.scene import Scene
from maps.lane_graph import LaneGraph


def driven_world(scene: Scene, graph: LaneGraph, config: RunConfig, contact: str) -> World:
    """Make the world.

    Args:
        scene: The world at the start.
        graph: Lanes of the site.
        config: Its site, cars and fidelity.
        contact: What a collision does without physics, see `fleet.world.kinematic.KinematicConfig`.
    """
    if config.fidelity is Fidelity.KINEMATIC:
        return KinematicWorld(scene, KinematicConfig(contact=contact, grip_mps2=TYRE_GRIP_MPS2))
    return make_world(scene, graph, config)


def ticks_of_step(world: World, control_hz: float) -> int:
    """Ticks of a world in one step of agents; the world is closed if that is no whole number.

    Raises:
        ConfigError: It is none.
    """
    ticks = 1.0 / (control_hz * world.tick_s)
    n_ticks = round(ticks)
    fits = n_ticks >= 1 and math.isclose(ticks, n_ticks, rel_tol=1e-6)
    if not fits:
        world.close()
    require(fits, "control_hz", control_hz, f"{1.0 / world.tick_s:.6g} / 1, 2, 3, ...")
    return n_ticks
