"""Parking: who waits goes to the nearest free place."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.missions.phases import ON_VISIT, PARKED, CarPhase
from planners.mapf.distance_table import UNREACHABLE
from tests.unit.fleet.missions.floor import Floor, visit


def test_a_car_that_waits_in_a_lane_goes_to_the_nearest_place() -> None:
    floor = Floor(n_cars=1)
    floor.stand(0, floor.dock_of("pick_1"))
    floor.parking.send(tick=0)
    assert floor.ways.goals[0] == floor.places.parking[0]  # 5 moves; the others are 7 or more
    assert not floor.traffic.stay[0]


def test_of_equally_near_places_the_smallest_state_is_taken_and_the_next_car_goes_elsewhere() -> None:
    floor = Floor(n_cars=2)
    floor.parking.send(tick=0)
    assert floor.ways.goals.tolist() == sorted(floor.places.parking)[:2]


def test_a_car_that_has_a_place_keeps_it_and_may_be_pushed() -> None:
    floor = Floor(n_cars=1)
    floor.ways.send(0, floor.places.parking[5], rank_s=0.0, stay=True, tick=0)
    floor.parking.send(tick=1)
    assert floor.ways.goals[0] == floor.places.parking[5]
    assert not floor.traffic.stay[0]


def test_a_car_makes_room_for_a_visit_to_its_place() -> None:
    floor = Floor(orders=[visit("v", "parking_1")], n_cars=2)
    floor.parking.send(tick=0)
    floor.visiting("v", car=1)
    floor.parking.send(tick=1)
    assert floor.ways.goals[0] != floor.places.parking[0]
    assert floor.ways.goals[1] == floor.places.parking[0]


def test_a_car_without_a_way_is_sent_nowhere() -> None:
    floor = Floor(n_cars=1)
    floor.stand(0, floor.state(0, 5))
    floor.wall_in(0)
    floor.parking.send(tick=0)
    assert floor.ways.goals[0] == -1


def test_nobody_is_sent_when_nobody_waits() -> None:
    floor = Floor(n_cars=1)
    floor.missions.enter(0, CarPhase.RECOVERING)
    floor.parking.send(tick=0)
    assert floor.ways.goals[0] == -1


def sent_naively(floor: Floor) -> list[int]:
    """The goals after `Parking.send`, place by place and car by car."""
    goals, phases = floor.ways.goals.tolist(), floor.missions.phase
    waiting = [car for car in range(floor.n_cars) if phases[car] in PARKED]
    visited = {goals[car] for car in range(floor.n_cars) if phases[car] in ON_VISIT}
    taken = visited | {goals[car] for car in waiting}
    for car in waiting:
        if goals[car] in floor.places.parking and goals[car] not in visited and floor.ways.reaches(car, goals[car]):
            continue
        ways = [(floor.ways.of_car(car, state), state) for state in floor.places.parking if state not in taken]
        moves, state = min(ways, default=(UNREACHABLE, -1))
        if moves < UNREACHABLE:
            goals[car] = state
            taken.add(state)
    return goals


@pytest.mark.parametrize("seed", range(30))
def test_cars_are_sent_as_if_each_looked_at_all_places(seed: int) -> None:
    rng = np.random.default_rng(seed)
    floor = Floor(n_cars=5)
    states = rng.permutation(floor.graph.n_states).tolist()
    cells: set[int] = {int(floor.graph.state_cell[state]) for state in floor.ways.tails}
    for car in range(5):
        state = next(s for s in states if int(floor.graph.state_cell[s]) not in cells)
        cells.add(int(floor.graph.state_cell[state]))
        floor.stand(car, state)
        phase = rng.choice([CarPhase.IDLE, CarPhase.RETIRED, CarPhase.STANDING, CarPhase.RECOVERING])
        floor.missions.enter(car, CarPhase(phase))
        goal = int(rng.choice([-1, *floor.places.parking, floor.dock_of("pick_1")]))
        if goal >= 0:
            floor.ways.send(car, goal, rank_s=0.0, stay=True, tick=0)
    if seed % 3 == 0:
        floor.block(*rng.choice(sorted(set(range(72)) - cells), 6, replace=False).tolist())
    expected = sent_naively(floor)
    floor.parking.send(tick=1)
    assert floor.ways.goals.tolist() == expected


def full_floor() -> Floor:
    """A floor with one car more than parking places, whose last car finds all of them taken."""
    n_places = len(Floor(n_cars=1).places.parking)
    floor = Floor(n_cars=n_places + 1)
    for car, place in enumerate(floor.places.parking):
        floor.ways.send(car, place, rank_s=0.0, stay=False, tick=0)
    return floor


def test_a_car_that_finds_all_places_taken_waits_on_the_lane_and_may_be_pushed() -> None:
    floor = full_floor()
    car = floor.n_cars - 1
    floor.stand(car, int(floor.places.waiting[0]))
    floor.ways.send(car, floor.dock_of("pick_1"), rank_s=30.0, stay=True, tick=0)
    floor.parking.send(tick=1)
    assert floor.ways.goals[car] == -1
    assert not floor.traffic.stay[car]
    assert floor.traffic.rank[car] == 0.0


def test_in_a_dock_it_goes_on_to_the_first_cell_where_it_may_wait() -> None:
    floor = full_floor()
    car = floor.n_cars - 1
    floor.stand(car, floor.dock_of("pick_1"))
    floor.parking.send(tick=0)
    goal = int(floor.ways.goals[car])
    assert goal in floor.places.waiting
    moves = floor.ways.moves_to(np.array([floor.dock_of("pick_1")]), floor.places.waiting.astype(np.int32))
    assert floor.ways.between(floor.dock_of("pick_1"), goal) == moves.min()
    assert not floor.traffic.stay[car]


def test_a_car_on_the_lane_takes_a_place_that_becomes_free() -> None:
    floor = full_floor()
    car = floor.n_cars - 1
    floor.stand(car, int(floor.places.waiting[0]))
    floor.parking.send(tick=0)
    floor.missions.enter(0, CarPhase.RECOVERING)
    floor.ways.wait(0)
    floor.parking.send(tick=1)
    assert floor.ways.goals[car] == floor.places.parking[0]
