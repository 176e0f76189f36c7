"""Order: what somebody wants delivered, and by whom it can be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from maps.site import Site

MIN_EDGE_M, MAX_EDGE_M = 0.04, 0.10
MIN_MASS_KG, MAX_MASS_KG = 0.05, 2.0


class Priority(StrEnum):
    """Strict classes, the most urgent first: no number of orders of a later class outweighs one of an earlier."""

    EMERGENCY = "emergency"
    NORMAL = "normal"
    IDLE = "idle"
    """For cars that have nothing else to do."""

    @property
    def rank(self) -> int:
        """0 for the most urgent class."""
        return list(Priority).index(self)


@dataclass(frozen=True, kw_only=True)
class Order:
    """One parcel to be taken from a pick station to a drop station."""

    name: str
    release_s: float
    """Time from which the order is known [s]."""
    pick: str
    """Pick station, the preferred one if there are several."""
    drop: str
    mass_kg: float
    size_m: tuple[float, float, float]
    """Edges of the box [m]."""
    due_s: float = math.inf
    """Time by which it should be delivered [s]; inf = any."""
    priority: Priority = Priority.NORMAL
    after: tuple[str, ...] = ()
    """Names of orders that must be delivered before this one may be picked."""
    picks: tuple[str, ...] = ()
    """All pick stations it can be had from, the preferred one first; none given = `pick` alone."""
    needs: tuple[str, ...] = ()
    """Capabilities that its car must have."""

    def __post_init__(self) -> None:
        if not self.picks:
            object.__setattr__(self, "picks", (self.pick,))


@dataclass(frozen=True, kw_only=True)
class Ability:
    """What one car can carry."""

    max_payload_kg: float
    capabilities: frozenset[str] = frozenset()

    def fits(self, order: Order) -> bool:
        """Whether the car may take an order."""
        return order.mass_kg <= self.max_payload_kg and self.capabilities.issuperset(order.needs)


def misfit(order: Order, abilities: Sequence[Ability]) -> str | None:
    """Say why no car can take an order.

    Args:
        order: The order.
        abilities: One for each car.

    Returns:
        Field, value and valid values; None if there is a car for it.
    """
    if any(ability.fits(order) for ability in abilities):
        return None
    payload_kg = max(ability.max_payload_kg for ability in abilities)
    if order.mass_kg > payload_kg:
        return f"mass_kg is '{order.mass_kg:g}'; valid: at most {payload_kg:g}, the greatest payload of a car"
    known = sorted(frozenset().union(*(ability.capabilities for ability in abilities)))
    valid = f"what one car has and carries ({', '.join(known) or 'no car has a capability'})"
    return f"needs is '{';'.join(order.needs)}'; valid: {valid}"


def generate_orders(site: Site, n_orders: int, n_cars: int, rng: np.random.Generator) -> tuple[Order, ...]:
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
        edges = rng.uniform(0.05, 0.08, 3)
        orders.append(
            Order(
                name=f"order_{k + 1}",
                release_s=round(release_s, 3),
                pick=picks[int(rng.integers(len(picks)))],
                drop=drops[int(rng.integers(len(drops)))],
                mass_kg=round(float(rng.uniform(0.1, 0.5)), 3),
                size_m=(round(float(edges[0]), 4), round(float(edges[1]), 4), round(float(edges[2]), 4)),
            )
        )
    return tuple(orders)
