"""Patrol: a car goes to several places in order."""

from __future__ import annotations

from itertools import pairwise

from fleet.tasks.fields import Fields, OrdersError
from fleet.tasks.order import Order, Visit
from fleet.tasks.types.task_type import Setting
from maps.reading.shown import shown


class PatrolType:
    """Two places or more, in order."""

    required = ("places",)
    optional = ("stand_s",)

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        places = setting.places.places(fields, "places")
        if len(places) < 2:
            raise OrdersError(
                f"places is {shown(fields.text('places'))}; valid: two places or more, separated by semicolons"
            )
        twice = next((one for one, next_one in pairwise(places) if one == next_one), None)
        if twice is not None:
            raise OrdersError(
                f"places is {shown(fields.text('places'))}; valid: another place than {twice} after {twice}"
            )
        stand_s = setting.places.stand_s(fields, places, 0.0)
        return (Visit.of(shared, kind="patrol", errands=tuple((place,) for place in places), stand_s=stand_s),)
