"""Scenario: one way for a fleet to come to a stand, as data, and what has to become of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from maps.stations import StationOptions

Cell = tuple[int, int]
"""Row and column, counted from 0 at the top left."""
Row = Mapping[str, object]
"""An order as a JSON file has it."""
ALL = ("grid", "kinematic", "physics")


@dataclass(frozen=True, kw_only=True)
class When:
    """A moment that every fidelity comes to at a time of its own: the first at which all of this has held long enough.

    A run at another fidelity is seconds ahead or behind, so a time alone would not find the same situation in it.
    """

    after_s: float = 0.0
    """Simulated time [s]."""
    car: str = ""
    """Of whom the rest is said; empty = of any car, the lowest number first."""
    phases: tuple[str, ...] = ()
    """What it is about, values of `CarPhase`; empty = anything."""
    at: Cell | None = None
    """The cell that the middle of its body is in."""
    moves: bool = False
    """It drives."""
    lasts_s: float = 0.0
    """For how long without a break [s]."""


@dataclass(frozen=True, kw_only=True)
class Happening:
    """Something that goes wrong."""

    kind: str
    """A name in `EVENT_PARAMETERS`."""
    when: When
    target: str = ""
    """As in an events file; empty = the car of which `when` holds."""
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A site, robots, orders, what goes wrong, and how it ends."""

    name: str
    what: str
    """What happens, in one sentence."""
    source: str
    """Address of the public thread or paper that tells of it."""
    site: str
    """A drawing, or the name of a site that ships."""
    robots: int
    orders: tuple[Row, ...]
    happens: tuple[Happening, ...] = ()
    """What goes wrong: each waits for the one before."""
    not_done: Mapping[str, str] = field(default_factory=dict)
    """Orders that are not done, and what the reason that the fleet gives must say (a regular expression)."""
    may_be_done: frozenset[str] = frozenset()
    """Those of them that may be done as well: on the grid a push is over at the end of the timestep."""
    refused: str = ""
    """What the run says when it refuses to begin (a regular expression); empty = it begins."""
    longest_s: float
    """Simulated time by which all orders have ended [s]."""
    settings: Mapping[str, object] = field(default_factory=dict)
    """More fields of `RunConfig`."""
    stations: Mapping[str, StationOptions] = field(default_factory=dict)
    """What the drawing does not say of single stations."""
    fails_today: Mapping[str, str] = field(default_factory=dict)
    """Fidelities at which the fleet does not end so yet, and how it ends."""
    tries_physics: bool = False
    """Whether the tests play it with physics, too; `make zoo` does so with every scenario."""


def delivery(name: str, pick: str = "pick_1", drop: str = "drop_1", **more: object) -> Row:
    """An order for a parcel of 0.4 kg."""
    return {
        "id": name, "release_s": 0, "type": "delivery", "pick": pick, "drop": drop, "mass_kg": 0.4, "size_m": 0.06,
    } | more  # fmt: skip


def deliveries(n_orders: int, first: str = "a", **more: object) -> tuple[Row, ...]:
    """Orders that are alike, called a, b, c, ..."""
    return tuple(delivery(chr(ord(first) + k), **more) for k in range(n_orders))  # type: ignore[arg-type]


def visit(name: str, *places: str, kind: str = "move", **more: object) -> Row:
    """An order to go to places."""
    return {"id": name, "release_s": 0, "type": kind, "places": list(places)} | more


def dies(**when: object) -> Happening:
    """A car that breaks down."""
    return Happening(kind="car_dead", when=When(**when))  # type: ignore[arg-type]


def pushed(dx_m: float, dy_m: float, dyaw_rad: float = 0.0, **when: object) -> Happening:
    """A car that somebody runs into."""
    push = {"dx_m": dx_m, "dy_m": dy_m, "dyaw_rad": dyaw_rad}
    return Happening(kind="car_pushed", parameters=push, when=When(**when))  # type: ignore[arg-type]


def blocked(cell: str, duration_s: float = 1e6, **when: object) -> Happening:
    """A box that falls into a cell, for good unless a time is given."""
    return Happening(
        kind="lane_blocked",
        target=cell,
        parameters={"duration_s": duration_s},
        when=When(**when),  # type: ignore[arg-type]
    )
