"""TaskType: how one kind of order is written in an order file, and what becomes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from fleet.tasks.fields import Fields
from fleet.tasks.order import Order
from fleet.tasks.place_names import PlaceNames
from maps.site import Site


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What orders can refer to."""

    site: Site
    places: PlaceNames
    n_chargers: int
    """Chargers in use; 0 = cars have no batteries."""


class TaskType(Protocol):
    """One kind of order."""

    @property
    def required(self) -> tuple[str, ...]:
        """Fields it must have, beside those of all orders."""

    @property
    def optional(self) -> tuple[str, ...]:
        """Fields it may have."""

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """Make the deliveries and visits of one order.

        Args:
            shared: What it has in common with all orders.
            fields: Its own fields.
            setting: What they can refer to.

        Returns:
            One or more, in the order in which they are to be done.

        Raises:
            OrdersError: Names field, value and valid values.
        """
