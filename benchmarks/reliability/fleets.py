"""Fleets: sites that ship and generated ones, and a size of fleet that each has room for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from maps.site import save_site
from maps.warehouse import generate_warehouse

SITES = ("cell", "small", "twin", "medium")
FLOORS: tuple[Mapping[str, Any], ...] = (
    {"rows": 13, "cols": 20, "pick": 2, "drop": 2, "parking": 10},
    {"rows": 13, "cols": 29, "pick": 3, "drop": 3, "parking": 12},
    {"rows": 20, "cols": 30, "pick": 4, "drop": 4, "parking": 20},
    {"rows": 24, "cols": 44, "pick": 6, "drop": 6, "parking": 30},
    {"rows": 9, "cols": 17, "pick": 1, "drop": 1, "parking": 6},
    {"rows": 16, "cols": 24, "pick": 2, "drop": 3, "parking": 14},
    {"rows": 30, "cols": 30, "pick": 5, "drop": 3, "parking": 24},
    {"rows": 20, "cols": 44, "pick": 3, "drop": 5, "parking": 24},
)
CARS = {"cell": (2, 2), "twin": (3, 7), "small": (3, 10)}
USUAL_CARS = (3, 20)


@contextmanager
def fleets() -> Iterator[dict[str, tuple[int, int]]]:
    """Twelve sites, by name or file, and how few and how many cars there may be: no more than park there."""
    with TemporaryDirectory() as folder:
        found = {name: CARS.get(name, USUAL_CARS) for name in SITES}
        for k, floor in enumerate(FLOORS):
            path = Path(folder) / f"floor_{k}.toml"
            save_site(generate_warehouse(**floor), path)
            low, high = USUAL_CARS
            found[str(path)] = low, min(high, floor["parking"])
        yield found


def drawn(sites: Mapping[str, tuple[int, int]], rng: np.random.Generator) -> tuple[str, int]:
    """A site, and a number of cars."""
    site = list(sites)[rng.integers(len(sites))]
    low, high = sites[site]
    return site, int(rng.integers(low, high + 1))
