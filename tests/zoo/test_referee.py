"""The referee: what it says of floors that were thought through by hand."""

from __future__ import annotations

import pytest

from tests.zoo.referee import possible
from tests.zoo.scenario import Cell

RING = ("#####", "#P..#", "#.#.#", "#..D#", "#####")
PICK, DROP = [(1, 1)], [(3, 3)]


@pytest.mark.parametrize(
    ("covered", "cars", "verdict"),
    [
        ([], [(1, 2)], True),
        ([(1, 3)], [(1, 2)], True),  # the other way round
        ([(1, 3), (3, 1)], [(1, 2)], False),  # cut
        ([(1, 1)], [(1, 2)], False),  # in the dock itself
        ([(3, 3)], [(1, 2)], False),
        ([(1, 2), (2, 1)], [(2, 3)], False),  # the car is on the wrong side
        ([(1, 2), (2, 1)], [(2, 3), (1, 1)], False),  # each car comes to one of both only
        ([], [], False),  # nobody lives
        ([(1, 2), (2, 1)], [], False),
    ],
)
def test_a_delivery(covered: list[Cell], cars: list[Cell], verdict: bool) -> None:
    assert possible(RING, covered, cars, [PICK, DROP]) is verdict


def test_arrows_do_not_count_and_kept_clear_cells_are_shut() -> None:
    assert possible(("P<<D",), [], [(0, 1)], [[(0, 0)], [(0, 3)]])
    assert not possible(("P<_D",), [], [(0, 1)], [[(0, 0)], [(0, 3)]])


def test_of_several_places_one_is_enough() -> None:
    assert possible(RING, [(3, 3)], [(1, 2)], [[(3, 3), (2, 3)]])


def test_a_car_whose_own_cell_is_covered_is_at_home_there_alone() -> None:
    assert possible(RING, [(1, 2)], [(1, 2)], [[(1, 2)]])
    assert not possible(RING, [(1, 2)], [(1, 2)], [PICK])
