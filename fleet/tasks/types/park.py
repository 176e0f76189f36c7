"""Park: a car goes to a parking place."""

from __future__ import annotations

from fleet.tasks.fields import Fields, OrdersError
from fleet.tasks.order import Order, Visit
from fleet.tasks.types.task_type import Setting
from maps.reading.shown import shown


class ParkType:
    """To a parking place, or to the nearest that is free."""

    required = ()
    optional = ("places", "stand_s")

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        names = setting.places.numbered("parking", len(setting.site.parking))
        places = setting.places.places(fields, "places")
        for place in places:
            if place not in names:
                raise OrdersError(f"places is {shown(place)}; valid: parking_1 to {names[-1]}, or none for any of them")
        stand_s = setting.places.stand_s(fields, places, 0.0)
        return (Visit.of(shared, kind="park", errands=(places or names,), stand_s=stand_s),)
