"""Breach: one invariant that does not hold, and the error that ends the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from fleet.errors import FleetError


class Invariant(StrEnum):
    """What must hold after every tick."""

    SWEPT = "swept"
    """A move of the lane graph sweeps the cells that it says, and no others."""
    GRANTS = "grants"
    """A cell has one holder at most: the car that stands there, was granted a move through it, or has reserved it."""
    CLOSED = "closed"
    """No move is granted into a cell that is closed."""
    FOOTPRINT = "footprint"
    """A car's body is in cells that are the car's."""
    ORDER = "order"
    """The moves that wait can all be made, one after another: nobody waits in a ring."""
    CLEARANCE = "clearance"
    """No robot touches another one, but for an arm and the car that it serves, while that one stands."""
    PHASES = "phases"
    """What a car is about fits the state of its task, which is its alone."""
    TASKS = "tasks"
    """A task is in one state."""
    BOOKINGS = "bookings"
    """No more cars have booked a place than it takes."""
    PARCELS = "parcels"
    """A parcel is in one place, the one where it is booked, and a slot has one parcel at most."""


@dataclass(frozen=True, kw_only=True)
class Breach:
    """An invariant that does not hold."""

    invariant: Invariant
    words: str
    """What is wrong, with its value."""
    valid: str
    """What would be right."""
    robots: tuple[str, ...] = ()
    """Those concerned, such as ``car_2``."""
    place: str = ""
    """Where: a cell as row,col, or the name of a place; empty = nowhere in particular."""
    values: Mapping[str, object] = field(default_factory=dict)
    """Figures that show it."""


class InvariantError(FleetError):
    """An invariant does not hold; the run must not go on.

    Args:
        breach: What is wrong.
        tick: After which tick.
        time_s: Simulated time then [s].
    """

    def __init__(self, breach: Breach, tick: int, time_s: float) -> None:
        super().__init__(
            f"tick {tick} ({time_s:.2f} s): invariant {breach.invariant}: {breach.words}; valid: {breach.valid}"
        )
        self.breach = breach
        self.tick = tick
        self.time_s = time_s

    @property
    def facts(self) -> dict[str, object]:
        """The evidence, as the files of a run hold it."""
        breach = self.breach
        return {
            "invariant": breach.invariant,
            "robots": breach.robots,
            "place": breach.place,
            "values": dict(breach.values),
            "message": str(self),
        }
