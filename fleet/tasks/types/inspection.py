"""Inspection: a car goes to a place, stands there, and tells where it stood."""

from __future__ import annotations

from fleet.tasks.fields import Fields
from fleet.tasks.order import Order, Visit
from fleet.tasks.types.task_type import Setting

STAND_S = 5.0
"""How long a car stands to inspect if the order does not say [s]."""


class InspectType:
    """To one place, to stand there; an event `inspected` tells the pose."""

    required = ("places",)
    optional = ("stand_s",)

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        place = setting.places.one(fields, "places")
        stand_s = setting.places.stand_s(fields, (place,), STAND_S)
        return (Visit.of(shared, kind="inspect", errands=((place,),), stand_s=stand_s, inspects=True),)
