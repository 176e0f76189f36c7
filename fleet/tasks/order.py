"""Order: what somebody wants done, a delivery or a visit, and by whom it can be."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any, Self

import numpy as np

from maps.reading.shown import shown
from maps.site import Site

MIN_EDGE_M, MAX_EDGE_M = 0.04, 0.10
MIN_MASS_KG, MAX_MASS_KG = 0.05, 3.0
"""Masses of parcels [kg]; a suction cup holds 3.4 kg three times over."""
MAX_GENERATED_KG = 0.5
"""Heaviest parcel of an order that is not read from a file [kg]."""
_GENERATED_EDGE_M = (0.05, 0.08)
_GENERATED_KG = (0.1, MAX_GENERATED_KG)


LIFT = "lift"
"""Capability of cars that lift pods; no other car has it."""


class Priority(StrEnum):
    """Strict classes, the most urgent first: no number of orders of a later class outweighs one of an earlier."""

    EMERGENCY = "emergency"
    NORMAL = "normal"
    IDLE = "idle"
    """For cars that have nothing else to do. One with a due date has to be done in time, so it counts as normal."""

    @functools.cached_property
    def rank(self) -> int:
        """0 for the most urgent class."""
        return _RANK[self]


_RANK = {priority: rank for rank, priority in enumerate(Priority)}


@dataclass(frozen=True, kw_only=True)
class Order:
    """What all orders have; each is a `Delivery` or a `Visit`."""

    name: str
    release_s: float
    """Time from which the order is known [s]."""
    due_s: float = math.inf
    """Time by which it should be done [s]; inf = any."""
    priority: Priority = Priority.NORMAL
    after: tuple[str, ...] = ()
    """Names of orders that must be done before this one may begin."""
    needs: tuple[str, ...] = ()
    """Capabilities that its car must have."""
    batch: str = ""
    """Name of the orders it belongs to, which are reported when all of them are done; empty = none."""
    same_car_as: str = ""
    """Name of the order that its car must have done just before, which is also in `after`; empty = any car."""
    payload_kg: float = 0.0
    """Greatest parcel its car must be able to carry, for this order and those that follow with the same car [kg]."""

    @functools.cached_property
    def rank(self) -> int:
        """0 for the most urgent class; with a due date at most that of normal orders."""
        return self.priority.rank if math.isinf(self.due_s) else min(self.priority.rank, Priority.NORMAL.rank)

    @classmethod
    def of(cls, shared: Order, **own: Any) -> Self:
        """An order with what another one has of this class's fields, and its own."""
        return cls(**{field.name: getattr(shared, field.name) for field in fields(Order)} | own)


@dataclass(frozen=True, kw_only=True)
class Delivery(Order):
    """One parcel to be taken from a pick station to a drop station."""

    pick: str
    """Pick station, the preferred one if there are several."""
    drop: str
    mass_kg: float
    size_m: tuple[float, float, float]
    """Edges of the box [m]."""
    picks: tuple[str, ...] = ()
    """All pick stations it can be had from, the preferred one first; none given = `pick` alone."""

    def __post_init__(self) -> None:
        if not self.picks:
            object.__setattr__(self, "picks", (self.pick,))
        object.__setattr__(self, "payload_kg", max(self.payload_kg, self.mass_kg))


@dataclass(frozen=True, kw_only=True)
class Visit(Order):
    """Places that one car goes to, one after the other, without a parcel."""

    kind: str
    """Name of its task type."""
    errands: tuple[tuple[str, ...], ...]
    """Names of places, in order; of several at one errand the nearest free one will do."""
    stand_s: float = 0.0
    """How long the car stands at each [s]."""
    until_full: bool = False
    """The car stands until its battery is full."""
    inspects: bool = False
    """When the car has stood, an event `inspected` tells its pose."""
    pod: str = ""
    """The pod that its car lifts at the second errand, stands with at the third, and sets down at the last; before the
    first one, which is beside the pod, nobody has room under it. Empty = none."""


