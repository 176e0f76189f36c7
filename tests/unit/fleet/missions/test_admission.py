"""Admission: turns at a station, and who is held back where it is in nobody's way."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.missions.admission import StationQueues, _give_turns
from fleet.missions.phases import CarPhase
from fleet.missions.ways import MOVE_S
from fleet.tasks.order import Priority
from tests.unit.fleet.missions.floor import Floor, delivery, visit


def waiting(n: int, n_cars: int = 4) -> Floor:
    """A floor with `n` deliveries from pick_1 whose parcels lie there."""
    floor = Floor(orders=[delivery(f"o{k}") for k in range(n)], n_cars=n_cars)
    for k in range(n):
        floor.ready(f"o{k}")
    return floor


def set_off(floor: Floor, name: str, car: int) -> None:
    """A car gets a task, as the allocation does it."""
    floor.missions.assign(car, floor.task(name), 0.0)
    floor.admission.set_off(car, floor.task(name), 0, 0.0)


def test_a_car_sets_off_to_an_arm_that_is_free_and_books_when_it_is_near() -> None:
    floor = waiting(2)
    set_off(floor, "o0", 0)  # 5 moves
    set_off(floor, "o1", 2)  # 12 moves: more than it needs a booking for
    assert [floor.missions.phase[car] for car in (0, 2)] == [CarPhase.TO_PICK, CarPhase.TO_PICK]
    assert floor.bookings.booked.tolist() == [True, False, False, False]
    assert floor.ways.goals[0] == floor.dock_of("pick_1")
    assert floor.missions.faults() == []


def test_a_car_that_would_come_much_too_early_is_held() -> None:
    """Car 1 needs 11 s to the arm, which is free after 5.5 s and 7 s: 1.5 s too early. Car 3 with 8.8 s finds its turn
    after car 1's, at 19.5 s, and would come 10.7 s too early."""
    floor = waiting(3)
    for name, car in (("o0", 0), ("o1", 1), ("o2", 3)):
        set_off(floor, name, car)
    assert [floor.missions.phase[car] for car in (0, 1, 3)] == [CarPhase.TO_PICK, CarPhase.TO_PICK, CarPhase.HELD]
    cause = "pick_1 is busy and it would come 11 s too early"
    assert floor.log.events[3:] == [("held", {"car": "car_3", "task": "o2", "cause": cause})]
    assert floor.missions.faults() == []


def test_a_car_goes_on_when_its_turn_is_near() -> None:
    floor = waiting(3)
    for name, car in (("o0", 0), ("o1", 1), ("o2", 3)):
        set_off(floor, name, car)
    floor.admission.call(1, 0.1)
    assert floor.missions.phase[3] is CarPhase.HELD
    floor.missions.leave(0)
    floor.missions.leave(1)
    floor.admission.call(2, 0.2)
    assert floor.missions.phase[3] is CarPhase.TO_PICK
    assert floor.log.events[-1] == ("called", {"car": "car_3", "task": "o2", "station": "pick_1"})
    assert floor.task("o2").reason == "car_3 may go on to pick_1"


def test_a_car_that_comes_near_a_full_station_is_held() -> None:
    floor = waiting(1, n_cars=3)
    set_off(floor, "o0", 2)
    for car in (0, 1):  # two others are there
        floor.missions.bind(car, 0)
        floor.bookings.book(car)
    floor.admission.call(0, 0.0)
    assert floor.missions.phase[2] is CarPhase.TO_PICK  # 12 moves are far enough
    floor.stand(2, floor.places.parking[3])
    assert floor.moves(2, "pick_1") == 8
    floor.admission.call(1, 0.1)
    assert floor.missions.phase[2] is CarPhase.HELD
    assert floor.log.events[-1][1]["cause"] == "pick_1 is full (car_0, car_1)"


def test_a_car_that_would_be_in_time_is_held_if_the_station_is_full() -> None:
    floor = waiting(1)
    for car in (0, 1):
        floor.missions.bind(car, 0)
        floor.bookings.book(car)
        floor.missions.leave(car)
    for car in (0, 1):  # they have been served and stand there still, in nobody's queue
        floor.bookings.bind(car, 0)
        floor.bookings.book(car)
        floor.bookings.leave(car, stands_there=True)
    set_off(floor, "o0", 3)
    assert floor.missions.phase[3] is CarPhase.HELD
    assert floor.log.events[-1][1]["cause"] == "pick_1 is full (car_0, car_1)"


def test_a_car_waits_for_the_arm_that_serves_another() -> None:
    """The arm has begun 1 s ago and needs 6 s more; car 3 would be there in 8.8 s."""
    floor = waiting(2)
    first = floor.task("o0")
    floor.missions.assign(0, first, 0.0)
    floor.missions.bind(0, 0)
    floor.stand(0, floor.dock_of("pick_1"))
    floor.services.begin(floor.stations[0], 0, first, 0.0)
    floor.missions.assign(3, floor.task("o1"), 1.0)
    floor.admission.set_off(3, floor.task("o1"), 10, 1.0)
    assert floor.missions.phase[3] is CarPhase.TO_PICK


