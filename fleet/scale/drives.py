"""Drives: what physical cars were told and what they did, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.robots import ArmTeam
from fleet.robots.cars.models import usual_car
from fleet.run.setup import RunSetup
from fleet.simulation import Simulation
from fleet.world.bullet.engine.config import BulletConfig
from fleet.world.bullet.world import BulletWorld
from fleet.world.scene import Scene

FLOOR_M = 1000.0
"""Side of the empty floor on which steps are driven, more than a car can cross [m]."""
HOLD_S = 1.5
"""How long each command of a step lasts: speed and steering settle within half of it [s]."""
STEER_SPEED_MPS = 0.5
"""Speed at which steering is stepped: so slow that tyres do not slip [m/s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveRecord:
    """Commands of cars and what came of them; row k of the states is the moment before command k."""

    tick_s: float
    commands: FloatArray
    """Steering [rad] and speed [m/s], shape (n_ticks, n_cars, 2)."""
    poses: FloatArray
    """Rear axles x, y, yaw, shape (n_ticks + 1, n_cars, 3)."""
    speeds: FloatArray
    """Signed, forward [m/s], shape (n_ticks + 1, n_cars)."""
    steering: FloatArray
    """Of the equivalent bicycle [rad], shape (n_ticks + 1, n_cars)."""


class RecordedWorld(BulletWorld):
    """The physical world, which keeps what its cars were told and what they did."""

    def __init__(self, scene: Scene, config: BulletConfig) -> None:
        super().__init__(scene, config)
        self._commands: list[FloatArray] = []
        self._states = [self._state()]

    def step(self, car_commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: BoolArray) -> None:
        """See `World`."""
        self._commands.append(np.array(car_commands, dtype=np.float64))
        super().step(car_commands, arm_q, arm_qd, grip)
        self._states.append(self._state())

    def drive(self) -> DriveRecord:
        """Everything since the world was made."""
        poses, speeds, steering = (np.array(part) for part in zip(*self._states, strict=True))
        commands = np.array(self._commands).reshape(-1, self.n_cars, 2)
        return DriveRecord(tick_s=self.tick_s, commands=commands, poses=poses, speeds=speeds, steering=steering)

    def _state(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.car_poses(), self.car_speeds(), self.car_steering()


def drive_steps(commands: FloatArray) -> DriveRecord:
    """Drive one car on an empty floor, each command for `HOLD_S`.

    Args:
        commands: Steering [rad] and speed [m/s], shape (n, 2).
    """
    scene = Scene(
        size_m=(FLOOR_M, FLOOR_M),
        boxes=(),
        car_kinds=(usual_car(),),
        car_start=np.array([[FLOOR_M / 2, FLOOR_M / 2, 0.0]]),
        arms=ArmTeam.of(()),
        arm_base=np.zeros((0, 4)),
        arm_start=np.zeros((0, 0)),
    )
    world = RecordedWorld(scene, BulletConfig())
    try:
        nothing, no_grip = np.zeros((0, 0)), np.zeros(0, dtype=np.bool_)
        for command in commands:
            for _ in range(round(HOLD_S / world.tick_s)):
                world.step(command.reshape(1, 2), nothing, nothing, no_grip)
        return world.drive()
    finally:
        world.close()


def speed_steps(n: int, rng: np.random.Generator) -> FloatArray:
    """Commands that step the speed, straight on: up, down to a stand, some of them in reverse, shape (n, 2)."""
    top = usual_car().max_speed_mps
    speeds = rng.uniform(0.25, 1.0, n) * top * rng.choice((-1.0, 1.0), n)
    speeds[1::2] = 0.0
    return np.stack((np.zeros(n), speeds), axis=1)


def steering_steps(n: int, rng: np.random.Generator) -> FloatArray:
    """Commands that step the steering at a low speed, shape (n, 2)."""
    most = usual_car().max_steering_rad
    return np.stack((rng.uniform(-most, most, n), np.full(n, STEER_SPEED_MPS)), axis=1)


def circles(n: int, rng: np.random.Generator) -> FloatArray:
    """Commands for circles, from slow and wide to so fast and tight that tyres slip, shape (n, 2)."""
    spec = usual_car()
    angles = rng.uniform(0.1, 1.0, n) * spec.max_steering_rad * rng.choice((-1.0, 1.0), n)
    return np.stack((angles, rng.uniform(0.25, 1.0, n) * spec.max_speed_mps), axis=1)


def drive_site(site: str, robots: int, seed: int, duration_s: float) -> DriveRecord:
    """Let a fleet deliver on a site, in physics.

    Args:
        site: Name of a shipped site or path of a site file.
        robots: Number of cars.
        seed: Of the run.
        duration_s: Simulated time [s].

    Raises:
        ConfigError: The site has no room for that many cars.
        SiteError: The site cannot be read or served.
    """
    config = RunConfig(
        site=site,
        robots=robots,
        tasks=max(6, robots * int(1 + duration_s / 30.0)),  # more than it can deliver
        seed=seed,
        duration_s=duration_s,
        fidelity=Fidelity.PHYSICS,
        arms=ArmConfig(workers_n=0),
    )
    setup = RunSetup.of(config)
    world = RecordedWorld(setup.scene, BulletConfig())
    try:
        with Simulation(config, setup=replace(setup, world=world)) as simulation:
            while not simulation.finished:
                simulation.tick()
        return world.drive()
    finally:
        world.close()
