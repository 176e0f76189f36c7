"""Services: what changes when an arm begins to work on a car, and that its end undoes it."""

from __future__ import annotations

from fleet.missions.phases import CarPhase
from fleet.missions.state import NOBODY
from fleet.tasks.board import TaskState
from fleet.traffic.floor_distances import DOCK_COST
from tests.unit.fleet.missions.floor import Floor, delivery


def served(took_s: float = 7.0) -> Floor:
    """One service at pick_1 from its begin to its end."""
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=0)
    floor.come(0)
    floor.services.begin(floor.stations[0], 0, task, 10.0)
    floor.stations.times.complete(0)
    floor.services.end(floor.stations[0], 10.0 + took_s)
    return floor


def test_a_service_begins_in_one_call() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=0)
    floor.come(0)
    floor.services.begin(floor.stations[0], 0, task, 10.0)
    cell = floor.places.cells[0]
    assert floor.missions.phase[0] is CarPhase.LOADING
    assert task.state is TaskState.LOADING
    assert floor.traffic.fixed.tolist() == [True, False]
    assert floor.executor.closed.nonzero()[0].tolist() == [cell]
    assert floor.missions.served.tolist() == [0, NOBODY, NOBODY, NOBODY]
    assert floor.world.serving == [0, -1, -1, -1]
    assert floor.services.under_way == [(0, 0)]
    assert floor.services.is_served(0)
    assert not floor.services.is_served(1)
    assert floor.stations.times.left_s(0, 12.0) == 5.0  # 7 s, of which 2 s have gone
    assert floor.missions.faults() == []


def test_the_end_of_a_service_undoes_its_begin() -> None:
    floor = served()
    floor.services.let_go(0)
    assert not floor.traffic.fixed.any()
    assert not floor.executor.closed.any()
    assert floor.missions.served.tolist() == [NOBODY] * 4
    assert floor.world.serving == [-1] * 4
    assert floor.services.under_way == []
    assert not floor.services.is_served(0)
    assert floor.stations.times.left_s(0, 17.0) == 0.0


def test_a_station_learns_how_long_its_services_take() -> None:
    floor = served(took_s=8.5)
    assert floor.stations.time(floor.stations[0]).mean_s == 8.5
    assert floor.stations.time(floor.stations[1]).mean_s == 7.0  # has not served yet


def test_unloading_has_phase_and_state_of_its_own() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=1)
    floor.come(1)
    floor.services.begin(floor.stations[2], 1, task, 0.0)
    assert floor.missions.phase[1] is CarPhase.UNLOADING
    assert task.state is TaskState.UNLOADING


def test_cars_that_only_pass_go_round_all_docks() -> None:
    """For plans, a dock is further away from anywhere else than it is; cells in the open are not."""
    floor = Floor()
    goal = floor.state(3, 5)
    far = floor.traffic.ways.to(goal) >= floor.traffic.tables.to(goal) + DOCK_COST - 1
    assert far[floor.stations.dock_states].all()
    assert not far[[floor.state(2, 5), floor.state(3, 6)]].any()
