"""Words of the coupled problem: vehicles whose jobs stop at stations that serve one vehicle at a time."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from planners.allocation.arrays import FloatArray, Int64Array, IntArray
from planners.errors import PlanningError

NO_STATION = -1
"""Station of an errand at which none serves."""


class ShopError(PlanningError):
    """A coupled problem is malformed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shop:
    """Jobs of one or more errands, done whole by one vehicle, one after the other; all times on one clock [s].

    A vehicle drives to the errands of a job in order. At an errand with a station it waits until the station is free,
    is served, and drives on; at an errand without one it stands for the service time. Jobs are the tasks of the
    allocation problem and vehicles its vehicles, by index; whether a vehicle may do a job is said there, by an
    infinite cost.

    A vehicle that may carry several jobs does those together that come one after the other in its list and begin at the
    same place, as many as it may: the first errand of each, then the second of each in the same order. That is so for
    jobs of two errands, both at stations.

    What is to be small: `makespan_weight` x the end of the last job, plus `weight` x the end of each job, plus
    `late_weight` x the time it ends after its due date, plus `late_cost` if it ends after its due date at all.

    Raises:
        ShopError: Lengths disagree, an index names nothing, or a time or weight means nothing.
    """

    travel_s: FloatArray
    """Travel time from place to place, shape (n_places, n_places); inf = no way."""
    start: IntArray
    """Place at which each vehicle is free, shape (n_vehicles,)."""
    ready_s: FloatArray
    """When it is, shape (n_vehicles,)."""
    first_errand: IntArray
    """Errands of job j are first_errand[j] .. first_errand[j + 1] - 1, shape (n_jobs + 1,)."""
    place: IntArray
    """Place of each errand, shape (n_errands,)."""
    station: IntArray
    """Station that serves at each errand, or `NO_STATION`, shape (n_errands,)."""
    service_s: FloatArray
    """Time at each errand, shape (n_errands,)."""
    free_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    """When each station has served those that are there or on their way already, shape (n_stations,)."""
    n_buffer_places: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """Vehicles that stand at each station at most, the one it serves included, >= 1, shape (n_stations,)."""
    n_carried: IntArray | None = None
    """Jobs that each vehicle may carry at once, >= 1, shape (n_vehicles,); None = 1 each."""
    release_s: FloatArray | None = None
    """Its first errand is not served sooner, shape (n_jobs,); None = at any time."""
    due_s: FloatArray | None = None
    """When each job should have ended, inf = at any time, shape (n_jobs,); None = all at any time."""
    weight: FloatArray | None = None
    """Weight of the end of each job, shape (n_jobs,), >= 0; None = 1 each."""
    late_weight: FloatArray | None = None
    """Weight of the time after its due date, shape (n_jobs,), >= 0; None = 1 each."""
    late_cost: FloatArray | None = None
    """What it costs once that a job ends after its due date, however little, shape (n_jobs,), >= 0; None = nothing."""
    first_order: IntArray | None = None
    """Jobs in an order that is likely to be good, such as that of the last plan, each at most once; None = unknown."""
    first_vehicle: IntArray | None = None
    """Vehicle of each job of that order, shape (n_jobs,), any number for others; None = unknown."""
    makespan_weight: float = 0.0
    """Weight of the end of the last job, >= 0."""

    def __post_init__(self) -> None:
        if self.travel_s.ndim != 2 or self.travel_s.shape[0] != self.travel_s.shape[1]:
            raise ShopError(f"shop: travel_s has shape {self.travel_s.shape}; valid: (n_places, n_places)")
        if self.first_errand.ndim != 1 or not len(self.first_errand):
            raise ShopError(f"shop: first_errand has shape {self.first_errand.shape}; valid: (n_jobs + 1,)")
        self._check_lengths()
        self._check_indices()
        self._check_numbers()

    @property
    def n_jobs(self) -> int:
        """Number of jobs."""
        return len(self.first_errand) - 1

    @property
    def n_vehicles(self) -> int:
        """Number of vehicles."""
        return len(self.start)

    @property
    def n_stations(self) -> int:
        """Number of stations."""
        return len(self.free_s)

    @functools.cached_property
    def loaded_at(self) -> IntArray:
        """Place at which each job may be loaded with others, -1 = it is done by itself, shape (n_jobs,)."""
        first, last = self.first_errand[:-1], self.first_errand[1:] - 1
        served = (self.station[first] != NO_STATION) & (self.station[last] != NO_STATION)
        return np.where((last == first + 1) & served, self.place[first], -1).astype(np.int32)

    def n_together(self, vehicle: int, jobs: Sequence[int]) -> int:
        """How many of the first of some jobs a vehicle does together, if it does these jobs in order."""
        most = 1 if self.n_carried is None else int(self.n_carried[vehicle])
        n = min(1, len(jobs))
        while n < min(len(jobs), most) and self.loaded_at[jobs[n]] == self.loaded_at[jobs[0]] >= 0:
            n += 1
        return n

    def tours(self, order: Int64Array, vehicle: Int64Array) -> Iterator[tuple[int, list[int]]]:
        """Vehicles and the jobs that each does together, one or more, as they come in a plan.

        Args:
            order: Jobs that are planned, in order, shape (n,).
            vehicle: Vehicle of each job, shape (n_jobs,).
        """
        left: list[list[int]] = [[] for _ in range(self.n_vehicles)]
        for job in order.tolist():
            left[vehicle[job]].append(job)
        for job in order.tolist():
            v = int(vehicle[job])
            if left[v] and left[v][0] == job:
                n = self.n_together(v, left[v])
                yield v, left[v][:n]
                del left[v][:n]

    def _check_lengths(self) -> None:
        jobs, errands = self.n_jobs, len(self.place)
        for name, n in (
            *(("start", self.n_vehicles), ("ready_s", self.n_vehicles)),
            *(("place", errands), ("station", errands), ("service_s", errands)),
            *(("free_s", self.n_stations), ("n_buffer_places", self.n_stations), ("n_carried", self.n_vehicles)),
            *(("release_s", jobs), ("due_s", jobs), ("weight", jobs), ("late_weight", jobs), ("late_cost", jobs)),
            ("first_vehicle", jobs),
        ):
            value = getattr(self, name)
            if value is not None and value.shape != (n,):
                raise ShopError(f"shop: {name} has shape {value.shape}; valid: ({n},)")
        first = self.first_errand
        if first[0] != 0 or first[-1] != errands or (np.diff(first) < 1).any():
            raise ShopError(
                f"shop: first_errand = {first.tolist()[:8]}; valid: 0 < ... < {errands}, an errand or more per job"
            )

    def _check_indices(self) -> None:
        for name, least, end in (
            ("start", 0, len(self.travel_s)),
            ("place", 0, len(self.travel_s)),
            ("station", NO_STATION, self.n_stations),
            ("n_buffer_places", 1, None),
            ("n_carried", 1, None),
            ("first_order", 0, self.n_jobs),
        ):
            value = getattr(self, name)
            if value is None:
                continue
            wrong = np.flatnonzero((value < least) | (end is not None and value >= end))
            if wrong.size:
                valid = f"at least {least}" if end is None else f"{least}..{end - 1}"
                raise ShopError(f"shop: {name}[{wrong[0]}] = {value[wrong[0]]}; valid: {valid}")

        self._check_first_plan()

    def _check_first_plan(self) -> None:
        if self.first_order is None or self.first_vehicle is None:
            if self.first_order is not self.first_vehicle:
                raise ShopError("shop: first_order and first_vehicle; valid: both, or none")
            return
        if len(np.unique(self.first_order)) < len(self.first_order):
            raise ShopError("shop: first_order has a job twice; valid: each job once")
        vehicles = self.first_vehicle[self.first_order]
        wrong = np.flatnonzero((vehicles < 0) | (vehicles >= self.n_vehicles))
        if wrong.size:
            job = self.first_order[wrong[0]]
            raise ShopError(f"shop: first_vehicle[{job}] = {self.first_vehicle[job]}; valid: 0..{self.n_vehicles - 1}")

    def _check_numbers(self) -> None:
        for entry in fields(self):
            name, value = entry.name, getattr(self, entry.name)
            if value is None or not isinstance(value, np.ndarray) or value.dtype.kind != "f":
                continue
            may_be_inf, may_be_negative = (
                name in ("travel_s", "due_s"),
                name in ("ready_s", "free_s", "release_s", "due_s"),
            )
            bad = np.isnan(value) | np.isneginf(value)
            if not may_be_inf:
                bad |= np.isinf(value)
            if not may_be_negative:
                bad |= value < 0.0
            if bad.any():
                where = tuple(int(i) for i in np.argwhere(bad)[0])
                valid = f"a {'number' if may_be_negative else 'number >= 0'}{' or inf' if may_be_inf else ''}"
                raise ShopError(f"shop: {name}{list(where)} = {value[where]}; valid: {valid}")
        if not 0.0 <= self.makespan_weight < np.inf:
            raise ShopError(f"shop: makespan_weight = {self.makespan_weight}; valid: a number >= 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class Timetable:
    """When what happens if the jobs of a shop are done as planned."""

    vehicle: IntArray
    """Vehicle of each job, -1 = nobody, shape (n_jobs,)."""
    arrive_s: FloatArray
    """When it is in front of each errand, shape (n_errands,); nan where nobody goes, as below."""
    enter_s: FloatArray
    """When the station has room for it, shape (n_errands,)."""
    start_s: FloatArray
    """When service starts, shape (n_errands,)."""
    end_s: FloatArray
    """When service ends and the vehicle drives on, shape (n_errands,)."""
    objective: float
    """What the shop wants small, summed over the jobs that are done."""
