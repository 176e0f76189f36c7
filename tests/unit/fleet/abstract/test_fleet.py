"""The fleet on lane-graph timesteps keeps the rules of the whole fleet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fleet.abstract.fleet import STATION_CAP, STATION_ROOM, FleetSite, GridFleet
from fleet.abstract.kernel import NEVER, NONE, Phase, Stage
from fleet.envs.layers.order_streams import episode_orders, rate_per_h
from maps.site import load_site

SMALL = FleetSite.of(load_site("small"))


def with_few_slots() -> FleetSite:
    """Return the same site with one slot at each end of the first ways."""
    site = load_site("small")
    ends = [replace(end, slots=end.slots[:1]) if end.name.endswith("_1") else end for end in site.stations]
    return FleetSite.of(replace(site, stations=tuple(ends)))


FEW_SLOTS = with_few_slots()


def fleet(n_cars: int, seed: int = 0, load: float = 1.5, place: FleetSite = SMALL) -> GridFleet:
    """Return a fleet with ten minutes of orders."""
    return GridFleet(place, n_cars, episode_orders(place, n_cars, load, 600.0, np.random.default_rng(seed)), seed)


@pytest.mark.parametrize("place", [SMALL, FEW_SLOTS], ids=["small", "few_slots"])
@pytest.mark.parametrize(("n_cars", "seed"), [(1, 0), (6, 1), (18, 2)])
def test_the_books_are_right_in_every_timestep(n_cars: int, seed: int, place: FleetSite) -> None:
    grid = fleet(n_cars, seed, place=place)
    cars, tasks, stations, floor = grid.cars, grid.tasks, grid.stations, place.floor
    ends = place.site.stations
    n_open = n_cars  # an order for each car comes in at once
    for _ in range(600):
        grid.assign_nearest()
        before = cars.state.copy()
        grid.move(grid.planned())
        # A task is ready when it is released, and open until it is picked.
        assert np.array_equal(tasks.stage != Stage.ORDERED, tasks.release <= grid.now)
        n_open += np.isin(tasks.stage, (Stage.READY, Stage.ASSIGNED)).sum()
        assert grid.counts.open[0] == n_open
        assert len(np.unique(SMALL.graph.state_cell[cars.state])) == n_cars
        moved = np.flatnonzero(before != cars.state)
        assert all(cars.state[car] in SMALL.move_to[before[car]] for car in moved)
        # Bookings and tasks under way are what cars and tasks say, and who books a pick station has a slot there.
        booked = np.bincount(cars.station[cars.booked], minlength=len(ends))
        assert np.array_equal(booked, stations.booked)
        assert booked.max() <= STATION_CAP
        assert all(n <= len(end.slots) for n, end in zip(booked, ends, strict=True) if end.kind == "pick")
        to_pick = tasks.pick[tasks.stage == Stage.ASSIGNED]
        to_drop = tasks.drop[np.isin(tasks.stage, (Stage.ASSIGNED, Stage.CARRIED))]
        assert np.array_equal(np.bincount(np.append(to_pick, to_drop), minlength=len(ends)), stations.under_way)
        assert stations.under_way.max() <= STATION_ROOM
        # A task has one car, and a car one task.
        busy = np.flatnonzero(cars.phase != Phase.FREE)
        assert np.array_equal(tasks.car[cars.task[busy]], busy)
        assert len(np.unique(cars.task[busy])) == len(busy)
        assert (cars.task[cars.phase == Phase.FREE] == NONE).all()
        parked = (cars.phase == Phase.FREE) | cars.held
        assert ((cars.spot != NONE) == parked).all()
        spots = cars.spot[parked]
        assert len(np.unique(spots)) == len(spots)
    done = tasks.stage == Stage.DELIVERED
    assert done.sum() == grid.counts.delivered.sum() > 4 * n_cars
    assert (tasks.done[done] < NEVER).all()
    assert (tasks.done[done] >= tasks.release[done] + 2 * floor.service_steps).all()


def test_only_a_pick_station_has_no_more_room_than_slots_and_room_is_used_to_the_full() -> None:
    rooms = dict(zip((end.name for end in FEW_SLOTS.site.stations), FEW_SLOTS.floor.station_cap.tolist(), strict=True))
    assert rooms == {"pick_1": 1, "pick_2": STATION_CAP, "drop_1": STATION_CAP, "drop_2": STATION_CAP}
    grid = fleet(18, load=3.0, place=FEW_SLOTS)
    most = np.zeros(len(rooms), dtype=np.int64)
    for _ in range(600):
        grid.assign_nearest()
        grid.move(grid.planned())
        most = np.maximum(most, grid.stations.booked)
    assert most[:2].tolist() == [1, STATION_CAP]
    assert most[2] > 1


def test_nobody_stands_for_ever() -> None:
    grid = fleet(18, load=3.0)
    stood = np.zeros(18, dtype=np.int64)
    for _ in range(900):
        grid.assign_nearest()
        before = grid.cars.state.copy()
        grid.move(grid.planned())
        on_its_way = (grid.cars.state != grid.cars.goal) & ~grid.locked
        stood = np.where((before == grid.cars.state) & on_its_way, stood + 1, 0)
        assert stood.max() < 60


def test_a_copy_goes_on_alike_and_apart() -> None:
    grid = fleet(8)
    for _ in range(100):
        grid.assign_nearest()
        grid.move(grid.planned())
    twin, other = grid.copy(), grid.copy()
    ways = []
    for one in (grid, twin):
        for _ in range(100):
            one.assign_nearest()
            one.move(one.planned())
        ways.append((one.cars.state.tolist(), one.tasks.stage.tolist()))
    assert ways[0] == ways[1]
    assert other.now == 100
    assert other.cars.state.tolist() != ways[0][0]


def test_the_stream_begins_with_an_order_for_each_car_and_keeps_its_rate() -> None:
    orders = episode_orders(SMALL, 6, 1.5, 36_000.0, np.random.default_rng(0))
    released = np.array([order.release_s for order in orders])
    assert (released[:6] == 0.0).all()
    assert (np.diff(released) >= 0.0).all()
    assert released[-1] < 36_000.0
    assert len(orders) == pytest.approx(10 * rate_per_h(SMALL, 6, 1.5), rel=0.1)
    slack = [order.due_s - order.release_s for order in orders if np.isfinite(order.due_s)]
    assert min(slack) >= 119.0
    assert max(slack) <= 601.0
