"""Order streams: seeded arrivals with due dates and priorities; the same seed is the same stream for any fleet."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np

from fleet.config import StreamConfig, StreamKind, require
from fleet.tasks.order import Delivery, Priority, between, draw_edges, draw_mass
from maps.site import Site

MAX_ORDERS = 1_000_000
"""More are not drawn: they take minutes and gigabytes before the run begins."""


def stream_orders(
    site: Site, config: StreamConfig, duration_s: float, n_orders: int | None, rng: np.random.Generator
) -> tuple[Delivery, ...]:
    """Draw a stream of orders.

    Arrivals, stations, parcels and due dates come from generators of their own: a longer stream begins like a shorter
    one, and one with other due dates brings the same parcels at the same times.

    Args:
        site: Gives the station names.
        config: Kind, rate, waves, skew, due dates, priorities.
        duration_s: Length of the stream if `n_orders` does not say how many there are [s].
        n_orders: Number of orders; None = all that come within `duration_s`.
        rng: Source of randomness.

    Returns:
        Orders, ascending in release time.

    Raises:
        ConfigError: So long a stream at such a rate has more than `MAX_ORDERS` orders.
    """
    longest_s = 3600.0 * MAX_ORDERS / config.rate_per_h
    valid = f"at most {longest_s:g} with --rate {config.rate_per_h:g} and without --tasks"
    require(n_orders is not None or duration_s <= longest_s, "--duration", duration_s, valid)
    arrivals, places, parcels, terms = rng.spawn(4)
    times = _arrivals(config, duration_s, n_orders, arrivals)
    picks = _Popular(site.station_names("pick"), config, places, n_busy=config.bottleneck_n)
    drops = _Popular(site.station_names("drop"), config, places)
    # Drawn on only where it is needed: chance is otherwise what it was.
    sources = rng.spawn(1)[0] if config.sources_n > 1 else None
    shares = (config.emergency_share, 1.0 - config.emergency_share - config.idle_share, config.idle_share)
    classes, priorities = np.cumsum(shares).tolist(), list(Priority)
    orders = []
    for k, release_s in enumerate(times):
        size_m = draw_edges(parcels)
        chance, of_class, slack_share = terms.random(3).tolist()
        slack_s = between(config.slack_s, slack_share)
        pick = picks.draw(places)
        priority = priorities[min(bisect_right(classes, of_class), len(priorities) - 1)]
        orders.append(
            Delivery(
                name=f"order_{k + 1}",
                release_s=release_s,
                pick=pick,
                drop=drops.draw(places),
                mass_kg=draw_mass(parcels),
                size_m=size_m,
                due_s=round(release_s + slack_s, 3) if chance < config.due_share else math.inf,
                priority=priority,
                picks=() if sources is None else _sources(site, pick, config.sources_n, sources),
            )
        )
    return tuple(orders)


def _arrivals(config: StreamConfig, duration_s: float, n_orders: int | None, rng: np.random.Generator) -> list[float]:
    """Release times, ascending [s]."""
    times: list[float] = []
    start_s = 0.0
    while (len(times) < n_orders) if n_orders is not None else (start_s < duration_s):
        if config.kind in (StreamKind.WAVES, StreamKind.SKEWED_WAVES):
            n = rng.poisson(config.rate_per_h * config.wave_s / 3600.0)
            times += np.sort(start_s + rng.uniform(0.0, config.wave_share * config.wave_s, n)).tolist()
            start_s += config.wave_s
        else:
            start_s += float(rng.exponential(3600.0 / config.rate_per_h))
            times.append(start_s)
    within = times[:n_orders] if n_orders is not None else [time for time in times if time < duration_s]
    return [round(time, 3) for time in within]


def _sources(site: Site, pick: str, n: int, rng: np.random.Generator) -> tuple[str, ...]:
    """A pick station, and others drawn evenly, `n` in all or as many as there are."""
    names = site.station_names("pick")
    others = [names[k] for k in rng.permutation(len(names)) if names[k] != pick]
    return (pick, *others[: n - 1])


class _Popular:
    """Stations drawn by popularity: all alike, or by Zipf's law in an order of popularity that is drawn first.

    Where some are a bottleneck, the most popular ones together have the bottleneck's share.
    """

    def __init__(self, names: list[str], config: StreamConfig, rng: np.random.Generator, *, n_busy: int = 0) -> None:
        skewed = config.kind in (StreamKind.SKEWED, StreamKind.SKEWED_WAVES)
        weight = np.arange(1.0, len(names) + 1.0) ** (-config.zipf if skewed else 0.0)
        if 0 < n_busy < len(names):
            weight[:n_busy] *= config.bottleneck_share / weight[:n_busy].sum()
            weight[n_busy:] *= (1.0 - config.bottleneck_share) / weight[n_busy:].sum()
        self._names = [names[k] for k in rng.permutation(len(names))]
        self._up_to: list[float] = np.cumsum(weight / weight.sum()).tolist()

    def draw(self, rng: np.random.Generator) -> str:
        return self._names[min(bisect_right(self._up_to, rng.random()), len(self._names) - 1)]
