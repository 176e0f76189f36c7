"""WarehouseConfig: the settings of the warehouse environment."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from fleet.config import USUAL_MODEL, ArmConfig, BatteryConfig, Fidelity, RunConfig, TrafficConfig, require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.core.env_config import RecordedEnvConfig
from fleet.envs.warehouse.control.actions import ARM_ACTIONS, CAR_ACTIONS
from fleet.envs.warehouse.control.commands import ActionModel
from fleet.envs.warehouse.levels import LEVELS, End, Level
from fleet.envs.warehouse.rewards import RewardWeights
from fleet.envs.warehouse.rows import N_JOINTS
from fleet.envs.warehouse.run.agent_driver import STOP_M, STOP_RAD
from fleet.envs.warehouse.run.agent_simulation import Agents
from fleet.envs.warehouse.run.breakdowns import Breakdowns
from fleet.envs.warehouse.run.grounds import physics_steps
from fleet.envs.warehouse.run.starts import Start
from fleet.envs.warehouse.sensing import Sensing
from fleet.robots import ARMS, CARS
from fleet.robots.arms.kind import ArmKind
from fleet.robots.cars.models import CarModels
from fleet.robots.cars.words import car_configs, read_cars
from fleet.robots.spec import DriveKind
from fleet.run.lanes import lanes_for
from fleet.sensors.lidar import Lidar

FIDELITIES = (Fidelity.KINEMATIC, Fidelity.MIXED, Fidelity.PHYSICS)
LEGS_HZ = 120.0
"""Physics steps per second that the gaits of cars on legs are made for: with twice as many they hardly get on."""
TICKS_HZ = 20.0
"""Least rate of ticks: the car of the classical fleet steers well at it."""


@dataclass(frozen=True, kw_only=True)
class WarehouseConfig(RecordedEnvConfig):
    """Settings of `WarehouseEnv`.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    NAME: ClassVar[str] = "warehouse_v1"
    WEIGHTS: ClassVar[type] = RewardWeights

    level: str = "all"
    """`dock`: one car comes to a dock and stops there; `transfer`: arms move a parcel each between rack and car;
    `pair`: a car comes to a dock and is served; `all`: everything. It decides when an episode ends, and the settings
    that follow where they are None."""
    site: str = "cell"
    """Name of a shipped site or path of a site file."""
    cars: str | None = None
    """Model of each car, those of agents first, in words as `--cars` takes them: MODEL:NUMBER,MODEL:NUMBER; None = all
    are of the usual one."""
    n_cars: int | tuple[int, int] | None = None
    """Cars that are agents; with two numbers, drawn anew for each episode from the first to the second one; None = all
    in `cars`, but none in `transfer`, or without these as the level has it: 1 in `dock` and `pair`, 0 in `transfer`,
    else 2."""
    n_arms: int | None = None
    """Arms that are agents, first ones first; None = none in `dock`, else all of the site."""
    fidelity: str = "kinematic"
    """`kinematic`, `mixed` or `physics`."""
    control_hz: float = 10.0
    """Steps per simulated second."""
    max_cycles: int | None = None  # type: ignore[assignment]
    """Steps after which an episode is truncated; None = 300 in `dock` and `transfer`, 600 in `pair`, else 1200."""
    tasks: int | None = None
    """Deliveries on order in an episode that begins with parked cars, or cars anywhere; None = one per car."""
    classical_cars: int | None = None
    """Cars of the classical fleet, beside those of agents; None = the rest of `cars`, or without these in `transfer`
    one for each dock, else none."""
    start: Start | Mapping[str, Any] | None = None
    """How an episode begins, or what differs there from the level's way; None = parked in `all`, near the dock in
    `dock` and `pair`, in the dock in `transfer`."""
    car_action: str = "drive"
    """`drive`: steering and speed, or yaw rate and speed of a car that turns on the spot; `residual`: both are added to
    those of the classical controller."""
    arm_action: str = "joint"
    """`joint`: velocities of the joints; `tip`: of the tool's tip, which points down; `residual`: added to the plan."""
    speed_mps: float = 1.0
    """Speed of a car at full action, as far as its model goes so fast [m/s]."""
    dead_band: float = 0.1
    """A car brakes when its speed is told to be less than this share of the full one, and its yaw rate, too, if it
    turns on the spot."""
    ramp: bool = False
    """Whether cars approach a told speed within the limits of acceleration of their model in physics, too, as they do
    without it; else as fast as motors and tyres can. Cars that turn on the spot always do, in speed and yaw rate."""
    grants_hold: bool = False
    """Whether cars brake where what they were granted ends, whatever they are told, as in a fleet (`fleet.play`): they
    get 3 cm beyond it. Back they drive as they are told. While they are served they stand."""
    residual: float = 0.3
    """Weight of residual actions."""
    pace: float | None = None
    """Of an arm's residual actions, weight of the pace: plans are played up to so much faster or slower; None = as
    `residual`."""
    hold_s: float = 0.5
    """A grip opens when it was told to for so long without a break [s]."""
    stop_m: float = STOP_M
    """A car that stands is at its stop when it is this close [m]."""
    stop_rad: float = STOP_RAD
    """And this straight [rad]."""
    team_share: float = 0.0
    """Share, from 0 to 1, of what all robots together have loaded, delivered, lost or touched in an agent's reward;
    the rest is for what itself was part of."""
    lidar: bool | Lidar = False
    """Lidar of the agents' cars: True = 36 rays of 5 m, False = none, or a description."""
    camera: tuple[int, int] | None = None
    """Height and width of the images that the agents' cars see, in fidelity physics [px]; None = none."""
    car_sensing: Sensing | Mapping[str, Any] | None = None
    """How well cars observe; None = all of it, at once."""
    arm_sensing: Sensing | Mapping[str, Any] | None = None
    """How well arms observe; None = all of it, at once."""
    breakdowns: Breakdowns | Mapping[str, Any] | None = None
    """How often cars break down; None = never."""
    battery: BatteryConfig | None = None
    """Batteries of the cars; None = they need none."""
    physics_hz: float = 240.0
    """Least rate of physics steps."""
    weights: RewardWeights | None = None
    """What things are worth; None = as `RewardWeights` has it."""

    def __post_init__(self) -> None:
        require(isinstance(self.site, str | Path), "site", self.site, "a name or a path")
        require(self.level in list(LEVELS), "level", self.level, ", ".join(LEVELS))
        require(self.fidelity in FIDELITIES, "fidelity", self.fidelity, ", ".join(FIDELITIES))
        cars_ok = self.cars is None or isinstance(self.cars, str)
        require(cars_ok, "cars", self.cars, f"MODEL:NUMBER,... of the models {', '.join(CARS)}, or None")
        self._fill_in()
        self._check_team()
        _require_number("control_hz", self.control_hz, 0.1, 1000.0)
        _require_number("physics_hz", self.physics_hz, 60.0, 10_000.0)
        require(self.car_action in CAR_ACTIONS, "car_action", self.car_action, ", ".join(CAR_ACTIONS))
        require(self.arm_action in list(ARM_ACTIONS), "arm_action", self.arm_action, ", ".join(ARM_ACTIONS))
        self._check_robots()
        for name in ("ramp", "grants_hold"):
            require(isinstance(getattr(self, name), bool), name, getattr(self, name), "True, False")
        if self.pace is not None:
            _require_number("pace", self.pace, 0.0, 4.0)
        for name, low, high in _RANGES:
            _require_number(name, getattr(self, name), low, high)
        lidar_ok = isinstance(self.lidar, bool | Lidar)
        require(lidar_ok, "lidar", self.lidar, "True, False or a fleet.sensors.lidar.Lidar")
        battery_ok = self.battery is None or isinstance(self.battery, BatteryConfig)
        require(battery_ok, "battery", self.battery, "a fleet.config.BatteryConfig, or None")
        if self.tasks is not None:
            _require_whole("tasks", self.tasks, 1, 10_000, "")
        self._check_camera()
        super().__post_init__()

    @property
    def render_fps(self) -> float:
        """Steps per second of what is drawn."""
        return self.control_hz

    @property
    def car_names(self) -> list[str]:
        """Names of the agents that are cars, of the largest team: `car_0`, of other models than the usual one
        `car_MODEL_0`."""
        return [_named("car", model, USUAL_MODEL, car) for car, model in enumerate(self._models[: self.team_sizes[1]])]

    @property
    def arm_names(self) -> list[str]:
        """Names of the agents that are arms: `arm_0`, of other models than the usual one `arm_MODEL_0`."""
        usual = ArmConfig().model
        return [_named("arm", kind.name, usual, arm) for arm, kind in enumerate(self.arm_kinds)]

    @functools.cached_property
    def arm_kinds(self) -> tuple[ArmKind, ...]:
        """Model of each arm that is an agent."""
        site, usual = self.place.name, ArmConfig().model
        return tuple(
            ARMS.named(station.arm.model or usual, f"site {site}: stations.{station.name}.arm")
            for station in self.place.stations[: self.n_arms]
        )

    @property
    def _models(self) -> tuple[str, ...]:
        """Model of each car, those of the largest team of agents first."""
        if self.cars is not None:
            return read_cars(self.cars, "cars")
        return (USUAL_MODEL,) * (self.team_sizes[1] + (self.classical_cars or 0))

    @property
    def team_sizes(self) -> tuple[int, int]:
        """The least and the greatest number of cars that are agents."""
        sizes = self.n_cars
        return sizes if isinstance(sizes, tuple) else (sizes or 0, sizes or 0)

    def require_lasting_agents(self) -> None:
        """Refuse teams whose size differs between episodes, and agents that may leave before an episode ends.

        Raises:
            ConfigError: They do.
        """
        least, most = self.team_sizes
        require(least == most, "n_cars", self.n_cars, "one number, as arrays have a row for each agent")
        losses_per_h = self.failures.losses_per_h
        require(losses_per_h == 0, "breakdowns.losses_per_h", losses_per_h, "0, as arrays have a row for each agent")
        battery = self.battery is not None and self.battery.enabled
        require(not battery, "battery", "enabled", "none, as arrays have a row for each agent and empty cars leave")

    @property
    def end(self) -> End:
        """When an episode is over."""
        return LEVELS[self.level].end

    @property
    def begins(self) -> Start:
        """How an episode begins."""
        return Start.of(self.start, LEVELS[self.level].start)

    @property
    def failures(self) -> Breakdowns:
        """How often cars break down."""
        return Breakdowns.of(self.breakdowns)

    @functools.cached_property
    def sensing(self) -> tuple[Sensing, Sensing]:
        """How well cars and arms observe."""
        return Sensing.of(self.car_sensing, "car_sensing"), Sensing.of(self.arm_sensing, "arm_sensing")

    @functools.cached_property
    def action_model(self) -> ActionModel:
        """What actions stand for."""
        return ActionModel(
            car=self.car_action,
            arm=self.arm_action,
            speed_mps=self.speed_mps,
            dead_band=self.dead_band,
            residual=self.residual,
            pace=self.residual if self.pace is None else self.pace,
            hold_s=self.hold_s,
            ramp=self.ramp,
            grants_hold=self.grants_hold,
        )

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

    def agents(self, n_cars: int) -> Agents:
        """Robots that agents decide for in an episode with so many cars."""
        n_arms = self.n_arms or 0
        # Nobody plans for arms that no car is to be served by.
        n_still = len(self.place.stations) - n_arms if self.end is End.DOCKED else 0
        return Agents(n_cars=n_cars, n_arms=n_arms, n_still_arms=n_still, stop_m=self.stop_m, stop_rad=self.stop_rad)

    def run_config(self, n_cars: int) -> RunConfig:
        """Settings of the run with so many agents' cars, but for the seed."""
        n_robots = n_cars + (self.classical_cars or 0)
        models = self._models
        return RunConfig(
            site=self.site,
            robots=n_robots,
            cars=car_configs((*models[:n_cars], *models[self.team_sizes[1] :]), n_robots, None),
            tasks=n_robots if self.tasks is None else self.tasks,
            fidelity=Fidelity(self.fidelity),
            traffic=TrafficConfig(planner="pibt"),  # how cars drive is part of what a version of the environment means
            arms=ArmConfig(workers_n=0),
            battery=self.battery or BatteryConfig(),
        )

    def _fill_in(self) -> None:
        """Let the level, and tables, decide what was left open."""
        level, place = LEVELS[self.level], self.place
        n_arms = self.n_arms
        if n_arms is None:
            n_arms = len(place.stations) if level.n_arms is None else level.n_arms
        n_named = None if self.cars is None else len(read_cars(self.cars, "cars"))
        room = len(place.parking)
        require((n_named or 0) <= room, "cars", self.cars, f"at most {room} cars on site {place.name}")
        n_cars: Any = self.n_cars
        if n_cars is None:
            n_cars = level.n_cars if n_named is None or level.n_cars == 0 else n_named
        if isinstance(n_cars, list):
            n_cars = tuple(n_cars)
        classical_cars: Any = self.classical_cars
        if classical_cars is None:
            if n_named is None:
                classical_cars = self._docks_of(level, n_arms)
            else:
                most = n_cars[-1] if isinstance(n_cars, tuple) and n_cars else n_cars
                classical_cars = max(n_named - most, 0) if is_whole(most) else 0
        filled: dict[str, Any] = {
            "n_arms": n_arms,
            "n_cars": n_cars,
            "max_cycles": level.max_cycles if self.max_cycles is None else self.max_cycles,
            "classical_cars": classical_cars,
            "start": Start.of(self.start, level.start),
            "breakdowns": Breakdowns.of(self.breakdowns),
            "car_sensing": Sensing.of(self.car_sensing, "car_sensing"),
            "arm_sensing": Sensing.of(self.arm_sensing, "arm_sensing"),
        }
        for name, value in filled.items():
            object.__setattr__(self, name, value)

    def _docks_of(self, level: Level, n_arms: object) -> int:
        """How many docks the agents' arms have between them, as far as there are cars for them."""
        if not level.with_docks or not is_whole(n_arms):
            return 0
        docks = {station.dock.cell for station in self.place.stations[: max(n_arms, 0)]}
        return min(max(len(docks), 1), len(self.place.parking))

    def _check_team(self) -> None:
        place, n_cars = self.place, self.n_cars
        most_cars, most_arms = len(place.parking), len(place.stations)
        if isinstance(n_cars, tuple):
            ok = len(n_cars) == 2 and all(map(is_whole, n_cars)) and 0 <= n_cars[0] <= n_cars[1] <= most_cars
            valid = f"an integer from 0 to {most_cars} on site {place.name}, or two, ascending"
            require(ok, "n_cars", n_cars, valid)
        else:
            _require_whole("n_cars", n_cars, 0, most_cars, f" on site {place.name}")
        least, most = self.team_sizes
        n_arms = self.n_arms
        _require_whole("n_arms", n_arms, 0, most_arms, f" on site {place.name}, or None for all")
        require(least + (n_arms or 0) >= 1, "n_cars + n_arms", least + (n_arms or 0), "at least one agent")
        room = f" with n_cars {most} on site {place.name}"
        _require_whole("classical_cars", self.classical_cars, 0, most_cars - most, room)
        n_robots = least + (self.classical_cars or 0)
        require(n_robots >= 1, "n_cars + classical_cars", n_robots, "at least one car")
        n_models, n_all = len(self._models), most + (self.classical_cars or 0)
        require(n_models == n_all, "cars", self.cars, f"{n_all} cars, which n_cars + classical_cars are")

    def _check_robots(self) -> None:
        """Refuse models that do not fit the site or the other settings."""
        most = max((kind.n_joints for kind in self.arm_kinds), default=0)
        where = f"joints of an agent's arm on site {self.place.name}"
        require(most <= N_JOINTS, where, most, f"at most {N_JOINTS}")
        models = CarModels.named(self._models)
        if len(models.kinds) == 1 and models.kinds[0].name == USUAL_MODEL:
            return
        carriers = ", ".join(kind.name for kind in models.kinds if kind.lifts is not None)
        require(not carriers, "cars", self.cars, f"models that come to docks, unlike {carriers}")
        valid = "kinematic or physics for cars of several models, or that do not steer"
        alike = len(models.kinds) == 1 and models.kinds[0].steers
        require(alike or self.fidelity != Fidelity.MIXED, "fidelity", self.fidelity, valid)
        if self.fidelity == Fidelity.PHYSICS:
            legs = ", ".join(kind.name for kind in models.kinds if kind.drive is DriveKind.LEGGED)
            tick_s = self.step_s / self.n_ticks
            steps_hz = physics_steps(self.physics_hz, tick_s) / tick_s
            fits = not legs or abs(steps_hz / LEGS_HZ - 1.0) <= 0.1
            require(fits, "physics_hz", self.physics_hz, f"{LEGS_HZ:g}, for cars on legs ({legs})")
        lanes_for(self.place, models)

    def _check_camera(self) -> None:
        camera = self.camera
        if camera is None:
            return
        sizes_ok = isinstance(camera, tuple | list) and all(is_whole(size) and 8 <= size <= 1024 for size in camera)
        require(sizes_ok and len(camera) == 2, "camera", camera, "height and width from 8 to 1024, or None")
        has_light = self.fidelity == Fidelity.PHYSICS
        require(has_light, "camera", camera, "None in fidelities kinematic and mixed, where cars have nothing to see")


_RANGES = (
    ("speed_mps", 0.1, 2.0),
    ("dead_band", 0.0, 0.9),
    ("residual", 0.0, 1.0),
    ("hold_s", 0.0, 10.0),
    ("stop_m", 0.005, 0.5),
    ("stop_rad", 0.01, 1.0),
    ("team_share", 0.0, 1.0),
)
"""Settings that are numbers, with the least and the greatest value."""


def _named(kind: str, model: str, usual: str, number: int) -> str:
    """Name of an agent; the words before its number are its type."""
    return f"{kind}_{number}" if model == usual else f"{kind}_{model}_{number}"


def _require_whole(what: str, value: object, low: int, high: int, where: str) -> None:
    require(is_whole(value) and low <= value <= high, what, value, f"an integer from {low} to {high}{where}")


def _require_number(what: str, value: object, low: float, high: float) -> None:
    require(is_number(value) and bool(low <= value <= high), what, value, f"a number from {low:g} to {high:g}")
