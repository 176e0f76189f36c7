"""Settings of a run: one tree of frozen dataclasses; a run is fully described by its `RunConfig`."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from pathlib import Path

from fleet.errors import ConfigError
from fleet.kinds import misfits

MOST_TASKS_N = 1_000_000
"""As many orders take half a minute to make, and 1.5 GB."""


class Fidelity(StrEnum):
    """How robots are moved."""

    PHYSICS = "physics"
    KINEMATIC = "kinematic"
    GRID = "grid"


class Grip(StrEnum):
    """How an arm holds a parcel."""

    SUCTION = "suction"
    FRICTION = "friction"


class Perception(StrEnum):
    """How it is known where a parcel lies that an arm is to pick."""

    TRUTH = "truth"
    """From the world itself."""
    CAMERA = "camera"
    """From an image of the station's camera."""


class Connect(StrEnum):
    """How the physics engine is reached."""

    DIRECT = "DIRECT"
    GUI = "GUI"
    SHARED_MEMORY = "SHARED_MEMORY"


class StreamKind(StrEnum):
    """How generated orders arrive, and how they spread over the stations."""

    POISSON = "poisson"
    """One by one at a mean rate, all stations alike."""
    WAVES = "waves"
    """Many at once, then none for a while, at the same mean rate."""
    SKEWED = "skewed"
    """As `poisson`; few stations get most orders."""
    SKEWED_WAVES = "skewed_waves"


def require(ok: bool, what: str, value: object, valid: str) -> None:
    """Refuse a setting outside its valid range.

    Args:
        ok: The verdict.
        what: Name of the setting as a user types it.
        value: The refused value.
        valid: Description of the valid choices.

    Raises:
        ConfigError: `ok` is False.
    """
    if not ok:
        raise ConfigError(f"{what} is {value!r}; valid: {valid}")


def _positive(what: str, value: float) -> None:
    require(math.isfinite(value) and value > 0, what, value, "a number > 0")


class _Settings:
    """Fields that hold what is declared: 2.5 robots, or a text, would only be noticed in the middle of a run."""

    def __post_init__(self) -> None:
        for name, value, valid in misfits(self):
            require(False, f"{type(self).__name__}.{name}", value, valid)


def _not_negative(what: str, value: float) -> None:
    require(math.isfinite(value) and value >= 0, what, value, "a number >= 0")


@dataclass(frozen=True, kw_only=True)
class TrafficConfig(_Settings):
    """Multi-agent path finding and its execution."""

    planner: str = "pibt"
    """Name in `planners.mapf.PLANNERS`."""
    horizon_n: int = 12
    """Timesteps a plan looks ahead."""
    period_s: float = 1.0
    """Simulated time between two planning requests [s]."""
    latency_s: float = 0.1
    """Simulated time from a request to the tick at which its plan lands [s]."""
    iterations_n: int = 1000
    """Budget of one request, in the planner's own unit; what is not planned then is left to the next request."""
    commit_moves_n: int = 2
    """Moves beyond the granted ones that a car may still execute while a request is under way."""
    grant_moves_n: int = 3
    """Moves a car may hold a grant for at once: enough to brake from full speed inside them."""
    reorder_after_s: float = 2.0
    """A car that waits that long at a free cell for one that comes first and is late may go first [s]; inf = never."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.horizon_n >= 1, "traffic.horizon_n", self.horizon_n, "an integer >= 1")
        _positive("traffic.period_s", self.period_s)
        _not_negative("traffic.latency_s", self.latency_s)
        require(self.iterations_n >= 1, "traffic.iterations_n", self.iterations_n, "an integer >= 1")
        require(self.commit_moves_n >= 0, "traffic.commit_moves_n", self.commit_moves_n, "an integer >= 0")
        require(self.grant_moves_n >= 1, "traffic.grant_moves_n", self.grant_moves_n, "an integer >= 1")
        require(self.reorder_after_s > 0, "traffic.reorder_after_s", self.reorder_after_s, "a number > 0, or inf")


@dataclass(frozen=True, kw_only=True)
class AllocationConfig(_Settings):
    """Who gets which task."""

    allocator: str = "hungarian"
    """Name in `planners.allocation.ALLOCATORS`, or `package.module.Class` of one's own."""
    station_cap_n: int = 2
    """Cars near or at one station at once, the one that is served included; more would queue into the aisles."""
    ageing: float = 0.5
    """Seconds of travel that one second of waiting since the release is worth, so that no task starves."""
    lateness: float = 1.0
    """Seconds of travel that one second of lateness is worth."""
    late_s: float = 300.0
    """Seconds of travel that it is worth not to be late at all, for allocators that plan ahead."""
    keep_gain_s: float = 5.0
    """A car that is under way to a pick station gives its task away only if more than this is gained [s] ..."""
    keep_share: float = 0.1
    """... and more than this share of what the task costs it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.station_cap_n >= 1, "allocation.station_cap_n", self.station_cap_n, "an integer >= 1")
        _not_negative("allocation.ageing", self.ageing)
        _not_negative("allocation.lateness", self.lateness)
        _not_negative("allocation.late_s", self.late_s)
        _not_negative("allocation.keep_gain_s", self.keep_gain_s)
        require(0 <= self.keep_share <= 1, "allocation.keep_share", self.keep_share, "a number from 0 to 1")


@dataclass(frozen=True, kw_only=True)
class TimeoutConfig(_Settings):
    """How long a task may stay in a state before something is done about it [s]; inf = for ever."""

    waiting_s: float = math.inf
    """From the release until a car has it; then it is cancelled."""
    assigned_s: float = 900.0
    """On the way to the pick station, or the first place of a visit; then another car gets it, if there is one."""
    service_s: float = math.inf
    """At a dock; then it fails, and the car goes on when the arm is clear."""
    carried_s: float = math.inf
    """From the pick dock to the drop dock; then it fails, and the car takes no more tasks."""
    visiting_s: float = math.inf
    """From the first place of a visit to its end; then it fails, and the car is free."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("waiting_s", "assigned_s", "service_s", "carried_s", "visiting_s"):
            require(getattr(self, name) > 0, f"timeouts.{name}", getattr(self, name), "a number > 0, or inf")


