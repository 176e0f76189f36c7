"""Pod: a car fetches a shelf pod, stands with it where people pick from it, and brings it back."""

from __future__ import annotations

from fleet.tasks.fields import Fields, OrdersError
from fleet.tasks.order import LIFT, Order, Visit
from fleet.tasks.place_names import first_to_last
from fleet.tasks.types.task_type import Setting
from maps.reading.shown import shown

STAND_S = 10.0
"""How long people pick from a pod if the order does not say [s]."""


class PodType:
    """Under one pod, with it to a place, or the nearest free of several, and back."""

    required = ("pod", "to")
    optional = ("stand_s",)

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        pods, places = setting.site.storage, setting.places
        if not pods:
            raise OrdersError(f"type is 'pod'; valid: another one, as no pods stand on site {setting.site.name}")
        number = {f"pod_{k}": k for k in range(1, len(pods) + 1)}.get(fields.text("pod"))
        if number is None:
            raise OrdersError(f"pod is {shown(fields.text('pod'))}; valid: {first_to_last('pod', len(pods))}")
        numbers = {"parking": len(setting.site.parking), "charger": setting.n_chargers}
        valid = [name for kind, n in numbers.items() for name in places.numbered(kind, n)]
        words = ", ".join(first_to_last(kind, n) for kind, n in numbers.items() if n)
        to = places.among(fields, "to", valid, f"{words} (no arm picks from a pod)")
        home = places.numbered("storage", len(pods))[number - 1]
        visit = Visit.of(
            shared,
            kind="pod",
            needs=(*shared.needs, LIFT),
            errands=(places.before(home), (home,), to, (home,)),
            stand_s=places.stand_s(fields, to, STAND_S),
            pod=f"pod_{number}",
        )
        return (visit,)
