"""The benchmark of mixed fleets: what it orders, of whom, and that fleets are compared on the same orders."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from benchmarks.robots.mixed import (
    ALIKE,
    EVERY_S,
    FLEET,
    HEAVY_KG,
    MEDIUM,
    N_ORDERS,
    Case,
    config_of,
    floor,
    write_orders,
)
from benchmarks.robots.stations import HEAVIEST_KG
from benchmarks.robots.stations import write_orders as write_light
from fleet.robots import CARS
from fleet.tasks.order import Ability
from fleet.tasks.order_file import read_orders
from maps.site import load_site

CARRIES_ALL = [Ability(max_payload_kg=CARS["husky"].spec().max_payload_kg)]


def test_every_third_order_is_too_heavy_for_a_racecar(tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    heavy = write_orders(path, floor(), Case(fleet=FLEET, seed=3))
    orders = read_orders(path, floor(), CARRIES_ALL).orders
    assert len(orders) == N_ORDERS
    assert {order.name for order in orders if order.mass_kg == HEAVY_KG} == heavy
    assert len(heavy) == N_ORDERS // 3
    light_kg = max(order.mass_kg for order in orders if order.name not in heavy)
    assert light_kg < CARS["racecar"].spec().max_payload_kg < HEAVY_KG
    assert [order.release_s for order in orders] == [EVERY_S * k for k in range(N_ORDERS)]


def test_both_fleets_have_the_same_light_orders_and_are_as_large(tmp_path: Path) -> None:
    cases = [Case(fleet=fleet, seed=3, heavy=False) for fleet in (FLEET, ALIKE)]
    files = []
    for case in cases:
        path = tmp_path / "orders.csv"
        assert write_orders(path, floor(), case) == set()
        files.append(path.read_text())
    assert files[0] == files[1]
    configs = [config_of("wide.toml", path, case) for case in cases]
    assert [Counter(config.models) for config in configs] == [FLEET, ALIKE]


def test_orders_of_unlike_arms_pass_both_and_are_up_to_the_heaviest(tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    write_light(path, 4)
    orders = read_orders(path, load_site("small"), CARRIES_ALL).orders
    assert [(order.pick, order.drop, order.mass_kg) for order in orders[:2]] == [("pick_1", "drop_1", HEAVIEST_KG)] * 2
    assert len(orders) == 6
    assert max(order.mass_kg for order in orders) <= HEAVIEST_KG


def test_orders_of_the_wide_medium_floor_are_taken_there(tmp_path: Path) -> None:
    site, path = floor(MEDIUM), tmp_path / "orders.csv"
    assert (site.grid.rows, site.grid.cols, site.grid.cell_m) == (24, 40, 1.25)
    write_orders(path, site, Case(fleet=FLEET, seed=1, floor=MEDIUM))
    assert len(read_orders(path, site, CARRIES_ALL).orders) == N_ORDERS
