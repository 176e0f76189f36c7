"""Where cars wait, ways cost more; what is not seen again is forgotten."""

from __future__ import annotations

import numpy as np

from fleet.traffic.crowding import FORGET_S, MOST_COST, Crowding

NOBODY = np.empty(0, dtype=np.int64)


def seen(cells: list[int], seconds: int) -> Crowding:
    crowding = Crowding(5)
    for now_s in range(1, seconds + 1):
        crowding.see(np.array(cells, dtype=np.int64), float(now_s))
    return crowding


def test_the_longer_cars_wait_in_a_cell_the_more_it_costs() -> None:
    costs = [int(seen([2], seconds).costs()[2]) for seconds in (1, 10, 30, 300)]
    assert costs[0] == 0, "who waits a moment is no crowd"
    assert costs == sorted(costs)
    assert costs[-1] == MOST_COST


def test_other_cells_cost_nothing_more() -> None:
    assert seen([2], 300).costs()[[0, 1, 3, 4]].tolist() == [0, 0, 0, 0]


def test_a_crowd_that_is_gone_is_forgotten() -> None:
    crowding = seen([1, 2], 300)
    crowding.see(NOBODY, 300 + 3 * FORGET_S)
    assert not crowding.costs().any()


def test_the_share_of_time_counts_and_not_how_often_it_is_asked() -> None:
    often, seldom = Crowding(3), Crowding(3)
    for now_s in np.arange(0.1, 20.05, 0.1):
        often.see(np.array([1]), float(now_s))
    for now_s in (10.0, 20.0):
        seldom.see(np.array([1]), now_s)
    assert often.costs().tolist() == seldom.costs().tolist()
    assert 0 < often.costs()[1] < MOST_COST
