"""Floors: what counts after the start, and problems drawn anew."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.mapf.drawn import draw_problem
from benchmarks.mapf.floors import settled
from maps.formats.lorr import read_problem
from tests.unit.fleet.league.problems import random_problem, write_files


def test_the_start_does_not_count() -> None:
    assert settled([1, 2, 3, 10, 10, 10, 10], 200) == {"settled": 10.0, "kept": 100.0}


def test_the_last_quarter_is_compared_with_the_best_in_a_row() -> None:
    figures = settled([0, 0, 0, 10, 20, 20, 10, 8, 8, 8, 8], 200)
    assert figures["settled"] == pytest.approx(11.5)
    assert figures["kept"] == pytest.approx(40.0)


def test_a_run_that_is_over_before_it_has_settled_has_no_figures() -> None:
    assert settled([5, 5, 5], 200) == {}


def test_a_drawn_problem_has_the_floor_and_the_tasks_of_the_published_one(tmp_path: Path) -> None:
    published = write_files(tmp_path, random_problem(2))
    old = read_problem(published)
    new = read_problem(draw_problem(published, tmp_path, 20, 7))
    assert (new.grid.free == old.grid.free).all()
    assert new.n_robots == len(set(new.start_cell.tolist())) == 20
    assert new.pool_size == 30
    tasks = [sorted(tuple(p.errands(k).tolist()) for k in range(p.n_tasks)) for p in (old, new)]
    assert tasks[0] == tasks[1]
    again, other = (read_problem(draw_problem(published, tmp_path, 20, seed)) for seed in (7, 8))
    assert (again.start_cell == new.start_cell).all()
    assert not np.array_equal(other.start_cell, new.start_cell)
