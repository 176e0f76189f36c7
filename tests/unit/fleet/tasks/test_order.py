"""Orders from a file and from a generator; what a file gets wrong is in tests/integration/test_bad_input.py."""

from pathlib import Path

import numpy as np

from fleet.tasks.order import MAX_EDGE_M, MAX_MASS_KG, MIN_EDGE_M, MIN_MASS_KG, generate_orders, read_orders
from maps.site import Site

HEADER = "id,release_s,pick,drop,mass_kg,size_m\n"


def test_orders_are_read_in_the_order_of_their_release(small_site: Site, tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    path.write_text(
        HEADER
        + "late,12.5,pick_2,drop_1,0.25,0.06x0.05x0.08\n"
        + "first,0,pick_1,drop_2,2,0.1\n"
        + "\n"
        + ' second , 0 ,pick_1,drop_1,"0.05",0.04 \n',
        encoding="utf-8",
    )
    orders = read_orders(path, small_site)
    assert [order.name for order in orders] == ["first", "second", "late"]
    assert orders[0].size_m == (0.1, 0.1, 0.1)
    late = orders[2]
    assert (late.release_s, late.pick, late.drop, late.mass_kg) == (12.5, "pick_2", "drop_1", 0.25)
    assert late.size_m == (0.06, 0.05, 0.08)


def test_a_spreadsheet_s_file_is_read(small_site: Site, tmp_path: Path) -> None:
    """With a byte order mark and the line ends of another system."""
    path = tmp_path / "orders.csv"
    path.write_bytes(b"\xef\xbb\xbf" + (HEADER + "a,0,pick_1,drop_1,0.3,0.06\n").replace("\n", "\r\n").encode())
    assert [order.name for order in read_orders(path, small_site)] == ["a"]


def test_generated_orders_can_be_served(medium_site: Site) -> None:
    orders = generate_orders(medium_site, 200, 10, np.random.default_rng(0))
    names = {station.name for station in medium_site.stations}
    assert {order.pick for order in orders} | {order.drop for order in orders} == names
    assert all(order.pick.startswith("pick") and order.drop.startswith("drop") for order in orders)
    assert all(MIN_EDGE_M <= edge <= MAX_EDGE_M for order in orders for edge in order.size_m)
    assert all(MIN_MASS_KG <= order.mass_kg <= MAX_MASS_KG for order in orders)
    assert len({order.name for order in orders}) == 200


def test_generated_orders_come_at_the_rate_that_keeps_the_fleet_busy(medium_site: Site) -> None:
    times = np.array([order.release_s for order in generate_orders(medium_site, 1000, 10, np.random.default_rng(1))])
    assert (times[:10] == 0.0).all(), "one for each car at once"
    gaps = np.diff(times[9:])
    assert (gaps >= 0).all()
    # 990 exponential gaps of mean 2 s: the mean's standard deviation is 0.064 s
    assert abs(gaps.mean() - 2.0) < 0.2


def test_the_same_seed_gives_the_same_orders(small_site: Site) -> None:
    made = [generate_orders(small_site, 20, 3, np.random.default_rng(seed)) for seed in (5, 5, 6)]
    assert made[0] == made[1] != made[2]
