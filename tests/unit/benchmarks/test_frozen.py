"""Floors on which a fleet must never freeze: alike for a seed, in one part, of all widths and densities."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label

from benchmarks.mapf.frozen import FIRST_SEED, FLOORS, draw_floor


def test_floors_are_in_one_part_and_of_many_kinds() -> None:
    densities, corridors = [], []
    for seed in range(FIRST_SEED, FIRST_SEED + FLOORS):
        problem = draw_floor(seed)
        free = problem.grid.free
        assert label(free)[1] == 1
        assert free.ravel()[problem.start_cell].all()
        assert free.ravel()[problem.errand_cell].all()
        assert len(set(problem.start_cell.tolist())) == problem.n_robots
        densities.append(problem.n_robots / free.sum())
        inside = np.pad(free, 1)
        rolled = np.array([np.roll(inside, step, axis) for step in (1, -1) for axis in (0, 1)])
        beside = rolled.sum(axis=0)[1:-1, 1:-1][free]
        corridors.append((float(np.mean(beside <= 2)), int((beside == 1).sum())))
    assert min(densities) < 0.15
    assert max(densities) > 0.45
    narrow = [share for share, _ in corridors]
    assert min(narrow) < 0.3
    assert max(narrow) > 0.6
    assert sum(ends > 0 for _, ends in corridors) > 5


def test_a_seed_draws_one_floor() -> None:
    first, again, other = draw_floor(1), draw_floor(1), draw_floor(2)
    assert (first.grid.free == again.grid.free).all()
    assert (first.start_cell == again.start_cell).all()
    assert first.grid.free.shape != other.grid.free.shape
