"""Settings of allocation, and of how long tasks may take."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fleet.config.settings import Settings, SettingValue, not_negative, require
from planners.allocation import allocator_named

if TYPE_CHECKING:
    from planners.allocation.problem import Allocator


@dataclass(frozen=True, kw_only=True)
class AllocationConfig(Settings):
    """Who gets which task."""

    allocator: str = "hungarian"
    """Name in `planners.allocation.ALLOCATORS`, or `package.module.Class` of one's own."""
    allocator_settings: Mapping[str, SettingValue] = field(default_factory=dict)
    """Settings of that allocator, by name; the others keep their defaults."""
    station_cap_n: int = 4
    """Cars near or at one station at once, the one that is served included, and at most as many as it has
    slots; more would queue into the aisles."""
    ageing: float = 0.1
    """Seconds of travel that one second of waiting is worth, so that no task starves; it counts from the due date on
    where there is one, as that says how long a task may wait."""
    lateness: float = 2.0
    """Seconds of travel that one second of lateness is worth."""
    due: float = 4.0
    """How much due dates press: a task of mean length whose time is used up is worth a way of so many times that."""
    late_s: float = 0.0
    """Seconds of travel that it is worth not to be late at all, for allocators that plan ahead: more tasks are on time,
    and those that cannot be are left for later and later."""
    keep_gain_s: float = 5.0
    """A car that is under way to a pick station gives its task away only if more than this is gained [s] ..."""
    keep_share: float = 0.1
    """... and more than this share of what the task costs it."""
    busy_s: float = 40.0
    """The arm of a drop station is busy whose work takes so much longer than the longest way to parcels [s]: its tasks
    do not keep those of others from being looked at. inf = they do."""
    fill_trays: bool = True
    """Cars whose trays have places for several parcels take more at a station before they leave it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.station_cap_n >= 1, "allocation.station_cap_n", self.station_cap_n, "an integer >= 1")
        not_negative("allocation.ageing", self.ageing)
        not_negative("allocation.lateness", self.lateness)
        not_negative("allocation.due", self.due)
        not_negative("allocation.late_s", self.late_s)
        not_negative("allocation.keep_gain_s", self.keep_gain_s)
        require(self.busy_s >= 0, "allocation.busy_s", self.busy_s, "a number >= 0, or inf")
        require(0 <= self.keep_share <= 1, "allocation.keep_share", self.keep_share, "a number from 0 to 1")

    def make_allocator(self) -> Allocator:
        """The allocator that is named, with its settings.

        Raises:
            PlanningError: There is no such allocator, or it has no such settings.
        """
        return allocator_named(self.allocator, self.allocator_settings, what="--allocator")


@dataclass(frozen=True, kw_only=True)
class TimeoutConfig(Settings):
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
