"""Floors: which generated site a fleet of some size is measured on."""

from __future__ import annotations

import math

from maps.site import Site
from maps.warehouse import generate_warehouse

CELLS_PER_CAR = 20
"""Floor for each car, racks and parking included [cells]."""
LEAST_ROWS = 24
SHAPE = 5 / 3
"""Width by height."""


def floor_for(n_cars: int) -> Site:
    """Lay out a floor with parking for every car, and with as many stations as its west and east walls have room for.

    Args:
        n_cars: Cars, at least 1.
    """
    rows = _rows(n_cars)
    return generate_warehouse(
        rows=rows,
        cols=math.ceil(SHAPE * rows),
        pick=n_drop_stations(n_cars),
        drop=n_drop_stations(n_cars),
        parking=n_cars,
        name=f"floor_{n_cars}",
    )


def n_drop_stations(n_cars: int) -> int:
    """Drop stations of that floor, and as many pick stations: one every three rows, none near a corner."""
    return (_rows(n_cars) - 7) // 3 + 1


def _rows(n_cars: int) -> int:
    return max(LEAST_ROWS, math.ceil(math.sqrt(CELLS_PER_CAR / SHAPE * n_cars)))
