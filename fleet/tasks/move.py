"""Move: a car goes to a place."""

from __future__ import annotations

from fleet.tasks.fields import Fields, OrdersError
from fleet.tasks.order import Order, Visit
from fleet.tasks.task_type import Setting


class MoveType:
    """To one place, and on at once unless it is to stand there."""

    required = ("places",)
    optional = ("stand_s",)

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        places = setting.places.places(fields, "places")
        if len(places) != 1:
            raise OrdersError(f"places is {fields.text('places')!r}; valid: one place")
        stand_s = setting.places.stand_s(fields, places, 0.0)
        return (Visit.of(shared, kind="move", stops=(places,), stand_s=stand_s),)
