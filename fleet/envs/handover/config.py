"""HandoverConfig: the settings of the hand-over environment, and what things are worth in it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

from fleet.config import Fidelity, require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.core.env_config import RecordedEnvConfig
from fleet.envs.core.weights import check_weights

FIDELITIES = (Fidelity.KINEMATIC, Fidelity.PHYSICS)


@dataclass(frozen=True, kw_only=True)
class HandoverWeights:
    """What things are worth; the terms of an agent's reward, by name.

    Of what is loaded, delivered, lost and touched an agent is paid for its own part, or for its team's, as the
    environment's `team_share` says.
    """

    progress: float = 1.0
    """Per metre: an empty car comes nearer to the nearest pick arm and a loaded one to the nearest drop arm, along
    lanes; an arm's tip comes nearer than before to a parcel, and with a parcel to where it can be set."""
    gripped: float = 2.0
    """To an arm, the first time that it has a parcel in its grip, each parcel once."""
    loaded: float = 5.0
    """Per parcel that an arm has set in a tray, each parcel once, to the arm and to the car."""
    delivered: float = 10.0
    """Per parcel on a slot of a drop arm, to the arm and to the car that brought it."""
    lost: float = -10.0
    """Per parcel that lies where it does not belong, to the robot that had it last."""
    contact: float = -1.0
    """Per new contact between robots or with walls, shelves and pedestals."""
    time: float = 0.0
    """Per second, for every agent."""

    def __post_init__(self) -> None:
        check_weights(self)


TERMS = tuple(field.name for field in fields(HandoverWeights))
"""Names of the terms."""


@dataclass(frozen=True, kw_only=True)
class HandoverConfig(RecordedEnvConfig):
    """Settings of `HandoverEnv`.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    NAME: ClassVar[str] = "handover_v0"
    WEIGHTS: ClassVar[type] = HandoverWeights

    site: str = "cell"
    """Name of a shipped site or path of a site file."""
    n_cars: int = 2
    """Number of cars; all arms of the site are agents, too."""
    fidelity: str = "kinematic"
    """`kinematic` or `physics`."""
    parcels_per_min: float = 6.0
    """Parcels that arrive per minute, at all pick arms together; as many as there are cars lie there at once."""
    late_s: float = 0.0
    """A car's motor starts after a delay drawn from 0 to this [s]."""
    stops_per_min: float = 0.0
    """Times per minute that a car stands still for a while, drawn from `fleet.envs.handover.motors.STOP_S`."""
    speed_mps: float = 1.0
    """Speed of a car at full action [m/s]."""
    hold_s: float = 0.5
    """A grip opens when it was told to for so long without a break [s]."""
    team_share: float = 0.0
    """Share, from 0 to 1, of what all robots together have loaded, delivered, lost or touched in an agent's reward;
    the rest is for what itself was part of."""
    control_hz: float = 10.0
    """Steps per simulated second; the world's tick rate (kinematic 20, physics 60) is a multiple."""
    max_cycles: int = 600
    """Steps after which an episode is truncated."""
    weights: HandoverWeights | None = None
    """What things are worth; None = as `HandoverWeights` has it."""

    def __post_init__(self) -> None:
        require(isinstance(self.site, str | Path), "site", self.site, "a name or a path")
        place = self.place
        kinds = {station.kind for station in place.stations}
        require(kinds >= {"pick", "drop"}, "site", self.site, "a site with a pick arm and a drop arm")
        n_spots = len(place.parking)
        cars_ok = is_whole(self.n_cars) and 1 <= self.n_cars <= n_spots
        require(cars_ok, "n_cars", self.n_cars, f"1 to {n_spots} on site {place.name}")
        require(self.fidelity in FIDELITIES, "fidelity", self.fidelity, ", ".join(FIDELITIES))
        for name, low, high in _RANGES:
            value = getattr(self, name)
            require(is_number(value) and low <= value <= high, name, value, f"a number from {low:g} to {high:g}")
        super().__post_init__()

    @property
    def render_fps(self) -> float:
        """Steps per second of what is drawn."""
        return self.control_hz

    @property
    def arm_names(self) -> list[str]:
        """Names of the agents that are arms: one per station of the site, pick stations first."""
        return [f"arm_{arm}" for arm in range(len(self.place.stations))]

    @property
    def step_s(self) -> float:
        """Simulated time of a step [s]."""
        return 1.0 / self.control_hz


_RANGES = (
    ("parcels_per_min", 0.1, 1000.0),
    ("late_s", 0.0, 600.0),
    ("stops_per_min", 0.0, 60.0),
    ("speed_mps", 0.1, 2.0),
    ("hold_s", 0.0, 10.0),
    ("team_share", 0.0, 1.0),
    ("control_hz", 0.1, 1000.0),
)
"""Settings that are numbers, with the least and the greatest value."""
