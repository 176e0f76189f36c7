"""Move: a car goes to a place."""

from __future__ import annotations

from fleet.tasks.fields import Fields
from fleet.tasks.order import Order, Visit
from fleet.tasks.types.task_type import Setting


class MoveType:
    """To one place, and on at once unless it is to stand there."""

    required = ("places",)
    optional = ("stand_s",)

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        place = setting.places.one(fields, "places")
        stand_s = setting.places.stand_s(fields, (place,), 0.0)
        return (Visit.of(shared, kind="move", errands=((place,),), stand_s=stand_s),)
