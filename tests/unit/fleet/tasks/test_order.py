"""Orders: their classes, and a generator of them."""

import numpy as np
import pytest

from fleet.tasks.order import MAX_EDGE_M, MAX_MASS_KG, MIN_EDGE_M, MIN_MASS_KG, Order, Priority, generate_orders
from maps.site import Site


@pytest.mark.parametrize(
    ("priority", "due_s", "rank"),
    [
        (Priority.EMERGENCY, np.inf, 0),
        (Priority.EMERGENCY, 90.0, 0),
        (Priority.NORMAL, np.inf, 1),
        (Priority.NORMAL, 90.0, 1),
        (Priority.IDLE, np.inf, 2),
        (Priority.IDLE, 90.0, 1),
    ],
)
def test_an_idle_order_with_a_due_date_counts_as_normal(priority: Priority, due_s: float, rank: int) -> None:
    assert Order(name="a", release_s=0.0, due_s=due_s, priority=priority).rank == rank


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
