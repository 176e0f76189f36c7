"""Prefetch: an arm takes the next parcel while cars change at its dock, or while its partner there has the tray."""

from __future__ import annotations

import numpy as np

from fleet.missions.parcels.perception import Sighting
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.tasks.board import TaskState
from maps.site import load_site
from tests.unit.fleet.missions.floor import SIZE_M, Floor, delivery, fake

TWIN = load_site("twin")
"""Two pick arms over one dock."""
NAMES = TWIN.station_names("pick")


def coming(n: int = 1, n_moves: int = 0) -> Floor:
    """Cars on their way to the first pick arm, the first one at or near the dock."""
    floor = Floor(site=TWIN, orders=[delivery(f"o{k}", NAMES[0]) for k in range(n)], n_cars=max(n, 2))
    for k in range(n):
        floor.assigned(f"o{k}", car=k)
    dock = floor.dock_of(NAMES[0])
    state = next(s for s in range(floor.graph.n_states) if floor.ways.between(s, dock) == n_moves)
    floor.stand(0, state)
    return floor


def hold(floor: Floor) -> None:
    """The first arm holds what it has fetched."""
    floor.arms.services[0].state = ArmPhase.HOLDING


def test_a_parcel_is_fetched_when_its_car_is_near() -> None:
    floor = coming(n_moves=8)
    floor.prefetch.tick(0)
    (request,) = floor.arms.fetched
    assert (request.arm, request.parcel, request.pick_via) == (0, 0, 0)
    np.testing.assert_array_equal(request.pick_pose, floor.inventory.pose(floor.task("o0")))
    assert floor.log.events[-1] == ("fetched_ahead", {"task": "o0", "station": NAMES[0], "car": "car_0"})


def test_a_parcel_is_not_fetched_when_its_car_is_far() -> None:
    floor = coming(n_moves=9)
    floor.prefetch.tick(0)
    assert floor.arms.fetched == []


def test_arms_look_every_quarter_of_a_second() -> None:
    floor = coming(n_moves=8)
    floor.prefetch.tick(1)
    assert floor.arms.fetched == []


def test_an_arm_that_serves_or_moves_fetches_nothing() -> None:
    floor = coming()
    floor.missions.served[0] = 1
    floor.prefetch.tick(0)
    floor.missions.served[0] = -1
    floor.arms.begin(0)
    floor.prefetch.tick(2)
    assert floor.arms.fetched == []


def test_a_parcel_is_fetched_twice_at_most() -> None:
    floor = coming()
    for tick in (0, 2, 4):
        floor.prefetch.tick(tick)
        floor.arms.come_home(0)
    assert len(floor.arms.fetched) == 2


def test_a_parcel_without_slot_or_sight_is_left_to_the_transfer() -> None:
    floor = coming()
    floor.task("o0").pick_slot = None
    floor.prefetch.tick(0)
    other = coming()
    other.perception = fake(find=lambda task, station: Sighting(pose=np.zeros(7), size_m=SIZE_M, reason="is dark"))
    other.prefetch.tick(0)
    assert floor.arms.fetched == other.arms.fetched == []


def test_a_parcel_is_kept_in_the_grip_for_its_car() -> None:
    floor = coming()
    floor.prefetch.tick(0)
    hold(floor)
    floor.prefetch.tick(2)
    assert floor.arms.returned == []


def test_a_parcel_whose_task_has_ended_is_put_back() -> None:
    floor = coming()
    floor.prefetch.tick(0)
    hold(floor)
    floor.board.move(floor.task("o0"), TaskState.CANCELLED, 1.0, "by hand")
    floor.prefetch.tick(2)
    assert floor.arms.returned == [0]
    assert floor.log.events[-1] == ("put_back", {"task": "o0", "station": NAMES[0]})


def test_a_parcel_is_put_back_if_another_car_is_there_first() -> None:
    floor = coming(n=2)
    floor.prefetch.tick(0)  # for car 0
    hold(floor)
    floor.stand(0, int(floor.places.parking[3]))
    floor.stand(1, floor.dock_of(NAMES[0]))
    floor.prefetch.tick(2)
    assert floor.arms.returned == [0]


def test_an_arm_with_a_dock_of_its_own_fetches_too() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.assigned("a", car=0)
    floor.come(0)
    floor.prefetch.tick(0)
    assert [request.arm for request in floor.arms.fetched] == [0]