@pytest.mark.parametrize(
    ("priority", "loaded", "rank_s"),
    [
        (Priority.NORMAL, False, 0.0),
        (Priority.NORMAL, True, 30.0),
        (Priority.EMERGENCY, False, 60.0),
        (Priority.EMERGENCY, True, 90.0),
    ],
)
def test_loaded_cars_and_emergencies_go_first(priority: Priority, loaded: bool, rank_s: float) -> None:
    floor = Floor(orders=[delivery("a", priority=priority)])
    task = floor.carried("a", car=0) if loaded else floor.assigned("a", car=0)
    floor.missions.leave(0)
    floor.admission.set_off(0, task, 0, 0.0)
    assert floor.traffic.rank[0] == rank_s
    assert floor.missions.phase[0] is (CarPhase.TO_DROP if loaded else CarPhase.TO_PICK)


def test_a_car_that_must_wait_is_bound_and_held() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=1)
    floor.admission.wait(1, task, "by hand")
    assert (floor.bookings.place_of[1], floor.missions.phase[1]) == (2, CarPhase.HELD)
    assert floor.log.events[-1] == ("held", {"car": "car_1", "task": "a", "cause": "by hand"})


def test_visits_to_docks_and_an_empty_floor_are_none_of_its_business() -> None:
    floor = Floor(orders=[visit("v", "pick_1")])
    floor.admission.call(0, 0.0)
    task = floor.visiting("v", car=0)
    floor.missions.hold(0, task, "by hand")
    floor.missions.bind(0, 0)
    floor.admission.call(1, 0.1)
    assert floor.missions.phase[0] is CarPhase.HELD


def test_a_booking_changes_the_turns_of_those_behind() -> None:
    """Two are held; when the first books, the second is asked again with new turns, and is too early."""
    floor = waiting(2)
    for name, car in (("o0", 0), ("o1", 3)):
        floor.missions.assign(car, floor.task(name), 0.0)
        floor.admission.wait(car, floor.task(name), "by hand")
    floor.admission.call(0, 0.0)
    # Car 0 is served from 5.5 s to 12.5 s, so car 3 with 8.8 s would come 3.7 s early, which is soon enough.
    assert [floor.missions.phase[car] for car in (0, 3)] == [CarPhase.TO_PICK, CarPhase.TO_PICK]
    assert [facts["car"] for kind, facts in floor.log.events if kind == "called"] == ["car_0", "car_3"]


def early_naively(queues: StationQueues, moves: np.ndarray, booked: np.ndarray) -> list[float]:
    """How long before its turn each car would come: who has booked first, as they come, then as they were bound; each
    takes the first moment at which the arm is free for a whole service."""
    early = [0.0] * len(queues.cars)
    for station, (begin, end) in enumerate(zip(queues.first[:-1].tolist(), queues.first[1:].tolist(), strict=True)):
        service_s, turns = float(queues.service_s[station]), []
        rows = list(range(begin, end))
        near = sorted((k for k in rows if booked[queues.cars[k]]), key=lambda k: (moves[k], k))
        for k in [*near, *(k for k in rows if not booked[queues.cars[k]])]:
            if queues.cars[k] == queues.served[station]:
                continue
            comes_s = MOVE_S * float(moves[k])
            soonest = max(comes_s, float(queues.free_s[station]))
            # It can begin at once, or at the end of another turn.
            starts = [soonest, *(turn + service_s for turn in turns if turn + service_s >= soonest)]
            free = [s for s in starts if all(s + service_s <= t or t + service_s <= s for t in turns)]
            turns.append(min(free))
            early[k] = min(free) - comes_s
    return early


@pytest.mark.parametrize("seed", range(40))
def test_turns_are_the_first_gaps_that_are_long_enough(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, n_stations = int(rng.integers(1, 9)), 2
    cut = int(rng.integers(0, n + 1))
    queues = StationQueues(
        cars=rng.permutation(n).astype(np.int64),
        first=np.array([0, cut, n]),
        served=rng.choice([-1, *range(n)], n_stations).astype(np.int64),
        service_s=rng.integers(3, 13, n_stations).astype(float),
        free_s=rng.integers(0, 10, n_stations).astype(float),
    )
    moves = rng.integers(0, 40, n).astype(np.uint16)
    booked = rng.random(n) < 0.4
    found = np.zeros(n)
    _give_turns(queues, moves, booked, found)
    np.testing.assert_allclose(found, early_naively(queues, moves, booked), atol=1e-9)
