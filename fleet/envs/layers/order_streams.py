"""Streams of orders for episodes: as many as a fleet of that size can carry on that site, or some times that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from fleet.abstract.fleet import TIMESTEP_S, FleetSite
from fleet.config import RATES_PER_H, StreamConfig, require
from fleet.tasks.order import Delivery
from fleet.tasks.stream import stream_orders


def rate_per_h(place: FleetSite, n_cars: int, load: float) -> float:
    """Orders per hour.

    Args:
        place: The site.
        n_cars: Fleet size.
        load: 1 = as many as the cars could carry if they drove back and forth between random stations and no car
            was ever in the way of another.
    """
    return float(np.clip(load * n_cars * 3600.0 / mean_cycle_s(place), *RATES_PER_H))


def mean_cycle_s(place: FleetSite) -> float:
    """Time in which a car fetches and brings a parcel between random stations if nobody is in its way [s]."""
    floor = place.floor
    kinds = np.array([station.kind == "pick" for station in place.site.stations])
    there = floor.distance[np.ix_(floor.dock_row[~kinds], floor.dock_state[kinds])]
    back = floor.distance[np.ix_(floor.dock_row[kinds], floor.dock_state[~kinds])]
    return (float(there.mean()) + float(back.mean()) + 2 * floor.service_steps) * TIMESTEP_S


def stream_of(settings: StreamConfig | Mapping[str, Any] | None) -> StreamConfig:
    """A stream by the names of its settings, those that are not named at their defaults; lists stand for tuples.

    Raises:
        ConfigError: A name is that of no setting or that of the rate, which the load decides; a value is not valid.
    """
    if isinstance(settings, StreamConfig):
        return settings
    settings = {} if settings is None else settings
    require(isinstance(settings, Mapping), "stream", settings, "a StreamConfig, or a dictionary of its settings")
    valid = [field.name for field in fields(StreamConfig) if field.name != "rate_per_h"]
    for name in settings:
        require(name in valid, "stream", name, ", ".join(valid))
    given: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in settings.items()
    }
    return StreamConfig(**given)


def episode_orders(
    place: FleetSite,
    n_cars: int,
    load: float,
    duration_s: float,
    rng: np.random.Generator,
    stream: StreamConfig | None = None,
) -> tuple[Delivery, ...]:
    """Orders of one episode, ascending in release: one for each car at once, then a stream.

    Args:
        place: The site.
        n_cars: Fleet size.
        load: Decides the rate, see `rate_per_h`.
        duration_s: Length of the episode [s].
        rng: Source of chance.
        stream: Kind of the stream, due dates and the like, all but its rate; None = a Poisson stream with due dates.
    """
    config = replace(stream or StreamConfig(), rate_per_h=rate_per_h(place, n_cars, load))
    orders = stream_orders(place.site, config, duration_s + n_cars * 3600.0 / config.rate_per_h, None, rng)
    if len(orders) < n_cars:  # chance may bring too few within a short time
        orders = stream_orders(place.site, config, duration_s, n_cars, rng)
    at_once = tuple(replace(order, release_s=0.0, due_s=order.due_s - order.release_s) for order in orders[:n_cars])
    begin_s = orders[n_cars - 1].release_s
    later = tuple(
        replace(order, release_s=round(order.release_s - begin_s, 3), due_s=order.due_s - begin_s)
        for order in orders[n_cars:]
    )
    return at_once + tuple(order for order in later if order.release_s < duration_s)
