"""Settings of a run: a run is fully described by its `RunConfig`."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from fleet.config.allocation import AllocationConfig, TimeoutConfig
from fleet.config.arms import ArmConfig
from fleet.config.cars import USUAL_MODEL, BatteryConfig, CarConfig, EstimateConfig
from fleet.config.changes import MEMBERS, SettingChange
from fleet.config.choices import Connect, Fidelity, Grip, Perception
from fleet.config.events import ScenarioEvent
from fleet.config.physics import PhysicsConfig
from fleet.config.settings import Settings, not_negative, positive, require
from fleet.config.stream import StreamConfig
from fleet.config.traffic import TrafficConfig

Group = TypeVar("Group", AllocationConfig, TimeoutConfig, TrafficConfig)

MOST_TASKS = 1_000_000
"""As many orders take half a minute to make, and 1.5 GB."""
MOST_CHAOS_PER_H = 100_000.0
"""A fault in nearly every tick; they are drawn before a run begins."""


@dataclass(frozen=True, kw_only=True)
class RunConfig(Settings):
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
    chaos_per_h: float = 0.0
    """Faults an hour that are drawn from the seed, of all kinds, beside the events."""
    changes: tuple[SettingChange, ...] = ()
    """Settings that have other values from some time on."""
    traffic: TrafficConfig = field(default_factory=TrafficConfig)
    allocation: AllocationConfig = field(default_factory=AllocationConfig)
    timeouts: TimeoutConfig = field(default_factory=TimeoutConfig)
    arms: ArmConfig = field(default_factory=ArmConfig)
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    estimate: EstimateConfig = field(default_factory=EstimateConfig)
    battery: BatteryConfig = field(default_factory=BatteryConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, kind in (("fidelity", Fidelity), ("grip", Grip), ("perception", Perception), ("connect", Connect)):
            # Plain words are welcome from Python; what follows compares members.
            value = getattr(self, name)
            require(value in list(kind), name, value, ", ".join(kind))
            object.__setattr__(self, name, kind(value))
        seen = self.perception is Perception.TRUTH or self.fidelity.has_contact
        require(seen, "--perception", str(self.perception), "truth, or camera with --fidelity physics or mixed")
        apart = self.fidelity is not Fidelity.MIXED or self.connect is Connect.DIRECT
        valid = "DIRECT with --fidelity mixed, where every region has an engine of its own"
        require(apart, "connect", str(self.connect), valid)
        shared = self.physics.workers_n == 1 or (self.fidelity is Fidelity.PHYSICS and self.connect is Connect.DIRECT)
        valid = "1, or more with --fidelity physics and neither a window nor a physics server"
        require(shared, "--workers", self.physics.workers_n, valid)
        require(self.robots >= 1, "--robots", self.robots, "an integer >= 1")
        fits = self.tasks is None or 1 <= self.tasks <= MOST_TASKS
        require(fits, "--tasks", self.tasks, f"an integer from 1 to {MOST_TASKS}")
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        require(0 < self.shared_memory_key < 2**31, "shared_memory_key", self.shared_memory_key, "1 to 2147483647")
        positive("--duration", self.duration_s)
        fits = 0.0 <= self.chaos_per_h <= MOST_CHAOS_PER_H
        require(fits, "--chaos", self.chaos_per_h, f"a number from 0 to {MOST_CHAOS_PER_H:g}, faults an hour")
        if self.grip_force_n is not None:
            positive("--grip-force", self.grip_force_n)
        for name in self.cars:
            number = name.removeprefix("car_")
            known = number.isdecimal() and name == f"car_{int(number)}" and int(number) < self.robots
            require(known, "cars", name, f"car_0 to car_{self.robots - 1}")
        not_negative("collect_after_s", self.collect_after_s)
        for change in self.changes:
            self.as_of(change.time_s)  # each group of settings checks itself

    def as_of(self, time_s: float) -> RunConfig:
        """The settings as they are from a time on, when all changes until then have been made.

        Raises:
            ConfigError: A change has a value that its setting cannot have.
        """
        groups: dict[str, Any] = {"allocation": self.allocation, "traffic": self.traffic, "timeouts": self.timeouts}
        # Of what changes at one time, a planner comes before its settings.
        for change in sorted(self.changes, key=lambda change: (change.time_s, bool(change.member))):
            if change.time_s <= time_s:
                groups[change.group] = _changed(groups[change.group], change)
        return replace(self, changes=(), **groups)

    def seeded(self, seed: int) -> RunConfig:
        """The same run with another seed >= 0; all else has been checked already."""
        twin = copy.copy(self)
        object.__setattr__(twin, "seed", seed)
        return twin

    @property
    def models(self) -> tuple[str, ...]:
        """Name of each car's model."""
        names = [USUAL_MODEL] * self.robots
        for name, car in self.cars.items():
            names[int(name.removeprefix("car_"))] = car.model
        return tuple(names)

    @property
    def n_tasks(self) -> int:
        """Number of generated deliveries."""
        return self.tasks if self.tasks is not None else max(6, 2 * self.robots)


def _changed(group: Group, change: SettingChange) -> Group:
    """A group of settings with one of them changed."""
    values: dict[str, Any] = {change.setting: change.value}
    if change.setting in MEMBERS:
        values = {change.setting: {**getattr(group, change.setting), change.member: change.value}}
    for settings, named in MEMBERS.items():
        if change.setting == named and change.value != getattr(group, named):
            values[settings] = {}
    return replace(group, **values)
