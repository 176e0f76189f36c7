"""Tiny problems of the League, drawn by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maps.grid import GridMap
from maps.lorr import LeagueProblem

CORRIDOR = [".....", "@@@@.", "....."]
"""Cells 0..4 east, 9, and 10..14: a way round with a single turn in it."""
ROOM = ["......"] * 6
"""Room for everybody."""


def problem_of(
    floor: Sequence[str],
    starts: Sequence[int],
    tasks: Sequence[Sequence[int]],
    *,
    pool_size: int | None = None,
    round_robin: bool = False,
) -> LeagueProblem:
    """Problem with a pool that holds all tasks of the list, if nothing else is said."""
    return LeagueProblem(
        name="tiny",
        grid=GridMap(np.array([[letter == "." for letter in row] for row in floor])),
        start_cell=np.array(starts, dtype=np.int32),
        errand_ptr=np.cumsum([0, *map(len, tasks)]).astype(np.int32),
        errand_cell=np.array([cell for errands in tasks for cell in errands], dtype=np.int32),
        pool_size=len(tasks) if pool_size is None else pool_size,
        round_robin=round_robin,
    )
