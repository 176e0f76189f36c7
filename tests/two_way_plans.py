"""Plans with two-way aisles that nobody drew: halls side by side, racks between them, and aisles one cell wide."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from maps.errors import MapsError
from maps.site import Site, site_from_plan

_HALL = 4
"""Columns of a hall with docks: the docks, a lane past them, parking, and a lane in front of the racks."""
_DRAWS = 50


def draw_two_way_site(seed: int) -> Site:
    """Two or three halls, with one to three aisles from each to the next, some with a place to pass in them.

    Args:
        seed: Seed of everything: rows, halls, the length and number of aisles, docks and parking.
    """
    rng = np.random.default_rng(seed)
    for _ in range(_DRAWS):
        try:
            site = site_from_plan(_draw(rng), name=f"two_way_{seed}", allow_reverse=True)
        except MapsError:  # such as an aisle that meets a parking cell
            continue
        if len(site.parking) >= _LEAST_PARKING:
            return site
    raise ValueError(f"no two-way plan in {_DRAWS} draws of seed {seed}")


_LEAST_PARKING = 8


def _draw(rng: np.random.Generator) -> list[str]:
    rows = int(rng.integers(12, 18))
    gaps = rng.integers(3, 10, size=int(rng.integers(1, 3)))
    middle = 3
    cols = 2 + 2 * _HALL + int(gaps.sum()) + middle * (len(gaps) - 1)
    chars = np.full((rows, cols), "=")
    chars[[0, -1]] = "#"
    chars[:, [0, -1]] = "#"
    chars[1:-1, 1 : 1 + _HALL] = "."
    chars[1:-1, -1 - _HALL : -1] = "."
    parking = [3, cols - 4]
    left = 1 + _HALL
    aisles: set[int] = set()
    for k, gap in enumerate(gaps):
        found = _aisles(chars, left, int(gap), rng)
        aisles |= found
        left += int(gap)
        if k < len(gaps) - 1:
            chars[1:-1, left : left + middle] = "."
            parking.append(left + 1)
            left += middle
    _place_docks(chars, rng)
    for col in parking:
        for row in range(2, rows - 2):
            if chars[row, col] == "." and rng.random() < 0.6:
                chars[row, col] = "K"
    return ["".join(line) for line in chars]


def _aisles(chars: npt.NDArray[np.str_], left: int, gap: int, rng: np.random.Generator) -> set[int]:
    """Draw the aisles of one gap between halls, each a cell into the halls at its ends."""
    rows = len(chars)
    wanted = int(rng.integers(1, 4))
    chosen: set[int] = set()
    for row in rng.permutation(np.arange(2, rows - 2)).tolist():
        if len(chosen) < wanted and all(abs(row - other) >= 4 for other in chosen):
            chosen.add(row)
    for row in chosen:
        chars[row, left - 1 : left + gap + 1] = "x"
        if gap >= 5 and rng.random() < 0.5:
            at = left + int(rng.integers(1, gap - 3))
            chars[row + rng.choice((-1, 1)), at : at + 3] = "x"
    return chosen


def _place_docks(chars: npt.NDArray[np.str_], rng: np.random.Generator) -> None:
    rows, cols = chars.shape
    for dock_col, arm_col, dock in ((1, 0, "P"), (cols - 2, cols - 1, "D")):
        row = int(rng.integers(3, 5))
        while row <= rows - 4:
            chars[row, dock_col] = dock
            chars[row - 1 : row + 2, arm_col] = ["_", "A", "_"]
            row += int(rng.integers(3, 5))
