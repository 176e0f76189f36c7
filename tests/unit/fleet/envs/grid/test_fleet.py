"""The fleet on lane-graph timesteps keeps the rules of the whole fleet."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.envs.grid.fleet import STATION_CAP, STATION_ROOM, FleetSite, GridFleet
from fleet.envs.grid.kernel import NEVER, NONE, Phase, Stage
from fleet.envs.layers.order_streams import episode_orders, rate_per_h
from maps.site import load_site

SMALL = FleetSite.of(load_site("small"))


def fleet(n_cars: int, seed: int = 0, load: float = 1.5) -> GridFleet:
    """Return a fleet with ten minutes of orders."""
    return GridFleet(SMALL, n_cars, episode_orders(SMALL, n_cars, load, 600.0, np.random.default_rng(seed)), seed)


@pytest.mark.parametrize(("n_cars", "seed"), [(1, 0), (6, 1), (18, 2)])
def test_the_books_are_right_in_every_timestep(n_cars: int, seed: int) -> None:
    grid = fleet(n_cars, seed)
    cars, tasks, stations, floor = grid.cars, grid.tasks, grid.stations, SMALL.floor
    picks = np.array([place.kind == "pick" for place in SMALL.site.stations])
    for _ in range(600):
        grid.assign_nearest()
        before = cars.state.copy()
        grid.move(grid.planned())
        assert len(np.unique(SMALL.graph.state_cell[cars.state])) == n_cars
        moved = np.flatnonzero(before != cars.state)
        assert all(cars.state[car] in SMALL.move_to[before[car]] for car in moved)
        # Bookings, slots and tasks under way are what cars and tasks say.
        booked = np.bincount(cars.station[cars.booked], minlength=len(picks))
        assert np.array_equal(booked, stations.booked)
        assert booked.max() <= STATION_CAP
        on_slot = np.isin(tasks.stage, (Stage.READY, Stage.ASSIGNED))
        taken = np.bincount(tasks.pick[on_slot], minlength=len(picks))
        assert np.array_equal((floor.n_slots - taken)[picks], stations.free[picks])
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
