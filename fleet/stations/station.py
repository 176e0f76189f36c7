"""Station: a dock, an arm and a rack of slots, with the books of what lies where."""

from __future__ import annotations

from collections import deque

from fleet.stations.service_time import Direction
from maps.stations import StationPlace


class Station:
    """Slots and collection of one station.

    Args:
        arm: Index of its arm in the world.
        place: Where it stands.
        dock_state: Lane-graph state of a car at its dock.
    """

    def __init__(self, arm: int, place: StationPlace, dock_state: int) -> None:
        self.arm = arm
        self.place = place
        self.dock_state = dock_state
        self.name = place.name
        """Name in the site file."""
        self.direction = Direction.TO_CAR if place.kind == "pick" else Direction.FROM_CAR
        """Which way its parcels go: onto cars at a pick station, off them at a drop station."""
        self.contents: list[int | None] = [None] * len(place.slots)
        """Task whose parcel lies on, or is promised to, each slot."""
        self.n_free = len(self.contents)
        """Slots that are neither taken nor promised."""
        self._leaving: deque[tuple[float, int]] = deque()

    def take_slot(self, task: int) -> int | None:
        """Promise the first free slot to a task; None when all are taken."""
        for slot, content in enumerate(self.contents):
            if content is None:
                self.contents[slot] = task
                self.n_free -= 1
                return slot
        return None

    def free_slot(self, slot: int) -> None:
        """Give a slot back; giving it back twice is harmless."""
        self.n_free += self.contents[slot] is not None
        self.contents[slot] = None

    def collect_at(self, time_s: float, slot: int) -> None:
        """Note that the parcel on a slot leaves at a given time; times must not decrease."""
        self._leaving.append((time_s, slot))

    @property
    def next_collect_s(self) -> float | None:
        """When the next parcel leaves [s]; None if none is about to."""
        return self._leaving[0][0] if self._leaving else None

    def collect_due(self, now_s: float) -> list[int]:
        """Slots whose parcels leave now."""
        slots = []
        while self._leaving and self._leaving[0][0] <= now_s:
            slots.append(self._leaving.popleft()[1])
        return slots
