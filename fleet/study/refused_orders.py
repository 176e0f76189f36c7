"""Refused orders: which orders of a file some fleets of a comparison are not given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fleet.abstract.run import require_plain
from fleet.robots.cars.models import usual_car
from fleet.tasks.order import ability_of
from fleet.tasks.order_file import read_orders
from maps.site import Site


def refused_orders(
    path: Path, site: Site, robots: Sequence[int], *, n_chargers: int, is_abstract: bool
) -> tuple[str, ...]:
    """Read an order file for fleets of some sizes, and say what is refused: larger fleets may be able to do more.

    Args:
        path: The file.
        site: Where it is to be done.
        robots: Numbers of cars.
        n_chargers: Chargers that orders may be for.
        is_abstract: Whether abstract runs have to know the orders.

    Returns:
        A sentence for each order that is refused.

    Raises:
        ConfigError: Abstract runs do not know an order.
        OrdersError: The file cannot be read, or a fleet can be given none of it.
    """
    payload_kg = usual_car().max_payload_kg
    causes: dict[str, str] = {}
    sizes: dict[str, list[int]] = {}
    for n in robots:
        book = read_orders(path, site, [ability_of(car, payload_kg) for car in range(n)], n_chargers=n_chargers)
        for order in book.orders if is_abstract else ():
            require_plain(order)
        for refusal in book.refused:
            causes.setdefault(refusal.where, str(refusal))
            sizes.setdefault(refusal.where, []).append(n)
    return tuple(f"order refused{_with(sizes[where], robots)}: {cause}" for where, cause in causes.items())


def _with(sizes: Sequence[int], robots: Sequence[int]) -> str:
    """Of which fleets that is said; nothing if of all."""
    if len(sizes) == len(robots):
        return ""
    return f" with {', '.join(map(str, sizes))} car{'' if list(sizes) == [1] else 's'}, not with others"
