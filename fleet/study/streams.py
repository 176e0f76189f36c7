"""Streams: the orders of each seed, drawn once for all fleets and kept as files that the demo reads too."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from fleet.config import require
from fleet.study.design import Design
from fleet.tasks.order import Order, generate_orders
from fleet.tasks.order_file import write_orders
from maps.site import Site

ORDERS_PER_CAR_H = 180.0
"""Orders per hour and car of the largest fleet, more than a car can deliver: so that work never ends."""


def write_streams(design: Design, site: Site, out: Path) -> dict[int, Path]:
    """Write the orders of every seed, those released within the time of a run; they do not depend on the fleet.

    Args:
        design: The study.
        site: Its site.
        out: Existing directory.

    Returns:
        The file of each seed.
    """
    return {seed: _write(out / f"orders_{seed}.csv", _orders(design, site, seed)) for seed in design.seeds}


def _orders(design: Design, site: Site, seed: int) -> tuple[Order, ...]:
    cars = max(design.robots)
    expected = ORDERS_PER_CAR_H * cars * design.duration_s / 3600.0
    enough = math.ceil(cars + expected + 6.0 * math.sqrt(expected) + 10.0)
    drawn = generate_orders(site, enough, cars, np.random.default_rng([seed, _STREAM]))
    return tuple(order for order in drawn if order.release_s < design.duration_s)


def _write(path: Path, orders: tuple[Order, ...]) -> Path:
    require(len(orders) > 0, "--duration", "too short", "long enough for one order")
    write_orders(path, orders)
    return path


_STREAM = 0x57
"""Keeps the seed tree of the orders apart from that of the runs."""
