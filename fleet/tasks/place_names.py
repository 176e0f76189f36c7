"""PlaceNames: what the places of a site are called in orders."""

from __future__ import annotations

import re
from collections.abc import Collection

from fleet.tasks.fields import Fields, OrdersError
from maps.reading.shown import shown
from maps.site import Site

LANE_STAND_S = 10.0
"""Longest stand in a lane, where others have to wait behind [s]."""
BAY_STAND_S = 3600.0
"""Longest stand at a dock, parking place or charger [s]."""


class PlaceNames:
    """Names of docks (those of their stations), parking places, chargers and cells of lanes (``row,col``).

    Args:
        site: The site.
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._bays = site.bays()
        self._name_of = {cell: name for name, cell in self._bays.items()}
        self._storage = frozenset(site.storage)
        self._lane_cells = frozenset(site.lanes.ravel().tolist()) - self._storage

    def is_bay(self, name: str) -> bool:
        """Whether a place is one to stand at: a dock, a parking place, a charger or a storage place."""
        return name in self._bays

    def cell(self, name: str) -> int:
        """Cell of a place that `places` has returned."""
        if name in self._bays:
            return self._bays[name]
        row, col = name.split(",")
        return int(row) * self._site.grid.cols + int(col)

    def numbered(self, kind: str, n: int) -> tuple[str, ...]:
        """Names of the first places of a kind, `parking`, `charger` or `storage`."""
        return tuple(f"{kind}_{k}" for k in range(1, n + 1))

    def before(self, name: str) -> tuple[str, ...]:
        """Places from which lanes lead into a bay: one, unless the lanes were given."""
        starts = self._site.lanes[self._site.lanes[:, 1] == self._bays[name], 0].tolist()
        return tuple(self._name(cell) for cell in starts)

    def _name(self, cell: int) -> str:
        row, col = divmod(cell, self._site.grid.cols)
        return self._name_of.get(cell, f"{row},{col}")

    def places(self, fields: Fields, name: str) -> tuple[str, ...]:
        """The places in a field, each by the one name it has here; none if the field is empty.

        Raises:
            OrdersError: One of them is no place that a car can be sent to, such as one where a pod stands.
        """
        valid = f"{self._valid()}, or row,col of a cell with a lane"
        return tuple(self._place(word, name, valid) for word in fields.words(name))

    def among(self, fields: Fields, name: str, valid: Collection[str], words: str) -> tuple[str, ...]:
        """The same where only some places will do, and in words which.

        Raises:
            OrdersError: One of the places is none of those.
        """
        places = []
        for word in fields.words(name):
            places.append(self._place(word, name, words))
            if places[-1] not in valid:
                raise OrdersError(f"{name} is {shown(word)}; valid: {words}")
        return tuple(places)

    def one(self, fields: Fields, name: str) -> str:
        """The place in a field that must hold one.

        Raises:
            OrdersError: It holds none or several, or no place that a car can go to.
        """
        places = self.places(fields, name)
        if len(places) != 1:
            raise OrdersError(f"{name} is {shown(fields.text(name))}; valid: one place")
        return places[0]

    def stand_s(self, fields: Fields, errands: tuple[str, ...], default: float) -> float:
        """How long a car is to stand at each of some places [s].

        Raises:
            OrdersError: No number, or too long for one of the places.
        """
        stand_s = fields.number("stand_s", 0.0, BAY_STAND_S, default)
        lane = next((errand for errand in errands if not self.is_bay(errand)), None)
        if lane is not None and stand_s > LANE_STAND_S:
            valid = f"at most {LANE_STAND_S:g}, because {lane} is in a lane"
            raise OrdersError(f"stand_s is {shown(fields.text('stand_s'))}; valid: {valid}")
        return stand_s

    def _place(self, word: str, field: str, valid: str) -> str:
        if word in self._bays and self._bays[word] not in self._storage:
            return word
        grid, at = self._site.grid, re.fullmatch(r"(\d{1,6})\s*,\s*(\d{1,6})", word)
        if at is not None and int(at[1]) < grid.rows and int(at[2]) < grid.cols:
            row, col = int(at[1]), int(at[2])
            cell = row * grid.cols + col
            if cell in self._lane_cells:
                return self._name(cell)
        raise OrdersError(f"{field} is {shown(word)}; valid: {valid}")

    def _valid(self) -> str:
        stations = [station.name for station in self._site.stations]
        ranges = []
        site = self._site
        for kind, cells in (("parking", site.parking), ("charger", site.chargers)):
            if cells:
                ranges.append(first_to_last(kind, len(cells)))
        return ", ".join([*stations, *ranges])


def first_to_last(kind: str, n: int) -> str:
    """Numbered things of a kind in words."""
    return f"{kind}_1" if n == 1 else f"{kind}_1 to {kind}_{n}"