@dataclass(frozen=True, kw_only=True)
class Ability:
    """What one car can do."""

    max_payload_kg: float
    capabilities: frozenset[str] = frozenset()
    slowness: float = 1.0
    """How many times as long as other cars it takes for its way, at least 1."""

    def fits(self, order: Order) -> bool:
        """Whether the car may take an order."""
        return order.payload_kg <= self.max_payload_kg and self.capabilities.issuperset(order.needs)


@functools.lru_cache(4096)  # the same cars in every episode
def ability_of(car: int, max_payload_kg: float, capabilities: tuple[str, ...] = (), slowness: float = 1.0) -> Ability:
    """What a car can do; its name is a capability too, so that an order can ask for this very car."""
    named = frozenset((f"car_{car}", *capabilities))
    return Ability(max_payload_kg=max_payload_kg, capabilities=named, slowness=slowness)


def misfit(order: Order, abilities: Sequence[Ability], grip_kg: float = math.inf) -> str | None:
    """Say why no car, or no arm, can take an order.

    Args:
        order: The order.
        abilities: One for each car.
        grip_kg: Heaviest parcel that the arms' tools hold [kg].

    Returns:
        Field, value and valid values; None if it can be done.
    """
    if order.payload_kg > grip_kg:
        return f"mass_kg is '{order.payload_kg:g}'; valid: at most {grip_kg:.3g}, what the arms' grip holds"
    if any(ability.fits(order) for ability in abilities):
        return None
    payload_kg = max(ability.max_payload_kg for ability in abilities)
    if order.payload_kg > payload_kg:
        return f"mass_kg is '{order.payload_kg:g}'; valid: at most {payload_kg:g}, the greatest payload of a car"
    if LIFT in order.needs and not any(LIFT in ability.capabilities for ability in abilities):
        return "type is 'pod'; valid: another one, as no car of this run lifts pods (robots list: what each is for)"
    known = sorted(frozenset().union(*(ability.capabilities for ability in abilities)))
    valid = f"what one car has and carries ({', '.join(known) or 'no car has a capability'})"
    return f"needs is {shown(';'.join(order.needs))}; valid: {valid}"


def between(bounds: tuple[float, float], share: float) -> float:
    """What a generator's `uniform` makes of its next number; that looks at the bounds for longer than it draws."""
    low, high = bounds
    return low + (high - low) * share


def draw_edges(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw the edges of a parcel [m]."""
    length, width, height = (round(between(_GENERATED_EDGE_M, share), 4) for share in rng.random(3).tolist())
    return length, width, height


def draw_mass(rng: np.random.Generator) -> float:
    """Draw the mass of a parcel [kg]."""
    return round(between(_GENERATED_KG, rng.random()), 3)


def generate_orders(site: Site, n_orders: int, n_cars: int, rng: np.random.Generator) -> tuple[Delivery, ...]:
    """Draw orders: the first wave at time zero, then Poisson arrivals that keep the fleet busy.

    Args:
        site: Gives the station names.
        n_orders: Number of orders.
        n_cars: Fleet size; the mean time between arrivals is 20 s / n_cars after the first n_cars orders.
        rng: Source of randomness.

    Returns:
        Orders, ascending in release time.
    """
    picks = site.station_names("pick")
    drops = site.station_names("drop")
    release_s = 0.0
    orders = []
    for k in range(n_orders):
        if k >= n_cars:
            release_s += float(rng.exponential(20.0 / n_cars))
        size_m = draw_edges(rng)
        orders.append(
            Delivery(
                name=f"order_{k + 1}",
                release_s=round(release_s, 3),
                pick=picks[int(rng.integers(len(picks)))],
                drop=drops[int(rng.integers(len(drops)))],
                mass_kg=draw_mass(rng),
                size_m=size_m,
            )
        )
    return tuple(orders)
