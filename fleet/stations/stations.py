"""Stations: all stations of a site, in the order of their arms and by name, and how long their arms take."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from fleet.robots.arms.spec import UsualService
from fleet.stations.service_time import Direction, ServiceTime, ServiceTimes
from fleet.stations.station import Station


class Stations:
    """The stations of a run.

    Args:
        stations: In the order of their arms.
        usual: How long transfers usually take with the arm of each.
    """

    def __init__(self, stations: Sequence[Station], usual: Sequence[UsualService]) -> None:
        self._stations = tuple(stations)
        self._by_name = {station.name: station for station in stations}
        self.times = ServiceTimes(usual)
        """How long each arm takes for a transfer."""
        self._time_of = [self.times.of(station.arm, station.direction) for station in stations]
        self.dock_states: npt.NDArray[np.int32] = np.array([s.dock_state for s in stations], dtype=np.int32)
        """Lane-graph state of a car at each dock, shape (n_stations,)."""
        self._closed: dict[str, dict[str, bool]] = {}  # by name and reason: whether for good
        self.n_closings = 0
        """Grows whenever a station is closed or opened."""

    def __iter__(self) -> Iterator[Station]:
        return iter(self._stations)

    def __len__(self) -> int:
        return len(self._stations)

    def __getitem__(self, arm: int) -> Station:
        """The station of an arm."""
        return self._stations[arm]

    # --- which are open

    def close(self, arm: int, why: str, *, for_good: bool) -> None:
        """Close a station for a reason, for now or for good."""
        self._closed.setdefault(self._stations[arm].name, {})[why] = for_good
        self.n_closings += 1

    def open(self, arm: int, why: str) -> None:
        """Let a reason to be closed go; a station without any is open."""
        name = self._stations[arm].name
        reasons = self._closed.get(name, {})
        reasons.pop(why, None)
        if not reasons:
            self._closed.pop(name, None)
        self.n_closings += 1

    def is_open(self, name: str) -> bool:
        """Whether cars may come to a station."""
        return name not in self._closed

    def is_lost(self, station: Station) -> bool:
        """Whether a station is closed for good."""
        return any(self._closed.get(station.name, {}).values())

    @property
    def any_lost(self) -> bool:
        """Whether any station is closed for good."""
        return any(any(reasons.values()) for reasons in self._closed.values())

    def named(self, name: str) -> Station:
        """The station of a name that exists."""
        return self._by_name[name]

    def arms_of(self, names: Sequence[Sequence[str]]) -> npt.NDArray[np.int64]:
        """Arms of the stations of some names, in the same shape."""
        return np.array([[self._by_name[name].arm for name in row] for row in names], dtype=np.int64)

    def time(self, station: Station) -> ServiceTime:
        """How long a station's arm takes for what the station does."""
        return self._time_of[station.arm]

    def mean_s(self) -> npt.NDArray[np.float64]:
        """Mean time of a transfer at each station, shape (n_stations,) [s]."""
        return np.array([time.mean_s for time in self._time_of])

    def recent_s(self, arms: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """How long some arms are likely to take now at their stations, shape (k,) [s]."""
        return np.array([self._time_of[arm].recent_s for arm in arms.tolist()])

    def least_cycle_s(self, collect_after_s: float) -> npt.NDArray[np.float64]:
        """Shortest time between transfers at each station, shape (n_stations,) [s].

        Args:
            collect_after_s: How long a delivered parcel keeps its slot of a drop station [s].
        """
        drops = [station.direction is Direction.FROM_CAR for station in self._stations]
        n_slots = np.array([len(station.contents) for station in self._stations])
        return np.where(drops, collect_after_s / n_slots, 0.0)

    def loading(self) -> list[Station]:
        """Pick stations, in the order of their arms."""
        return [station for station in self._stations if station.direction is Direction.TO_CAR]