@dataclass(frozen=True, kw_only=True)
class ArmConfig(_Settings):
    """Planning and timing of the arms."""

    planner: str = "rrt_connect"
    """Name in `planners.motion.MOTION_PLANNERS`, or one of the names in `OMPL_PLANNERS` there."""
    latency_s: float = 0.25
    """Simulated time from a request to the tick at which its plan lands [s]."""
    iterations_n: int = 20_000
    """Budget of one transit search."""
    workers_n: int = 1
    """Planning processes; 0 plans inside the simulation's own process. The result is the same."""
    velocity_radps: float | None = None
    """Speed limit of every joint [rad/s]; None = those of the real arm, joint by joint."""
    acceleration_radps2: float | None = None
    """The same for accelerations [rad/s^2]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _not_negative("arms.latency_s", self.latency_s)
        for name in ("velocity_radps", "acceleration_radps2"):
            limit = getattr(self, name)
            require(limit is None or 0 < limit <= 100, f"arms.{name}", limit, "a number > 0, at most 100, or None")
        require(self.iterations_n >= 1, "arms.iterations_n", self.iterations_n, "an integer >= 1")
        require(self.workers_n in (0, 1), "arms.workers_n", self.workers_n, "0 or 1")


@dataclass(frozen=True, kw_only=True)
class EstimateConfig(_Settings):
    """Pose estimate that the cars steer by."""

    noise_m: float = 0.01
    """Standard deviation of a position measurement [m]."""
    noise_rad: float = math.radians(0.5)
    """Standard deviation of a heading measurement [rad]."""
    latency_ticks: int = 1
    """Age of a measurement when it arrives."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _not_negative("estimate.noise_m", self.noise_m)
        _not_negative("estimate.noise_rad", self.noise_rad)
        require(0 <= self.latency_ticks <= 30, "estimate.latency_ticks", self.latency_ticks, "an integer from 0 to 30")


RATES_PER_H = (1e-3, 1e5)
"""Least and greatest rate of a stream: from one order in six weeks to more than any site can take."""


