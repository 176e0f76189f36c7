"""CrowdCosts: compared with counting cell by cell."""

from __future__ import annotations

import numpy as np
import pytest

from maps.grid import GridMap
from planners.mapf.distance_table import DistanceTable
from planners.mapf.multi_step.crowd_costs import CrowdCosts
from planners.mapf.multi_step.multi_step_kernel import wishes_to_stay
from planners.mapf.multi_step.multi_step_pibt import Mover, exact_costs
from tests.unit.planners.mapf.lanes import open_grid

MOST = 24


@pytest.mark.parametrize(("reach", "roomy"), [(3, 0.4), (1, 0.0), (8, 0.2)])
def test_costs_grow_with_the_share_of_free_cells_around_that_are_taken(reach: int, roomy: float) -> None:
    rng = np.random.default_rng(0)
    for shape in ((1, 1), (3, 20), (17, 11)):
        free = rng.random(shape) < 0.8
        free[0, 0] = True
        costs = CrowdCosts(GridMap(free), MOST, reach=reach, roomy=roomy)
        for share in (0.0, 0.5, 1.0):
            cells = np.flatnonzero(free & (rng.random(shape) < share)).astype(np.int32)
            taken = np.zeros(free.size, dtype=np.bool_)
            taken[cells] = True
            expected = []
            for row, col in np.ndindex(*shape):
                square = slice(max(row - reach, 0), row + reach + 1), slice(max(col - reach, 0), col + reach + 1)
                full = taken.reshape(shape)[square].sum() / max(free[square].sum(), 1)
                expected.append(int(MOST * max(full - roomy, 0.0) / (1.0 - roomy) + 0.5))
            assert costs.of(cells).tolist() == expected


def test_a_full_floor_costs_the_most_and_an_empty_one_nothing() -> None:
    costs = CrowdCosts(GridMap(np.ones((5, 5), dtype=np.bool_)), MOST)
    assert set(costs.of(np.arange(25, dtype=np.int32)).tolist()) == {MOST}
    assert set(costs.of(np.empty(0, dtype=np.int32)).tolist()) == {0}


def test_of_two_ways_that_cost_the_same_the_one_with_more_room_is_taken() -> None:
    graph = open_grid(2, 2)
    free = np.zeros(4, dtype=np.bool_)
    table, row = DistanceTable(graph, free).rows(np.array([3], dtype=np.int32))
    for crowded, other in ((1, 2), (2, 1)):
        crowd = np.zeros(4, dtype=np.int32)
        crowd[crowded] = 1
        for seed in range(5):
            mover = Mover(graph, free, 1, length=1, seed=seed)
            mover.begin(np.zeros(1, dtype=np.int32))
            after = mover.step(
                exact_costs(table, graph.n_states),
                wishes_to_stay(row),
                np.zeros(1, dtype=np.int32),
                weight=np.ones(1),
                most_tries=10,
                allow_rotation=True,
                polish=lambda: False,
                crowd=crowd,
            )
            assert after.tolist() == [other]
