"""Worlds: where robots move, at three fidelities behind one protocol."""

from __future__ import annotations

from dataclasses import replace

from fleet.config import Connect, Fidelity, Perception, RunConfig
from fleet.world.grid import GridWorld
from fleet.world.kinematic import KinematicWorld
from fleet.world.protocol import World
from fleet.world.scene import Scene
from maps.lane_graph import LaneGraph


def make_world(scene: Scene, graph: LaneGraph, config: RunConfig) -> World:
    """The world that the configuration asks for."""
    if config.fidelity is Fidelity.PHYSICS:
        # The engine takes a moment to load and is needed by this world alone.
        from fleet.world.bullet.engine.config import BulletConfig
        from fleet.world.bullet.world import BulletWorld

        settings = BulletConfig(
            connect=config.connect,
            shared_memory_key=config.shared_memory_key,
            grip=config.grip,
            grip_force_n=config.grip_force_n,
        )
        physics = config.physics
        if config.connect is not Connect.DIRECT or len(scene.car_start) <= physics.plain_cars_n:
            return BulletWorld(scene, settings)
        from fleet.world.tiled.config import TiledConfig
        from fleet.world.tiled.world import TiledWorld

        seen = replace(settings, visuals=config.perception is Perception.CAMERA)
        return TiledWorld(scene, TiledConfig(bullet=seen, n_cars=physics.tile_cars_n, n_workers=physics.workers_n))
    if config.fidelity is Fidelity.MIXED:
        from fleet.world.mixed.config import MixedConfig
        from fleet.world.mixed.world import MixedWorld

        images = config.perception is Perception.CAMERA
        return MixedWorld(scene, MixedConfig(grip=config.grip, grip_force_n=config.grip_force_n, images=images))
    if config.fidelity is Fidelity.KINEMATIC:
        return KinematicWorld(scene)
    return GridWorld(scene, graph)


def plain_world(scene: Scene, *, physics: bool) -> World:
    """A world of cars alone, with or without physics, as both come."""
    if not physics:
        return KinematicWorld(scene)
    from fleet.world.bullet.world import BulletWorld

    return BulletWorld(scene)