@dataclass(frozen=True, kw_only=True)
class StreamConfig(_Settings):
    """A stream of generated orders with due dates and priorities."""

    kind: StreamKind = StreamKind.POISSON
    rate_per_h: float = 120.0
    """Mean number of orders per hour."""
    wave_s: float = 600.0
    """Time from the beginning of one wave to that of the next [s]."""
    wave_share: float = 0.2
    """Part of that time in which the orders of a wave arrive."""
    zipf: float = 1.0
    """Exponent of a skewed stream: the k-th most popular station is drawn with a weight of 1 / k ** zipf."""
    due_share: float = 0.8
    """Part of the orders that have a due date."""
    slack_s: tuple[float, float] = (120.0, 600.0)
    """Least and greatest time from release to due date [s], drawn evenly."""
    emergency_share: float = 0.05
    """Part of the orders in the class `emergency`."""
    idle_share: float = 0.15
    """Part of the orders in the class `idle`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.kind in list(StreamKind), "--stream", self.kind, ", ".join(StreamKind))
        object.__setattr__(self, "kind", StreamKind(self.kind))
        low_n, high_n = RATES_PER_H
        require(low_n <= self.rate_per_h <= high_n, "--rate", self.rate_per_h, f"a number from {low_n:g} to {high_n:g}")
        _positive("stream.wave_s", self.wave_s)
        _not_negative("stream.zipf", self.zipf)
        require(0 < self.wave_share <= 1, "stream.wave_share", self.wave_share, "a number > 0, at most 1")
        for name in ("due_share", "emergency_share", "idle_share"):
            require(0 <= getattr(self, name) <= 1, f"stream.{name}", getattr(self, name), "a number from 0 to 1")
        classes = self.emergency_share + self.idle_share
        require(classes <= 1, "stream.emergency_share + stream.idle_share", classes, "at most 1")
        low, high = self.slack_s
        require(0 <= low <= high < math.inf, "stream.slack_s", self.slack_s, "two numbers >= 0, ascending")


@dataclass(frozen=True, kw_only=True)
class CarConfig(_Settings):
    """What sets one car apart from others of its model."""

    capabilities: tuple[str, ...] = ()
    """Names that orders can ask for in `needs`."""
    max_payload_kg: float | None = None
    """Greatest parcel it may carry [kg]; None = what its model can."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_payload_kg is not None:
            _positive("max_payload_kg", self.max_payload_kg)


@dataclass(frozen=True, kw_only=True)
class BatteryConfig(_Settings):
    """Batteries and when cars go to charge; charges are shares of the capacity, from 0 to 1."""

    enabled: bool = False
    """Off: cars never need to charge."""
    capacity_wh: float = 55.5
    """A pack of three lithium-polymer cells with 5 Ah (11.1 V), usual in cars of this size [Wh]."""
    awake_w: float = 15.0
    """Computer (a Jetson TX2 takes 7.5 to 15 W), lidar and radio of a car at work [W]."""
    asleep_w: float = 2.0
    """The same of a car that is parked: radio and wake-up only [W]."""
    charge_w: float = 111.0
    """Twice the capacity in an hour, which such cells endure [W]."""
    start: float = 1.0
    """Charge of all cars at the start."""
    low: float = 0.3
    """Below this a car without a task goes to charge."""
    critical: float = 0.15
    """Below this a car goes to charge as soon as it has no parcel, and gives back the task it was going for."""
    enough: float = 0.6
    """From here on a charging car may be given a task, and makes room for one that needs the charger."""
    idle_below: float = 0.8
    """An idle car charges when it has less than this and a charger is free."""
    full: float = 0.95
    """A car with this much leaves the charger."""
    margin: float = 0.05
    """Left over when a car comes to the charger after a task, or it is not given the task."""
    chargers_n: int | None = None
    """Chargers of the site that are in use, first ones first; None = all."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("capacity_wh", "awake_w", "charge_w"):
            _positive(f"battery.{name}", getattr(self, name))
        _not_negative("battery.asleep_w", self.asleep_w)
        rising = (0.0, self.margin, self.critical, self.low, self.enough, self.full, 1.0)
        ok = all(a <= b for a, b in pairwise(rising))
        require(ok, "battery.margin, critical, low, enough, full", rising[1:-1], "shares that do not decrease, 0 to 1")
        require(self.low < self.enough, "battery.enough", self.enough, f"a share > battery.low = {self.low}")
        require(0.0 <= self.idle_below <= self.full, "battery.idle_below", self.idle_below, f"0 to {self.full}")
        require(0.0 < self.start <= 1.0, "battery.start", self.start, "a share > 0, at most 1")
        n_ok = self.chargers_n is None or self.chargers_n >= 1
        require(n_ok, "battery.chargers_n", self.chargers_n, "an integer >= 1, or None")


EVENT_PARAMETERS: dict[str, dict[str, tuple[float, float]]] = {
    "car_dead": {},
    "arm_slow": {"factor": (0.01, 1.0), "duration_s": (0.0, 1e6)},
    "lane_blocked": {"duration_s": (0.0, 1e6)},
    "grip_lost": {"carried_s": (0.0, 60.0)},
    "car_pushed": {"dx_m": (-2.0, 2.0), "dy_m": (-2.0, 2.0), "dyaw_rad": (-3.2, 3.2)},
}
"""What can be said of each kind of event, with the least and the greatest value."""


@dataclass(frozen=True, kw_only=True)
class ScenarioEvent(_Settings):
    """Something that happens to the fleet at a given time."""

    time_s: float
    kind: str
    """A name in `EVENT_PARAMETERS`."""
    target: str
    """`car_2`, `arm_0`, or a cell as `row,col`."""
    parameters: dict[str, float] = field(default_factory=dict)
    """See `EVENT_PARAMETERS`; each has a default."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _not_negative("time_s", self.time_s)
        require(self.kind in EVENT_PARAMETERS, "kind", self.kind, ", ".join(EVENT_PARAMETERS))
        ranges = EVENT_PARAMETERS[self.kind]
        for name, value in self.parameters.items():
            require(name in ranges, f"parameter of {self.kind}", name, ", ".join(ranges) or "none")
            low, high = ranges[name]
            require(low <= value <= high, f"{name} of {self.kind}", value, f"a number from {low:g} to {high:g}")


