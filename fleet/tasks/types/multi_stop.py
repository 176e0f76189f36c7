"""Multi-stop order: several deliveries by one car, one after the other, with none of somebody else's in between."""

from __future__ import annotations

from fleet.tasks.fields import Fields, OrdersError, number
from fleet.tasks.order import MAX_MASS_KG, MIN_MASS_KG, Delivery, Order
from fleet.tasks.types.delivery import edges
from fleet.tasks.types.task_type import Setting
from maps.reading.shown import shown

MAX_LEGS = 50


class MultiStopType:
    """Legs, each a delivery that waits for the one before and for its car."""

    required = ("stops", "mass_kg", "size_m")
    optional = ()

    def orders(self, shared: Order, fields: Fields, setting: Setting) -> tuple[Order, ...]:
        """See `TaskType`."""
        stops = fields.words("stops")
        if not 2 <= len(stops) <= MAX_LEGS:
            raise OrdersError(
                f"stops is {shown(fields.text('stops'))}; valid: 2 to {MAX_LEGS} legs, as in {_example(setting)}"
            )
        masses = [number(text, "mass_kg", MIN_MASS_KG, MAX_MASS_KG) for text in _each(fields, "mass_kg", len(stops))]
        sizes = [edges(text) for text in _each(fields, "size_m", len(stops))]
        legs: list[Order] = []
        for k, (stop, mass_kg, size_m) in enumerate(zip(stops, masses, sizes, strict=True)):
            pick, drop = _ends(stop, setting)
            before = (legs[-1].name,) if legs else ()
            legs.append(
                Delivery.of(
                    shared,
                    name=f"{shared.name}_{k + 1}",
                    after=(*shared.after, *before),
                    same_car_as="".join(before),
                    payload_kg=max(masses),
                    pick=pick,
                    drop=drop,
                    mass_kg=mass_kg,
                    size_m=size_m,
                )
            )
        return tuple(legs)


def _ends(stop: str, setting: Setting) -> tuple[str, str]:
    picks, drops = setting.site.station_names("pick"), setting.site.station_names("drop")
    pick, arrow, drop = (part.strip() for part in stop.partition(">"))
    if not arrow or pick not in picks or drop not in drops:
        valid = f"PICK>DROP with {', '.join(picks)} and {', '.join(drops)}"
        raise OrdersError(f"stops is {shown(stop)}; valid: {valid}")
    return pick, drop


def _each(fields: Fields, name: str, n: int) -> tuple[str, ...]:
    """One word for each leg; one alone is for all."""
    words = fields.words(name)
    if len(words) not in (1, n):
        raise OrdersError(
            f"{name} is {shown(fields.text(name))}; valid: one for all legs, or {n} separated by semicolons"
        )
    return words * n if len(words) == 1 else words


def _example(setting: Setting) -> str:
    pick, drop = setting.site.station_names("pick")[0], setting.site.station_names("drop")[0]
    return f"{pick}>{drop};{pick}>{drop}"
