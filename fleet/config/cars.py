"""Settings of the cars: their pose estimate, what sets one apart, their batteries."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from fleet.config.settings import Settings, not_negative, positive, require

USUAL_MODEL = "racecar"
"""Model of cars of which nothing else is said."""


@dataclass(frozen=True, kw_only=True)
class EstimateConfig(Settings):
    """Pose estimate that the cars steer by."""

    noise_m: float = 0.01
    """Standard deviation of a position measurement [m]."""
    noise_rad: float = math.radians(0.5)
    """Standard deviation of a heading measurement [rad]."""
    latency_ticks: int = 1
    """Age of a measurement when it arrives."""

    def __post_init__(self) -> None:
        super().__post_init__()
        not_negative("estimate.noise_m", self.noise_m)
        not_negative("estimate.noise_rad", self.noise_rad)
        require(0 <= self.latency_ticks <= 30, "estimate.latency_ticks", self.latency_ticks, "an integer from 0 to 30")


@dataclass(frozen=True, kw_only=True)
class CarConfig(Settings):
    """What sets one car apart from others."""

    model: str = USUAL_MODEL
    """Name of its model."""
    capabilities: tuple[str, ...] = ()
    """Names that orders can ask for in `needs`."""
    max_payload_kg: float | None = None
    """Greatest parcel it may carry [kg]; None = what its model can."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_payload_kg is not None:
            positive("max_payload_kg", self.max_payload_kg)


@dataclass(frozen=True, kw_only=True)
class BatteryConfig(Settings):
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
            positive(f"battery.{name}", getattr(self, name))
        not_negative("battery.asleep_w", self.asleep_w)
        rising = (0.0, self.margin, self.critical, self.low, self.enough, self.full, 1.0)
        ok = all(a <= b for a, b in pairwise(rising))
        require(ok, "battery.margin, critical, low, enough, full", rising[1:-1], "shares that do not decrease, 0 to 1")
        require(self.low < self.enough, "battery.enough", self.enough, f"a share > battery.low = {self.low}")
        require(0.0 <= self.idle_below <= self.full, "battery.idle_below", self.idle_below, f"0 to {self.full}")
        require(0.0 < self.start <= 1.0, "battery.start", self.start, "a share > 0, at most 1")
        n_ok = self.chargers_n is None or self.chargers_n >= 1
        require(n_ok, "battery.chargers_n", self.chargers_n, "an integer >= 1, or None")
