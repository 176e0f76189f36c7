"""Design: which runs a study consists of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fleet.config import (
    RATES_PER_H,
    AllocationConfig,
    ArmConfig,
    BatteryConfig,
    Fidelity,
    RunConfig,
    SettingValue,
    StreamConfig,
    TrafficConfig,
    require,
)
from fleet.errors import FleetError
from planners.mapf import DEFAULT_PLANNER

ORDERS_PER_CAR_H = 90.0
"""So that work never ends: a car needs at least 50 s for a delivery on the sites that ship."""
MOST_SEEDS = 10_000
"""Most seeds of a comparison."""
MOST_IN_RANGE = 1_000_000
"""Greatest number of a range."""
RANGE_FORM = "a list of numbers and ranges, such as 4, 2:20, 2:20:2 or 2,4,8"


class StudyError(FleetError):
    """A study cannot be made or resumed as asked."""


@dataclass(frozen=True, order=True)
class Variant:
    """One run of a study."""

    seed: int
    robots: int
    allocator: str


@dataclass(frozen=True, kw_only=True)
class Design:
    """Everything that decides the rows of a study: each allocator with each fleet size on each seed's orders."""

    allocators: tuple[str, ...]
    """The first is the one that the others are compared with."""
    robots: tuple[int, ...]
    seeds: tuple[int, ...]
    site: str
    fidelity: Fidelity
    duration_s: float
    """Length of every run [s]."""
    stream: StreamConfig
    """How orders arrive: each seed has a stream of its own, the same for all fleets."""
    orders: Path | None = None
    """File of orders in place of streams; seeds then differ in measurement noise only."""
    planner: str = DEFAULT_PLANNER
    """See `TrafficConfig.planner`."""
    planner_settings: Mapping[str, SettingValue] = field(default_factory=dict)
    """Settings of the planner, by name."""
    allocator_settings: Mapping[str, Mapping[str, SettingValue]] = field(default_factory=dict)
    """Settings of allocators, by the allocator and their own name."""
    battery: bool = False
    """Whether cars need to charge."""

    def __post_init__(self) -> None:
        for what, values, valid in (
            ("--allocators", self.allocators, "at least one name"),
            ("--robots", self.robots, RANGE_FORM),
            ("--seeds", self.seeds, "an integer >= 1"),
        ):
            require(len(values) > 0, what, ",".join(map(str, values)), valid)
            require(len(set(values)) == len(values), what, ",".join(map(str, values)), "each once")

    @property
    def variants(self) -> tuple[Variant, ...]:
        """All runs; seed by seed, so that a study that was interrupted has whole curves."""
        return tuple(
            Variant(seed, robots, allocator)
            for seed in self.seeds
            for robots in self.robots
            for allocator in self.allocators
        )

    def run_config(self, variant: Variant) -> RunConfig:
        """Settings of one run."""
        return RunConfig(
            site=self.site,
            robots=variant.robots,
            orders=self.orders,
            stream=self.stream,
            seed=variant.seed,
            duration_s=self.duration_s,
            fidelity=self.fidelity,
            traffic=TrafficConfig(planner=self.planner, planner_settings=self.planner_settings),
            allocation=AllocationConfig(
                allocator=variant.allocator, allocator_settings=self.allocator_settings.get(variant.allocator, {})
            ),
            battery=BatteryConfig(enabled=self.battery),
            # The runs share the cores already; an arm planner in its own process would only be in the way.
            arms=ArmConfig(workers_n=0),
        )


def usual_rate_per_h(robots: int) -> float:
    """Orders per hour of a fleet: `ORDERS_PER_CAR_H` for each car, or as many as there may be."""
    return min(ORDERS_PER_CAR_H * robots, RATES_PER_H[1])


def parse_range(text: str, what: str) -> tuple[int, ...]:
    """Read numbers and ranges that include their ends.

    Args:
        text: Such as ``4``, ``2:20``, ``2:20:2`` or ``2,4,8:10``.
        what: Name of the option, for messages.

    Returns:
        The numbers, ascending.

    Raises:
        ConfigError: The text is something else, a number is below 1 or stands twice, or a range is empty.
    """
    numbers: list[int] = []
    for part in text.split(","):
        ends = part.strip().split(":")
        valid = 1 <= len(ends) <= 3 and all(end.isdecimal() and end.isascii() and len(end) < 19 for end in ends)
        require(valid, what, text, RANGE_FORM)
        first, last, step = int(ends[0]), int(ends[min(1, len(ends) - 1)]), int(ends[2]) if len(ends) == 3 else 1
        require(1 <= first <= last and step >= 1, what, text, f"{RANGE_FORM}; from low to high, all at least 1")
        require(last <= MOST_IN_RANGE, what, text, f"{RANGE_FORM}; at most {MOST_IN_RANGE}")
        numbers += range(first, last + 1, step)
    require(len(set(numbers)) == len(numbers), what, text, f"{RANGE_FORM}; each number once")
    return tuple(sorted(numbers))


def parse_names(text: str, what: str) -> tuple[str, ...]:
    """Read names that are separated by commas, in their order.

    Raises:
        ConfigError: A name is empty or stands twice.
    """
    names = tuple(name.strip() for name in text.split(","))
    require(all(names) and len(set(names)) == len(names), what, text, "names separated by commas, each once")
    return names
