"""Park: a car goes to a parking place."""

from __future__ import annotations

from fleet.tasks.fields import Fields
from fleet.tasks.order import Order, Visit
from fleet.tasks.place_names import first_to_last
from fleet.tasks.types.task_type import Setting


class ParkType:
    """To a parking place, or to the nearest that is free."""

    required = ()
    optional = ("places", "stand_s")

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        names = setting.places.numbered("parking", len(setting.site.parking))
        words = f"{first_to_last('parking', len(names))}, or none for any of them"
        places = setting.places.among(fields, "places", names, words)
        stand_s = setting.places.stand_s(fields, places, 0.0)
        return (Visit.of(shared, kind="park", errands=(places or names,), stand_s=stand_s),)
