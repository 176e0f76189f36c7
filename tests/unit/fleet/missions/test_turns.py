"""Turns: when arms are taken, which times are left, and how long cars would wait for them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from fleet.missions.turns import (
    CHANGE_S,
    ArmPace,
    GivenTurns,
    StationArrivals,
    TakenTurns,
    TurnBook,
    first_turn,
    free_times,
    free_turn,
    line_up,
    next_turns,
)
from tests.unit.fleet.missions.floor import Floor, delivery, visit

ON, OFF = False, True
"""Under way, and not yet."""


def lined_up(*cars: tuple[float, bool], cycle_s: float = 10.0, free_s: float = 0.0) -> GivenTurns:
    """Cars that come to one station, in the order in which they were bound for it."""
    n = len(cars)
    arrivals = StationArrivals(
        np.arange(n), np.zeros(n, dtype=np.int64), np.array([c[0] for c in cars]), np.array([c[1] for c in cars], bool)
    )
    return line_up(arrivals, ArmPace(np.array([cycle_s]), np.array([free_s])))


def taken(*begin_s: float, cycle_s: float = 10.0, free_s: float = 0.0) -> TakenTurns:
    """One station with some turns taken."""
    return TakenTurns(np.array([0, len(begin_s)]), np.array(begin_s), ArmPace(np.array([cycle_s]), np.array([free_s])))


@pytest.mark.parametrize(
    ("cars", "turn_s"),
    [
        ([(4.0, ON)], [4.0]),
        ([(30.0, ON), (4.0, ON)], [30.0, 4.0]),  # as they come
        ([(8.0, ON), (4.0, ON), (5.0, ON)], [24.0, 4.0, 14.0]),
        ([(4.0, ON), (4.0, ON)], [4.0, 14.0]),  # who was bound first is first
        ([(4.0, OFF), (6.0, ON)], [16.0, 6.0]),  # who is not under way yet comes after all that are
        ([(30.0, ON), (4.0, OFF)], [30.0, 4.0]),  # and takes what they leave
        ([(14.0, ON), (4.0, OFF)], [14.0, 4.0]),  # a whole turn is just enough
        ([(13.9, ON), (4.0, OFF)], [13.9, 23.9]),
        ([(0.0, ON), (19.0, ON), (5.0, OFF)], [0.0, 19.0, 29.0]),
        ([(9.0, OFF), (0.0, OFF)], [9.0, 19.0]),  # in the order in which they were bound
        ([(12.0, OFF), (0.0, OFF)], [12.0, 0.0]),
        ([(30.0, OFF), (0.0, OFF), (0.0, OFF), (0.0, OFF), (0.0, OFF)], [30.0, 0.0, 10.0, 20.0, 40.0]),
    ],
)
def test_a_line(cars: list[tuple[float, bool]], turn_s: list[float]) -> None:
    line = lined_up(*cars)
    assert line.turn_s == pytest.approx(turn_s)
    assert line.turns.begin_s == pytest.approx(sorted(turn_s))


@pytest.mark.parametrize("waiting", [ON, OFF])
def test_nobody_is_served_before_the_arm_is_free(waiting: bool) -> None:
    assert lined_up((4.0, waiting), (5.0, waiting), free_s=7.0).turn_s.tolist() == [7.0, 17.0]


def test_the_spacing_is_the_cycle_of_the_arm() -> None:
    assert lined_up((4.0, ON), (4.0, ON), (0.0, OFF), cycle_s=6.0).turn_s.tolist() == [4.0, 10.0, 16.0]


def test_each_station_has_a_line_of_its_own() -> None:
    pace = ArmPace(np.array([10.0, 6.0, 5.0]), np.array([0.0, 0.0, 8.0]))
    comes_s, stands = np.array([1.0, 1.0, 2.0, 1.0]), np.zeros(4, dtype=bool)
    line = line_up(StationArrivals(np.arange(4), np.array([0, 0, 2, 2]), comes_s, stands), pace)
    assert line.turn_s.tolist() == [1.0, 11.0, 13.0, 8.0]
    assert line.turns.first.tolist() == [0, 2, 2, 4]
    assert line.turns.begin_s.tolist() == [1.0, 11.0, 8.0, 13.0]


def in_line_naively(cars: Sequence[tuple[float, bool]], cycle_s: float, free_s: float) -> list[float]:
    """Who is under way is served as it comes; the others find the first time that is a cycle away from all turns."""
    turn_s = [0.0] * len(cars)
    last_s = -np.inf
    for k in sorted((k for k, car in enumerate(cars) if not car[1]), key=lambda k: (cars[k][0], k)):
        last_s = turn_s[k] = max(cars[k][0], free_s, last_s + cycle_s)
    turns = [turn_s[k] for k, car in enumerate(cars) if not car[1]]
    for k in (k for k, car in enumerate(cars) if car[1]):
        soonest_s = max(cars[k][0], free_s)
        starts_s = [soonest_s, *(turn + cycle_s for turn in turns if turn + cycle_s >= soonest_s)]
        turn_s[k] = min(start for start in starts_s if all(abs(start - turn) >= cycle_s for turn in turns))
        turns.append(turn_s[k])
    return turn_s


@pytest.mark.parametrize("seed", range(40))
def test_turns_are_the_first_that_are_left(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cars = [(float(rng.integers(0, 60)), bool(rng.random() < 0.5)) for _ in range(rng.integers(1, 10))]
    cycle_s, free_s = float(rng.integers(2, 13)), float(rng.integers(0, 20))
    line = lined_up(*cars, cycle_s=cycle_s, free_s=free_s)
    assert line.turn_s.tolist() == in_line_naively(cars, cycle_s, free_s)
    assert (np.diff(line.turns.begin_s) >= cycle_s).all()
    # The next car that is not under way gets what `first_turn` says.
    comes_s = float(rng.integers(0, 60))
    assert first_turn(line.turns, 0, comes_s) == in_line_naively([*cars, (comes_s, OFF)], cycle_s, free_s)[-1]


@pytest.mark.parametrize(
    ("comes_s", "turn_s"), [(0.0, 30.0), (4.0, 30.0), (31.5, 31.5), (34.0, 34.0), (34.5, 54.0), (60.0, 60.0)]
)
def test_the_first_turn_that_is_left(comes_s: float, turn_s: float) -> None:
    assert first_turn(taken(5.0, 20.0, 44.0, free_s=3.0), 0, comes_s) == turn_s


def test_the_next_turns_fill_what_is_left() -> None:
    assert next_turns(taken(12.0, 40.0, free_s=1.0), 0, 5).tolist() == [1.0, 22.0, 50.0, 60.0, 70.0]
    assert next_turns(taken(), 0, 2).tolist() == [0.0, 10.0]
    assert next_turns(taken(), 0, 0).tolist() == []


@pytest.mark.parametrize("seed", range(20))
def test_the_times_that_are_left_are_those_of_single_cars(seed: int) -> None:
    """Two stations, whose turns lie apart, touch, and overlap."""
    rng = np.random.default_rng(seed)
    n = rng.integers(0, 9, 2)
    begin_s = np.concatenate([np.sort(rng.integers(0, 60, k)).astype(np.float64) for k in n])
    pace = ArmPace(rng.integers(3, 12, 2).astype(np.float64), rng.integers(0, 9, 2).astype(np.float64))
    turns = TakenTurns(np.array([0, n[0], n.sum()]), begin_s, pace)
    free = free_times(turns)
    for station in (0, 1):
        for comes_s in range(90):
            assert free_turn(free, station, float(comes_s)) == first_turn(turns, station, float(comes_s))


# --- TurnBook: 5 moves of 1.1 s to pick_1 for car 0, 10 for car 1, 12 for car 2 and 8 for car 3


def bound(*names: str, n_cars: int = 4) -> Floor:
    """Each car has one of some deliveries from pick_1 to drop_1, and is on its way."""
    floor = Floor(orders=[delivery(name) for name in names], n_cars=n_cars)
    for car, name in enumerate(names):
        floor.assigned(name, car)
    return floor


def test_a_turn_lasts_as_long_as_arms_took_of_late_and_a_change_of_cars() -> None:
    floor = Floor()
    for took_s in (50.0, 4.0, 6.0, 4.0, 6.0):
        floor.stations.time(floor.stations[1]).add(took_s)
    assert floor.turns.pace(0.0).cycle_s.tolist() == [7.0 + CHANGE_S, 5.0 + CHANGE_S, 7.0 + CHANGE_S, 7.0 + CHANGE_S]
    least_s = np.array([0.0, 11.0, 9.0, 12.0])
    book = TurnBook(floor.missions, floor.ways, least_s)
    assert book.pace(0.0).cycle_s.tolist() == [10.0, 11.0, 10.0, 12.0]


def test_an_arm_at_work_is_free_when_it_has_ended_and_cars_have_changed() -> None:
    floor = bound("a")
    assert floor.turns.pace(0.0).free_s.tolist() == [0.0] * 4
    floor.arrive(0)
    floor.services.begin(floor.stations[0], 0, floor.task("a"), 10.0)
    assert floor.turns.pace(12.0).free_s.tolist() == [5.0 + CHANGE_S, 0.0, 0.0, 0.0]
    assert floor.turns.pace(99.0).free_s.tolist() == [CHANGE_S, 0.0, 0.0, 0.0]  # late, but not done


def test_who_is_bound_comes_and_who_is_served_does_not() -> None:
    floor = bound("a", "b", "c")
    floor.missions.hold(2, floor.task("c"), "by hand")
    floor.arrive(0)
    floor.services.begin(floor.stations[0], 0, floor.task("a"), 0.0)
    for found in (floor.turns.bound(), floor.turns.line_of(0, 0.0)[0]):
        assert found.car.tolist() == [1, 2]
        assert found.station.tolist() == [0, 0]
        assert found.comes_s == pytest.approx([11.0, 13.2])
        assert found.waits.tolist() == [False, True]
    assert floor.turns.line_of(1, 0.0)[0].car.tolist() == []
    line = line_up(floor.turns.bound(), floor.turns.pace(0.0))
    assert floor.turns.line_of(0, 0.0)[1].turn_s.tolist() == line.turn_s.tolist()


def test_all_turns_are_those_of_cars_that_come_and_where_they_go_on_to() -> None:
    """Picked from 5.5 s and 15.5 s on, 10 s each, and 12.1 s on the way to drop_1."""
    booked = bound("a", "b").turns.all(0.0)
    assert booked.turns.first.tolist() == [0, 2, 2, 4, 4]
    assert booked.turns.begin_s == pytest.approx([5.5, 15.5, 27.6, 37.6])
    assert booked.early_s == pytest.approx([0.0, 4.5, 0.0, 0.0])


def test_a_car_that_is_being_loaded_goes_on_when_the_arm_is_done() -> None:
    """The arm needs 4 s more and 3 s for the change; then it is 12.1 s to drop_1."""
    floor = bound("a")
    floor.arrive(0)
    floor.services.begin(floor.stations[0], 0, floor.task("a"), 0.0)
    booked = floor.turns.all(3.0)
    assert booked.turns.first.tolist() == [0, 0, 0, 1, 1]
    assert booked.turns.begin_s == pytest.approx([19.1])


def test_a_parcel_that_is_carried_takes_one_turn_and_a_visit_of_a_dock_one() -> None:
    floor = Floor(orders=[delivery("a"), visit("v", "pick_1")])
    floor.carried("a", car=0)
    floor.visiting("v", car=1)
    booked = floor.turns.all(0.0)
    assert booked.turns.first.tolist() == [0, 1, 1, 2, 2]
    assert booked.turns.begin_s == pytest.approx([11.0, 13.2])


def test_nobody_has_a_turn_on_an_empty_floor() -> None:
    booked = Floor().turns.all(0.0)
    assert booked.turns.first.tolist() == [0] * 5
    assert booked.early_s.tolist() == [0.0, 0.0]
