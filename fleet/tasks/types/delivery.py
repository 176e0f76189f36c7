"""Delivery: one parcel from a pick station to a drop station."""

from __future__ import annotations

from fleet.tasks.fields import Fields, OrdersError, number
from fleet.tasks.order import MAX_EDGE_M, MAX_MASS_KG, MIN_EDGE_M, MIN_MASS_KG, Delivery, Order
from fleet.tasks.types.task_type import Setting
from maps.reading.shown import shown


class DeliveryType:
    """One parcel from a pick station, or one of several, to a drop station."""

    required = ("pick", "drop", "mass_kg", "size_m")
    optional = ("picks",)

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        picks, drops = setting.site.station_names("pick"), setting.site.station_names("drop")
        pick = fields.choice("pick", picks)
        sources = tuple(dict.fromkeys((pick, *fields.words("picks"))))
        for source in sources:
            if source not in picks:
                raise OrdersError(f"picks is {shown(source)}; valid: {', '.join(picks)}")
        return (
            Delivery.of(
                shared,
                pick=pick,
                drop=fields.choice("drop", drops),
                mass_kg=fields.number("mass_kg", MIN_MASS_KG, MAX_MASS_KG),
                size_m=edges(fields.text("size_m")),
                picks=sources,
            ),
        )


def edges(text: str) -> tuple[float, float, float]:
    """The edges of a box [m], from one edge of a cube or three edges.

    Raises:
        OrdersError: Neither, or an edge out of range.
    """
    found = [number(part, "size_m", MIN_EDGE_M, MAX_EDGE_M) for part in text.lower().split("x")]
    if len(found) == 1:
        found *= 3
    if len(found) != 3:
        raise OrdersError(f"size_m is {shown(text)}; valid: one edge (0.06) or three (0.06x0.05x0.08)")
    return found[0], found[1], found[2]
