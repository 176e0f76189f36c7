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

    def refused(n: int) -> dict[str, str]:
        payload_kg = usual_car().max_payload_kg
        book = read_orders(path, site, [ability_of(car, payload_kg) for car in range(n)], n_chargers=n_chargers)
        for order in book.orders if is_abstract else ():
            require_plain(order)
        return {refusal.where: str(refusal) for refusal in book.refused}

    causes, of_largest = refused(min(robots)), refused(max(robots))
    if causes.keys() == of_largest.keys():  # what the smallest can do all can, so those between have the same
        return tuple(f"order refused: {cause}" for cause in causes.values())
    by_size = {n: refused(n) for n in robots}
    sizes = {where: [n for n, own in by_size.items() if where in own] for where in causes}
    return tuple(f"order refused{_with(sizes[where], robots)}: {cause}" for where, cause in causes.items())


def _with(sizes: Sequence[int], robots: Sequence[int]) -> str:
    """Of which fleets that is said; nothing if of all."""
    if len(sizes) == len(robots):
        return ""
    return f" with {', '.join(map(str, sizes))} car{'' if list(sizes) == [1] else 's'}, not with others"
