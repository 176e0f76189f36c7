"""WarehouseConfig: the settings of the warehouse environment."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from fleet.config import ArmConfig, Fidelity, RunConfig, require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.core.env_config import RecordedEnvConfig
from fleet.envs.warehouse.hands import N_TIP
from fleet.envs.warehouse.rewards import RewardWeights
from fleet.robots.iiwa import N_JOINTS
from fleet.sensors.lidar import Lidar

FIDELITIES = (Fidelity.KINEMATIC, Fidelity.PHYSICS)
ARM_ACTIONS = {"joint": N_JOINTS, "tip": N_TIP}
"""Ways to move an arm, and how many entries each has, without the grip."""
TICKS_HZ = 20.0
"""Least rate of ticks: the car of the classical fleet steers well at it."""


@dataclass(frozen=True, kw_only=True)
class WarehouseConfig(RecordedEnvConfig):
    """Settings of `WarehouseEnv`.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    NAME: ClassVar[str] = "warehouse_v0"
    WEIGHTS: ClassVar[type] = RewardWeights

    site: str = "small"
    """Name of a shipped site or path of a site file."""
    n_cars: int = 2
    """Cars that are agents."""
    n_arms: int | None = None
    """Arms that are agents, first ones first; None = all of the site."""
    fidelity: str = "physics"
    """`kinematic` or `physics`."""
    control_hz: float = 10.0
    """Steps per simulated second."""
    max_cycles: int = 1200
    """Steps after which an episode is truncated."""
    tasks: int | None = None
    """Deliveries on order in an episode; None = one per car."""
    classical_cars: int = 0
    """Cars of the classical fleet, beside those of agents."""
    arm_action: str = "joint"
    """`joint` or `tip`."""
    lidar: bool | Lidar = True
    """Lidar of the agents' cars: True = 36 rays of 5 m, False = none, or a description."""
    camera: tuple[int, int] | None = None
    """Height and width of the images that the agents' cars see, in fidelity physics [px]; None = none."""
    physics_hz: float = 240.0
    """Least rate of physics steps."""
    weights: RewardWeights | None = None
    """What things are worth; None = as `RewardWeights` has it."""

    def __post_init__(self) -> None:
        require(isinstance(self.site, str | Path), "site", self.site, "a name or a path")
        self._check_team()
        require(self.fidelity in FIDELITIES, "fidelity", self.fidelity, ", ".join(FIDELITIES))
        _require_number("control_hz", self.control_hz, 0.1, 1000.0)
        _require_number("physics_hz", self.physics_hz, 60.0, 10_000.0)
        require(self.arm_action in list(ARM_ACTIONS), "arm_action", self.arm_action, ", ".join(ARM_ACTIONS))
        lidar_ok = isinstance(self.lidar, bool | Lidar)
        require(lidar_ok, "lidar", self.lidar, "True, False or a fleet.sensors.lidar.Lidar")
        if self.tasks is not None:
            _require_whole("tasks", self.tasks, 1, 10_000, "")
        self._check_camera()
        super().__post_init__()

    @property
    def render_fps(self) -> float:
        """Steps per second of what is drawn."""
        return self.control_hz

    @property
    def arms(self) -> list[str]:
        """Names of the agents that are arms."""
        n_arms = len(self.place.stations) if self.n_arms is None else self.n_arms
        return [f"arm_{arm}" for arm in range(n_arms)]

    @property
    def n_entries(self) -> int:
        """Entries of an arm's action, without the grip."""
        return ARM_ACTIONS[self.arm_action]

    @property
    def car_lidar(self) -> Lidar | None:
        """Lidar of the agents' cars; None = none."""
        if isinstance(self.lidar, bool):
            return Lidar() if self.lidar else None
        return self.lidar

    @property
    def step_s(self) -> float:
        """Simulated time of a step [s]."""
        return 1.0 / self.control_hz

    @property
    def n_ticks(self) -> int:
        """Ticks of a step."""
        return max(1, math.ceil(TICKS_HZ / self.control_hz - 1e-9))

    @property
    def run_config(self) -> RunConfig:
        """Settings of the run whose robots agents take over, but for the seed."""
        n_robots = self.n_cars + self.classical_cars
        return RunConfig(
            site=self.site,
            robots=n_robots,
            tasks=n_robots if self.tasks is None else self.tasks,
            fidelity=Fidelity(self.fidelity),
            arms=ArmConfig(workers_n=0),
        )

    def _check_team(self) -> None:
        place, n_cars = self.place, self.n_cars
        most_cars, most_arms = len(place.parking), len(place.stations)
        _require_whole("n_cars", n_cars, 0, most_cars, f" on site {place.name}")
        n_arms = most_arms if self.n_arms is None else self.n_arms
        _require_whole("n_arms", n_arms, 0, most_arms, f" on site {place.name}, or None for all")
        require(n_cars + n_arms >= 1, "n_cars + n_arms", n_cars + n_arms, "at least one agent")
        room = f" with n_cars {n_cars} on site {place.name}"
        _require_whole("classical_cars", self.classical_cars, 0, most_cars - n_cars, room)
        n_robots = n_cars + self.classical_cars
        require(n_robots >= 1, "n_cars + classical_cars", n_robots, "at least one car")

    def _check_camera(self) -> None:
        camera = self.camera
        if camera is None:
            return
        sizes_ok = isinstance(camera, tuple | list) and all(is_whole(size) and 8 <= size <= 1024 for size in camera)
        require(sizes_ok and len(camera) == 2, "camera", camera, "height and width from 8 to 1024, or None")
        has_light = self.fidelity == Fidelity.PHYSICS
        require(has_light, "camera", camera, "None in fidelity kinematic, which has nothing to see")


def _require_whole(what: str, value: object, low: int, high: int, where: str) -> None:
    require(is_whole(value) and low <= value <= high, what, value, f"an integer from {low} to {high}{where}")


def _require_number(what: str, value: object, low: float, high: float) -> None:
    require(is_number(value) and bool(low <= value <= high), what, value, f"a number from {low:g} to {high:g}")
