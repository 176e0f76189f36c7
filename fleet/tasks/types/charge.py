"""Charge: a car goes to a charger and stays until its battery is full."""

from __future__ import annotations

from fleet.tasks.fields import Fields, OrdersError
from fleet.tasks.order import Order, Visit
from fleet.tasks.types.task_type import Setting


class ChargeType:
    """To a charger, or to the nearest that is free, until the battery is full."""

    required = ()
    optional = ("places",)

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        names = setting.places.numbered("charger", setting.n_chargers)
        if not names:
            raise OrdersError("type is 'charge'; valid: any other, because this run has no batteries (--battery)")
        places = setting.places.among(fields, "places", names, f"{', '.join(names)}, or none for any of them")
        return (Visit.of(shared, kind="charge", errands=(places or names,), until_full=True),)
