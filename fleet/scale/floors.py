"""Floors: which generated site a fleet of some size is measured on."""

from __future__ import annotations

import math

from fleet.stations.service_time import PRIOR_MEAN_S
from maps.site import Site
from maps.warehouse import generate_warehouse

CELLS_PER_CAR = 24
"""Floor for each car, racks and parking included [cells]."""
LEAST_ROWS = 30
SHAPE = 5 / 3
"""Width by height."""
WAYS_SHARE = 0.4
"""Length of the ways of a task, there and loaded together, by rows and columns together."""
SPEED_MPS = 1.0
IDLE_FACTOR = 2.0
"""Stations by those that would always be busy: cars come at random, so arms that are busy half of their time."""


def floor_for(n_cars: int) -> Site:
    """Lay out a floor with islands of stations between the racks and parking for every car.

    Args:
        n_cars: Cars, at least 1.
    """
    rows = _rows(n_cars)
    return generate_warehouse(
        rows=rows,
        cols=_cols(rows),
        pick=n_drop_stations(n_cars),
        drop=n_drop_stations(n_cars),
        parking=n_cars,
        sides="none",
        islands=True,
        name=f"floor_{n_cars}",
    )


def n_drop_stations(n_cars: int) -> int:
    """Drop stations of that floor, and as many pick stations, by the rule of `maps.warehouse`; at least two."""
    rows = _rows(n_cars)
    task_s = WAYS_SHARE * (rows + _cols(rows)) / SPEED_MPS + 2.0 * PRIOR_MEAN_S
    return max(2, math.ceil(IDLE_FACTOR * n_cars * PRIOR_MEAN_S / task_s))


def _rows(n_cars: int) -> int:
    return max(LEAST_ROWS, math.ceil(math.sqrt(CELLS_PER_CAR / SHAPE * n_cars)))


def _cols(rows: int) -> int:
    return math.ceil(SHAPE * rows)
