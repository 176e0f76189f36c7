"""Settings of disturbances."""

from __future__ import annotations

from dataclasses import dataclass, field

from fleet.config.settings import Settings, not_negative, require

EVENT_PARAMETERS: dict[str, dict[str, tuple[float, float]]] = {
    "car_dead": {},
    "arm_slow": {"factor": (0.01, 1.0), "duration_s": (0.0, 1e6)},
    "lane_blocked": {"duration_s": (0.0, 1e6)},
    "grip_lost": {"carried_s": (0.0, 60.0)},
    "car_pushed": {"dx_m": (-2.0, 2.0), "dy_m": (-2.0, 2.0), "dyaw_rad": (-3.2, 3.2)},
}
"""What can be said of each kind of event, with the least and the greatest value."""


@dataclass(frozen=True, kw_only=True)
class ScenarioEvent(Settings):
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
        not_negative("time_s", self.time_s)
        require(self.kind in EVENT_PARAMETERS, "kind", self.kind, ", ".join(EVENT_PARAMETERS))
        ranges = EVENT_PARAMETERS[self.kind]
        for name, value in self.parameters.items():
            require(name in ranges, f"parameter of {self.kind}", name, ", ".join(ranges) or "none")
            low, high = ranges[name]
            require(low <= value <= high, f"{name} of {self.kind}", value, f"a number from {low:g} to {high:g}")
