"""Settings of disturbances: what can happen to a fleet, to whom, and for how long."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from fleet.config.settings import Settings, not_negative, require
from fleet.errors import ConfigError
from maps.reading.near import hint
from maps.reading.shown import shown

CAR, ARM, CELL, STATION, FLEET, ZONE = "car", "arm", "cell", "station", "fleet", "zone"
TARGETS = {
    CAR: "car_2",
    ARM: "arm_0",
    CELL: "a cell as row,col",
    STATION: "the name of a station",
    FLEET: "fleet",
    ZONE: "a zone as row,col,row,col of two corners",
}
"""What can be the target of an event, in words."""
DURATION = "duration_s"


@dataclass(frozen=True, kw_only=True)
class EventKind:
    """A kind of event."""

    targets: tuple[str, ...]
    """Kinds of targets, of `TARGETS`."""
    parameters: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    """The least and the greatest value of each, and what it is if nothing is said."""
    lasts_s: float = 0.0
    """How long it lasts if nothing is said [s]; 0 = it happens once, inf = until it is ended."""
    ends: str = ""
    """The kind of event that this one ends, at the same target; empty = it ends none."""
    moves_cars: bool = False
    """Whether its target, a car, may come to be elsewhere than the car itself meant to."""

    @property
    def lasts(self) -> bool:
        """Whether it goes on for some time."""
        return self.lasts_s > 0.0


_TURN, _WAY = (-3.2, 3.2, 0.0), (-2.0, 2.0, 0.0)
_MOVED = {"dx_m": _WAY, "dy_m": _WAY, "dyaw_rad": _TURN}
EVENT_KINDS: Mapping[str, EventKind] = MappingProxyType(
    {
        "car_dead": EventKind(targets=(CAR,), lasts_s=math.inf),
        "car_repaired": EventKind(targets=(CAR,), ends="car_dead"),
        "car_towed": EventKind(targets=(CAR,)),
        "car_pushed": EventKind(targets=(CAR,), parameters=_MOVED, moves_cars=True),
        "car_slow": EventKind(targets=(CAR,), parameters={"factor": (0.05, 1.0, 0.5)}, lasts_s=60.0),
        "car_out": EventKind(targets=(CAR,), lasts_s=math.inf),
        "car_back": EventKind(targets=(CAR,), ends="car_out"),
        "car_taken": EventKind(targets=(CAR,), parameters=_MOVED, lasts_s=30.0, moves_cars=True),
        "car_given_back": EventKind(targets=(CAR,), ends="car_taken"),
        "battery_empty": EventKind(targets=(CAR,)),
        "battery_changed": EventKind(targets=(CAR,)),
        "pose_noisy": EventKind(targets=(CAR,), parameters={"factor": (1.0, 20.0, 5.0)}, lasts_s=10.0),
        "pose_lost": EventKind(targets=(CAR,), lasts_s=10.0),
        "commands_late": EventKind(
            targets=(CAR,), parameters={"delay_s": (0.0, 0.3, 0.15)}, lasts_s=10.0, moves_cars=True
        ),
        "commands_lost": EventKind(targets=(CAR,), lasts_s=10.0),
        "emergency_stop": EventKind(targets=(FLEET, CAR, ZONE), lasts_s=20.0),
        "emergency_over": EventKind(targets=(FLEET, CAR, ZONE), ends="emergency_stop"),
        "plans_late": EventKind(targets=(FLEET,), parameters={"delay_s": (0.0, 10.0, 2.0)}, lasts_s=30.0),
        "plans_lost": EventKind(targets=(FLEET,), lasts_s=10.0),
        "arm_slow": EventKind(targets=(ARM,), parameters={"factor": (0.01, 1.0, 0.5)}, lasts_s=60.0),
        "arm_dead": EventKind(targets=(ARM,), lasts_s=math.inf),
        "arm_repaired": EventKind(targets=(ARM,), ends="arm_dead"),
        "grip_lost": EventKind(targets=(ARM,), parameters={"carried_s": (0.0, 60.0, 1.0)}),
        "camera_blind": EventKind(targets=(STATION,), lasts_s=30.0),
        "station_closed": EventKind(targets=(STATION,), lasts_s=60.0),
        "station_opened": EventKind(targets=(STATION,), ends="station_closed"),
        "lane_blocked": EventKind(targets=(CELL,), lasts_s=60.0),
        "lane_cleared": EventKind(targets=(CELL,), ends="lane_blocked"),
        "lane_closed": EventKind(targets=(CELL,), lasts_s=60.0),
        "lane_opened": EventKind(targets=(CELL,), ends="lane_closed"),
        "human_walks": EventKind(
            targets=(CELL,),
            parameters={"to_row": (0.0, 1e4, 0.0), "to_col": (0.0, 1e4, 0.0), "speed_mps": (0.2, 2.0, 1.0)},
        ),
    }
)
"""Kinds of events by name."""
FOR_GOOD_S = 300.0
"""What lasts longer is as good as lost: a run in which nothing goes on for so long has stalled [s]."""
MOST_S = 1e6
"""Longest duration that can be said [s]."""


@dataclass(frozen=True, kw_only=True)
class ScenarioEvent(Settings):
    """Something that happens to the fleet at a given time."""

    time_s: float
    kind: str
    """A name in `EVENT_KINDS`."""
    target: str
    """Who or what it happens to: see `TARGETS`."""
    parameters: dict[str, float] = field(default_factory=dict)
    """Those of its kind, and `duration_s` if it lasts; each has a default."""

    def __post_init__(self) -> None:
        super().__post_init__()
        not_negative("time_s", self.time_s)
        if self.kind not in EVENT_KINDS:
            meant = hint(self.kind, EVENT_KINDS)
            raise ConfigError(f"kind is {shown(self.kind)}{meant}; valid: {', '.join(EVENT_KINDS)}")
        ranges = parameters_of(self.kind)
        for name, value in self.parameters.items():
            require(name in ranges, f"parameter of {self.kind}", name, ", ".join(ranges) or "none")
            low, high = ranges[name]
            require(low <= value <= high, f"{name} of {self.kind}", value, f"a number from {low:g} to {high:g}")

    @property
    def is_for_good(self) -> bool:
        """Whether what it does is as good as lost."""
        return self.duration_s > FOR_GOOD_S

    def value(self, name: str) -> float:
        """A parameter, or what it is if nothing was said."""
        return self.parameters.get(name, EVENT_KINDS[self.kind].parameters[name][2])

    @property
    def duration_s(self) -> float:
        """How long it lasts [s]; inf = until it is ended."""
        return self.parameters.get(DURATION, EVENT_KINDS[self.kind].lasts_s)


def parameters_of(kind: str) -> dict[str, tuple[float, float]]:
    """What can be said of a kind of event: the least and the greatest value of each parameter."""
    found = {name: (low, high) for name, (low, high, _) in EVENT_KINDS[kind].parameters.items()}
    return {**found, DURATION: (0.0, MOST_S)} if EVENT_KINDS[kind].lasts else found
