"""Turns: arms booked in time: when each car that is bound for a station is served, and which times are left."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.missions.phases import AT_CHARGER, PARKED, PHASES, TO_STATION
from fleet.missions.state import Missions
from fleet.missions.ways import MOVE_S, Ways
from fleet.tasks.board import NUMBER_OF_STATE, TaskState

CHANGE_S = 3.0
"""Time in which one car leaves a dock and the next one takes its place [s]; seen on shipped sites: 2.8 to 3.5 s."""

_UNDER_WAY = np.array([phase in TO_STATION for phase in PHASES])
_COMES = np.array([phase in TO_STATION | PARKED | AT_CHARGER for phase in PHASES])
"""Phases of a car that is bound for a station and not there, or not any more."""
_ASSIGNED, _LOADING = NUMBER_OF_STATE[TaskState.ASSIGNED], NUMBER_OF_STATE[TaskState.LOADING]


class ArmPace(NamedTuple):
    """How fast arms are, shape (n_stations,) each."""

    cycle_s: FloatArray
    """From one turn to the next while cars wait [s]."""
    free_s: FloatArray
    """Time until the arm can begin a turn [s]."""


class TakenTurns(NamedTuple):
    """When arms are taken, on a clock that starts now."""

    first: IntArray
    """Where the turns of each station begin, and the end, shape (n_stations + 1,)."""
    begin_s: FloatArray
    """When each turn begins, ascending at each station, shape (n,) [s]."""
    pace: ArmPace
    """How long the turns are."""


class StationArrivals(NamedTuple):
    """Cars that come to stations."""

    car: IntArray
    """The cars, shape (n,)."""
    station: IntArray
    """Where each comes, ascending, shape (n,)."""
    comes_s: FloatArray
    """When it can be there, without traffic, shape (n,) [s]."""
    waits: BoolArray
    """True = it is not under way yet, and takes a turn that others leave, shape (n,)."""


class GivenTurns(NamedTuple):
    """Who has which turn."""

    turn_s: FloatArray
    """When the turn of each arrival begins, shape (n,) [s]."""
    turns: TakenTurns
    """The same, station by station."""


class Booked(NamedTuple):
    """All turns that are taken, and how well cars will be in time for them."""

    turns: TakenTurns
    early_s: FloatArray
    """How long before its turn each car comes to the station it is bound for, shape (n_cars,) [s]."""


class TurnBook:
    """Books arms in time.

    Cars under way are served as they come. One that is not under way yet gets the first time that is left for a whole
    turn after it can be there, those that were bound for the station first before others.

    Args:
        missions: What cars and stations are about.
        ways: How far cars are from stations.
        least_cycle_s: Shortest time between turns whatever the arm does, shape (n_stations,) [s].
    """

    def __init__(self, missions: Missions, ways: Ways, least_cycle_s: FloatArray) -> None:
        self._missions = missions
        self._ways = ways
        self._least_cycle_s = least_cycle_s
        self._arms = np.arange(len(least_cycle_s))

    def pace(self, now_s: float, arms: IntArray | None = None) -> ArmPace:
        """How fast the arms are at present, or some of them."""
        missions = self._missions
        times = missions.stations.times
        if arms is None:
            arms, left_s = self._arms, times.all_left_s(now_s)
        else:
            left_s = times.each_left_s(arms, now_s)
        cycle_s = np.maximum(missions.stations.recent_s(arms) + CHANGE_S, self._least_cycle_s[arms])
        return ArmPace(cycle_s, np.where(missions.served[arms] >= 0, left_s + CHANGE_S, 0.0))

    def line_of(self, arm: int, now_s: float) -> tuple[StationArrivals, GivenTurns]:
        """Those that are bound for one station, and their turns."""
        cars = np.array(self._missions.bookings.bound(arm), dtype=np.int64)
        arrivals = self._arrivals(cars, np.full(len(cars), arm))
        pace = self.pace(now_s, np.array([arm]))
        return arrivals, line_up(arrivals._replace(station=np.zeros_like(arrivals.station)), pace)

    def bound(self) -> StationArrivals:
        """All cars that are bound for stations and have not come to their turn yet."""
        missions, stations = self._missions, self._missions.stations
        cars, first = missions.bookings.in_line(len(stations))
        station = np.repeat(np.arange(len(stations)), np.diff(first))
        return self._arrivals(cars, station)

    def all(self, now_s: float) -> Booked:
        """All turns that are taken, those at the drop stations of parcels that are still to be picked among them."""
        missions, stations, pace = self._missions, self._missions.stations, self.pace(now_s)
        bound = self.bound()
        line = line_up(bound, pace)
        early_s = np.zeros(missions.n_cars)
        early_s[bound.car] = line.turn_s - bound.comes_s

        leaves_s = np.full(missions.n_cars, np.inf)
        picks = missions.task_state[bound.car] == _ASSIGNED
        leaves_s[bound.car[picks]] = line.turn_s[picks] + pace.cycle_s[bound.station[picks]]
        loading = (missions.task_state == _LOADING).nonzero()[0]
        leaves_s[loading] = pace.free_s[missions.pick_of[loading]]
        cars = (np.isfinite(leaves_s) & (missions.drop_of >= 0)).nonzero()[0]
        pick, drop = missions.pick_of[cars], missions.drop_of[cars]
        moves = self._ways.moves_each(stations.dock_states[pick], stations.dock_states[drop])

        station = np.concatenate((bound.station, drop))
        order = np.argsort(station, kind="stable")
        everybody = StationArrivals(
            np.concatenate((bound.car, cars))[order],
            station[order],
            np.concatenate((bound.comes_s, leaves_s[cars] + MOVE_S * moves.astype(np.float64)))[order],
            np.concatenate((bound.waits, np.zeros(len(cars), dtype=np.bool_)))[order],
        )
        return Booked(line_up(everybody, pace).turns, early_s)

    def _arrivals(self, cars: IntArray, station: IntArray) -> StationArrivals:
        """Of cars that are bound for stations, those that no arm is at work on there.

        An arm that is slow on its way home counts its last car as served while that one is bound for it anew.
        """
        comes = (self._missions.served[station] != cars) | _COMES[self._missions.phase_index[cars]]
        cars, station = cars[comes], station[comes]
        moves = self._ways.moves_each(self._ways.ahead[cars], self._missions.stations.dock_states[station])
        return StationArrivals(
            cars, station, MOVE_S * moves.astype(np.float64), ~_UNDER_WAY[self._missions.phase_index[cars]]
        )


def line_up(arrivals: StationArrivals, pace: ArmPace) -> GivenTurns:
    """Give each arrival its turn."""
    turn_s, begin_s = np.empty(len(arrivals.car)), np.empty(len(arrivals.car))
    first = np.searchsorted(arrivals.station, np.arange(len(pace.cycle_s) + 1))
    _line_up(first, arrivals, pace, turn_s, begin_s)
    return GivenTurns(turn_s, TakenTurns(first, begin_s, pace))


def next_turns(turns: TakenTurns, station: int, n: int) -> FloatArray:
    """The next so many turns that a station has left, shape (n,) [s]."""
    begin_s = np.empty(n)
    _next_turns(turns, station, begin_s)
    return begin_s


def first_turn(turns: TakenTurns, station: int, comes_s: float) -> float:
    """When a car that comes to a station at some time could be served [s]."""
    return float(_first_turn(turns, station, comes_s))


class FreeTimes(NamedTuple):
    """When turns can begin: the stretches that are left between those that are taken."""

    first: IntArray
    """Where the stretches of each station begin, and the end, shape (n_stations + 1,)."""
    from_s: FloatArray
    """Begin of each stretch, ascending at each station, shape (n,) [s]."""
    until_s: FloatArray
    """When the turn after it begins, by which a turn in the stretch has to be over, shape (n,) [s]; inf = none does."""
    pace: ArmPace
    """How long turns are."""


def free_times(turns: TakenTurns) -> FreeTimes:
    """What some turns leave."""
    n_stations = len(turns.pace.cycle_s)
    first = np.zeros(n_stations + 1, dtype=np.int64)
    from_s, until_s = np.empty(len(turns.begin_s) + n_stations), np.empty(len(turns.begin_s) + n_stations)
    n = _free_times(turns, first, from_s, until_s)
    return FreeTimes(first, from_s[:n], until_s[:n], turns.pace)


@njit(cache=True, nogil=True)
def free_turn(free: FreeTimes, station: int, comes_s: float) -> float:  # pragma: no cover - compiled
    """When a car that comes to a station at some time could be served [s], as `first_turn`, for many cars at once."""
    comes_s = max(comes_s, free.pace.free_s[station])
    cycle_s = free.pace.cycle_s[station]
    # The first gap that ends late enough for a whole turn from now on; it may begin too late for one.
    k, end = free.first[station], free.first[station + 1] - 1
    while k < end:
        middle = (k + end) // 2
        if free.until_s[middle] < comes_s + cycle_s:
            k = middle + 1
        else:
            end = middle
    while free.until_s[k] < max(comes_s, free.from_s[k]) + cycle_s:
        k += 1
    return max(comes_s, free.from_s[k])


@njit(cache=True, nogil=True)
def _free_from(begin_s: FloatArray, comes_s: float, cycle_s: float) -> float:  # pragma: no cover - compiled
    """The first time from an arrival on at which no turn of some is under way or begins before a whole one is over."""
    k = np.searchsorted(begin_s, comes_s - cycle_s, side="right")
    free_s = comes_s
    while k < len(begin_s) and begin_s[k] < free_s + cycle_s:
        free_s = max(free_s, begin_s[k] + cycle_s)
        k += 1
    return free_s


@njit(cache=True, nogil=True)
def _first_turn(turns: TakenTurns, station: int, comes_s: float) -> float:  # pragma: no cover - compiled
    taken = turns.begin_s[turns.first[station] : turns.first[station + 1]]
    return _free_from(taken, max(comes_s, turns.pace.free_s[station]), turns.pace.cycle_s[station])


@njit(cache=True, nogil=True)
def _next_turns(turns: TakenTurns, station: int, begin_s: FloatArray) -> None:  # pragma: no cover - compiled
    earliest_s = 0.0
    for k in range(len(begin_s)):
        begin_s[k] = _first_turn(turns, station, earliest_s)
        earliest_s = begin_s[k] + turns.pace.cycle_s[station]


@njit(cache=True, nogil=True)
def _line_up(
    first: IntArray, arrivals: StationArrivals, pace: ArmPace, turn_s: FloatArray, begin_s: FloatArray
) -> None:  # pragma: no cover - compiled
    for station in range(len(first) - 1):
        begin, end = first[station], first[station + 1]
        cycle_s = pace.cycle_s[station]
        key = np.empty(end - begin)
        for k in range(begin, end):
            key[k - begin] = np.inf if arrivals.waits[k] else arrivals.comes_s[k]
        n = begin
        for at in np.argsort(key, kind="mergesort"):
            k = begin + at
            comes_s = max(arrivals.comes_s[k], pace.free_s[station])
            if arrivals.waits[k]:
                turn_s[k] = _free_from(begin_s[begin:n], comes_s, cycle_s)
            elif n == begin:
                turn_s[k] = comes_s
            else:
                turn_s[k] = max(comes_s, begin_s[n - 1] + cycle_s)
            j = n
            while j > begin and begin_s[j - 1] > turn_s[k]:
                begin_s[j] = begin_s[j - 1]
                j -= 1
            begin_s[j] = turn_s[k]
            n += 1


@njit(cache=True, nogil=True)
def _free_times(
    turns: TakenTurns, first: IntArray, from_s: FloatArray, until_s: FloatArray
) -> int:  # pragma: no cover - compiled
    """Fill in the stretches of all stations; returns how many there are."""
    n = 0
    for station in range(len(first) - 1):
        cycle_s = turns.pace.cycle_s[station]
        free_s = -np.inf
        for k in range(turns.first[station], turns.first[station + 1]):
            if free_s + cycle_s <= turns.begin_s[k]:
                from_s[n], until_s[n] = free_s, turns.begin_s[k]
                n += 1
            free_s = max(free_s, turns.begin_s[k] + cycle_s)
        from_s[n], until_s[n] = free_s, np.inf
        n += 1
        first[station + 1] = n
    return n