@dataclass(frozen=True, kw_only=True)
class RunConfig(_Settings):
    """Everything that decides the outcome of a run."""

    site: str = "small"
    """Name of a shipped site or path of a site file."""
    robots: int = 3
    """Number of cars."""
    tasks: int | None = None
    """Generated deliveries; None = two per car, at least six, or all that a `stream` brings in `duration_s`. Ignored
    with `orders`."""
    stream: StreamConfig | None = None
    """How generated deliveries arrive; None = one for each car at once, then enough to keep the fleet busy."""
    orders: Path | None = None
    """CSV or JSON file of orders."""
    cars: Mapping[str, CarConfig] = field(default_factory=dict)
    """What is special about single cars, by name (`car_0`, ...)."""
    seed: int = 0
    duration_s: float = 3600.0
    """Simulated time after which the run ends even if tasks are open [s]."""
    fidelity: Fidelity = Fidelity.PHYSICS
    grip: Grip = Grip.SUCTION
    grip_force_n: float | None = None
    """Most force of the cup, or of each finger [N]; None = 100 and 40. Orders that it cannot hold are refused."""
    perception: Perception = Perception.TRUTH
    askew: bool = False
    """Parcels are put on the racks anyhow: up to 15 mm beside the middle of the slot, and turned by any angle."""
    connect: Connect = Connect.DIRECT
    shared_memory_key: int = 12347
    """Key of a running physics server; used with SHARED_MEMORY only."""
    collect_after_s: float = 5.0
    """Time a delivered parcel stays on its slot before it is collected [s]."""
    events: tuple[ScenarioEvent, ...] = ()
    traffic: TrafficConfig = field(default_factory=TrafficConfig)
    allocation: AllocationConfig = field(default_factory=AllocationConfig)
    timeouts: TimeoutConfig = field(default_factory=TimeoutConfig)
    arms: ArmConfig = field(default_factory=ArmConfig)
    estimate: EstimateConfig = field(default_factory=EstimateConfig)
    battery: BatteryConfig = field(default_factory=BatteryConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, kind in (("fidelity", Fidelity), ("grip", Grip), ("perception", Perception), ("connect", Connect)):
            # Plain words are welcome from Python; what follows compares members.
            value = getattr(self, name)
            require(value in list(kind), name, value, ", ".join(kind))
            object.__setattr__(self, name, kind(value))
        seen = self.perception is Perception.TRUTH or self.fidelity is Fidelity.PHYSICS
        require(seen, "--perception", str(self.perception), "truth, or camera with --fidelity physics")
        require(self.robots >= 1, "--robots", self.robots, "an integer >= 1")
        fits = self.tasks is None or 1 <= self.tasks <= MOST_TASKS_N
        require(fits, "--tasks", self.tasks, f"an integer from 1 to {MOST_TASKS_N}")
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        require(0 < self.shared_memory_key < 2**31, "shared_memory_key", self.shared_memory_key, "1 to 2147483647")
        _positive("--duration", self.duration_s)
        if self.grip_force_n is not None:
            _positive("--grip-force", self.grip_force_n)
        names = [f"car_{car}" for car in range(self.robots)]
        for name in self.cars:
            require(name in names, "cars", name, f"car_0 to {names[-1]}")
        _not_negative("collect_after_s", self.collect_after_s)

    def seeded(self, seed: int) -> RunConfig:
        """The same run with another seed >= 0; all else has been checked already."""
        twin = copy.copy(self)
        object.__setattr__(twin, "seed", seed)
        return twin

    @property
    def n_tasks(self) -> int:
        """Number of generated deliveries."""
        return self.tasks if self.tasks is not None else max(6, 2 * self.robots)
