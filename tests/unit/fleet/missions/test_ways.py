"""Ways: distances and goals on twelve by six cells, counted by hand."""

from __future__ import annotations

import numpy as np

from fleet.missions.places import NOT_BOOKED, Place
from planners.mapf.distance_table import UNREACHABLE
from tests.unit.fleet.missions.floor import Floor


def test_from_dock_to_dock_a_car_leaves_the_row_and_comes_back() -> None:
    """One cell out of the row, nine columns along, one cell back."""
    floor = Floor()
    pick, drop = floor.dock_of("pick_1"), floor.dock_of("drop_1")
    assert floor.ways.between(pick, drop) == 11
    assert floor.ways.moves(np.array([pick, drop]), drop).tolist() == [11, 0]
    assert floor.ways.moves_each(np.array([pick, drop]), np.array([drop, drop], dtype=np.int32)).tolist() == [11, 0]


def test_ways_begin_where_planned_moves_end() -> None:
    floor = Floor()
    floor.stand(0, floor.dock_of("pick_1"))
    assert floor.ways.tails[0] == floor.dock_of("pick_1")
    assert floor.ways.of_car(0, floor.dock_of("drop_2")) == 14  # three more rows


def test_nothing_leads_past_what_is_blocked() -> None:
    floor = Floor()
    floor.wall_in(0)
    assert floor.ways.of_car(0, floor.dock_of("pick_1")) == UNREACHABLE
    assert not floor.ways.reaches(0, floor.dock_of("pick_1"))
    assert floor.ways.reaches(1, floor.dock_of("pick_1"))
    assert not floor.ways.reaches_place(0, floor.places.named("drop_1"))
    assert floor.ways.blocked.any()
    assert not floor.ways.cut_off(0, floor.dock_of("pick_1")), "it is blocked for now"


def test_a_dead_car_blocks_for_good() -> None:
    floor = Floor()
    floor.traffic.set_dead(0, [int(floor.graph.state_cell[floor.ways.tails[0]])])
    assert floor.ways.cut_off(0, floor.dock_of("pick_1"))
    assert not floor.ways.cut_off(1, floor.dock_of("pick_1"))
    assert floor.ways.n_cuts == 1


def test_of_several_ways_into_a_cell_the_shortest_counts() -> None:
    floor = Floor()
    lane = floor.places.named("2,5")
    assert lane.number == NOT_BOOKED
    tail = int(floor.ways.tails[0])
    by_way = [floor.ways.between(tail, state) for state in lane.states]
    assert len(by_way) > 1
    assert floor.ways.to_place(lane, np.array([tail])).tolist() == [min(by_way)]
    assert floor.ways.nearest_state(lane, tail) == lane.states[int(np.argmin(by_way))]


def test_of_equally_near_states_the_smallest_is_taken() -> None:
    floor = Floor()
    state = int(floor.ways.tails[0])
    twice = Place(name="twice", states=(state, state), number=NOT_BOOKED)
    assert floor.ways.nearest_state(twice, state) == state


def test_a_car_has_come_when_it_stands_at_its_goal_and_has_stopped() -> None:
    floor = Floor()
    goal = floor.dock_of("pick_1")
    floor.ways.send(0, goal, rank_s=30.0, stay=True, tick=4)
    assert (floor.ways.goals[0], floor.traffic.rank[0], floor.traffic.stay[0]) == (goal, 30.0, True)
    assert not floor.ways.has_come(0)
    floor.come(0)
    assert floor.ways.has_come(0)
    assert floor.ways.stands_at(0, goal)
    assert floor.ways.idle(0)
    floor.driver.moving.add(0)
    assert not floor.ways.has_come(0)
    assert not floor.ways.stands_at(0, goal)
    floor.ways.let_push(0)
    assert not floor.traffic.stay[0]


def test_places_are_numbered_as_stations_then_chargers_then_parking() -> None:
    places = Floor().places
    numbers = {name: places.named(name).number for name in ("pick_1", "drop_2", "charger_1", "parking_1", "parking_6")}
    assert numbers == {"pick_1": 0, "drop_2": 3, "charger_1": 4, "parking_1": 6, "parking_6": 11}
    assert list(places.charger_numbers) == [4, 5]
    assert places.cells[4] == 12 + 6  # second row, seventh column
    assert places.named("pick_1") is places.named("pick_1")
