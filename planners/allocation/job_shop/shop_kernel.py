"""Kernels of the coupled problem: the timetable of a plan, plans made job by job, and plans made better.

A plan is an order of jobs and a vehicle for each. Jobs are put into the timetable in that order, what a vehicle does
together with the first of it: the vehicle drives to its next errand, and its station serves it in the first gap that is
long enough. So every plan is feasible, and every timetable in which nobody could start sooner on his own has a plan if
each job has one station and each vehicle carries one. Source: the serial schedule generation scheme, Kolisch, "Serial
and parallel resource-constrained project scheduling methods revisited", European Journal of Operational Research 90,
1996.

Without `_nrt=False` numba counts the references of every array of a bundle at every use, which takes nine tenths of
the time of a timetable.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.allocation.arrays import FloatArray, Int, Int64Array, Number

_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False}

NEAR_POSITIONS = 8
"""How many positions a job is moved at most by a move to nearby."""
MOVE_SHARES = (0.5, 0.75, 0.9)
"""Shares, added up, of moves of one job, swaps of two positions, swaps of tails; the rest swap vehicles."""


class Arrays(NamedTuple):
    """A shop as the kernels read it, its errands without station put together; no time is negative."""

    travel_s: FloatArray
    start: Int64Array
    ready_s: FloatArray
    free_s: FloatArray
    first_place: Int64Array
    """Place of the first errand of each job."""
    last_place: Int64Array
    """Place of the last."""
    release_s: FloatArray
    first_service: Int64Array
    """Services of job j are first_service[j] .. first_service[j + 1] - 1."""
    lead_s: FloatArray
    """From the service before, or the arrival at the first errand, to the arrival at the station."""
    station: Int64Array
    service_s: FloatArray
    tail_s: FloatArray
    """From the end of the last service of a job to its end."""
    due_s: FloatArray
    weight: FloatArray
    late_weight: FloatArray
    late_cost: FloatArray
    makespan_weight: float
    class_of: Int64Array
    extra: FloatArray
    """What each pair adds to the objective, inf = not allowed, shape (n_vehicles, n_jobs)."""
    n_carried: Int64Array
    """Jobs that each vehicle may carry at once."""
    loaded_at: Int64Array
    """Place at which each job may be loaded with others, -1 = none."""


class PartialSchedule(NamedTuple):
    """The timetable of the jobs that are put in so far: memory of one evaluation."""

    at: Int64Array
    """Place of each vehicle."""
    ready_s: FloatArray
    """When it is there."""
    begin_s: FloatArray
    """Start of each service, by station, rising, shape (n_stations, n_services + 1); the first is what was before."""
    end_s: FloatArray
    """End of it."""
    n_services: Int64Array
    """Services booked, by station."""
    loads_at: Int64Array
    """Place at which each vehicle was loaded last, -1 = none, or it has brought all away."""
    loaded_s: FloatArray
    """When it was."""
    n_loads: Int64Array
    """Jobs that it was loaded with there; while a plan is evaluated, jobs ahead in its list that are put in already."""
    together: Int64Array
    """Jobs that are done together, memory as long as the most that are carried."""


class JobPlan(NamedTuple):
    """Which jobs are done in which order, and by whom."""

    order: Int64Array
    """Jobs that are planned, in order, shape (n,)."""
    vehicle: Int64Array
    """Vehicle of each job, shape (n_jobs,)."""


class Cooling(NamedTuple):
    """How the temperature falls."""

    iterations: int
    """Changes to try."""
    hot: float
    """First temperature, in units of the objective, > 0."""
    cold: float
    """Last temperature, > 0."""


def empty_schedule(shop: Arrays) -> PartialSchedule:
    """Memory for one timetable."""
    shape = (len(shop.free_s), len(shop.station) + 1)
    return PartialSchedule(
        at=np.empty_like(shop.start),
        ready_s=np.empty_like(shop.ready_s),
        begin_s=np.empty(shape),
        end_s=np.empty(shape),
        n_services=np.empty(shape[0], dtype=np.int64),
        loads_at=np.empty_like(shop.start),
        loaded_s=np.empty_like(shop.ready_s),
        n_loads=np.empty_like(shop.start),
        together=np.empty(int(shop.n_carried.max(initial=1)), dtype=np.int64),
    )


@njit(**_OPTIONS)
def _clear(shop: Arrays, schedule: PartialSchedule) -> None:
    for v in range(len(shop.start)):
        schedule.at[v] = shop.start[v]
        schedule.ready_s[v] = shop.ready_s[v]
        schedule.loads_at[v] = -1
        schedule.n_loads[v] = 0
    for m in range(len(shop.free_s)):
        schedule.begin_s[m, 0] = -np.inf
        schedule.end_s[m, 0] = shop.free_s[m]
        schedule.n_services[m] = 1


@njit(**_OPTIONS)
def _served(shop: Arrays, schedule: PartialSchedule, service: Int, now_s: Number, book: bool) -> Number:
    """When a service ends that a vehicle has come to, inf = it never does; `book` puts it into the schedule."""
    if now_s == np.inf:
        return now_s
    m, service_s = shop.station[service], shop.service_s[service]
    n = schedule.n_services[m]
    i = n
    while i > 1 and schedule.end_s[m, i - 1] > now_s:
        i -= 1
    now_s = max(now_s, schedule.end_s[m, i - 1])
    while i < n and schedule.begin_s[m, i] < now_s + service_s:
        now_s = schedule.end_s[m, i]
        i += 1
    if book:
        for k in range(n, i, -1):
            schedule.begin_s[m, k] = schedule.begin_s[m, k - 1]
            schedule.end_s[m, k] = schedule.end_s[m, k - 1]
        schedule.begin_s[m, i] = now_s
        schedule.end_s[m, i] = now_s + service_s
        schedule.n_services[m] = n + 1
    end_s: Number = now_s + service_s
    return end_s


@njit(**_OPTIONS)
def _job_end(shop: Arrays, schedule: PartialSchedule, job: Int, vehicle: Int, book: bool) -> Number:
    """When a job would end at the end of a vehicle's list, inf = no way; `book` puts it into the schedule."""
    now_s: Number = schedule.ready_s[vehicle] + shop.travel_s[schedule.at[vehicle], shop.first_place[job]]
    now_s = max(now_s, shop.release_s[job])
    for service in range(shop.first_service[job], shop.first_service[job + 1]):
        now_s = _served(shop, schedule, service, now_s + shop.lead_s[service], book)
    end_s: Number = now_s + shop.tail_s[job]
    if book and end_s < np.inf:
        schedule.at[vehicle] = shop.last_place[job]
        schedule.ready_s[vehicle] = end_s
    return end_s


@njit(**_OPTIONS)
def _likely_end(shop: Arrays, schedule: PartialSchedule, job: Int, vehicle: Int, book: bool) -> Number:
    """As `_job_end`, but a vehicle that has room loads the job with what it was loaded with last, at the same place.

    What it has aboard then comes to its stations later than they are booked for, which `evaluate` finds out.
    """
    place, most = shop.loaded_at[job], shop.n_carried[vehicle]
    if most == 1 or place < 0:
        if book:
            schedule.loads_at[vehicle] = -1
        alone_s: Number = _job_end(shop, schedule, job, vehicle, book)
        return alone_s
    joins = schedule.loads_at[vehicle] == place and schedule.n_loads[vehicle] < most
    begin_s: Number = schedule.loaded_s[vehicle]
    if not joins:
        begin_s = schedule.ready_s[vehicle] + shop.travel_s[schedule.at[vehicle], place]
    begin_s = max(begin_s, shop.release_s[job])
    second = shop.first_service[job] + 1
    loaded_s = _served(shop, schedule, second - 1, begin_s, book)
    now_s = loaded_s + shop.lead_s[second]
    if joins:
        now_s = schedule.ready_s[vehicle] + loaded_s - schedule.loaded_s[vehicle]
        now_s += shop.travel_s[schedule.at[vehicle], shop.last_place[job]]
    end_s: Number = _served(shop, schedule, second, now_s, book)
    if book and end_s < np.inf:
        schedule.at[vehicle], schedule.ready_s[vehicle] = shop.last_place[job], end_s
        schedule.loads_at[vehicle], schedule.loaded_s[vehicle] = place, loaded_s
        schedule.n_loads[vehicle] = schedule.n_loads[vehicle] + 1 if joins else 1
    return end_s


@njit(**_OPTIONS)
def _load_together(
    shop: Arrays, schedule: PartialSchedule, order: Int64Array, vehicle: Int64Array, position: Int
) -> int:
    """Load a vehicle with the job at a position and those that it does together with it; `together` has them then.

    Returns:
        How many they are.
    """
    v = vehicle[order[position]]
    place, n = shop.loaded_at[order[position]], 0
    now_s = schedule.ready_s[v] + shop.travel_s[schedule.at[v], place]
    for k in range(position, len(order)):
        job = order[k]
        if vehicle[job] != v:
            continue
        if n == shop.n_carried[v] or shop.loaded_at[job] != place:
            break
        now_s = _served(shop, schedule, shop.first_service[job], max(now_s, shop.release_s[job]), True)
        schedule.together[n] = job
        n += 1
    schedule.at[v], schedule.ready_s[v] = place, now_s
    schedule.n_loads[v] = n - 1
    return n


@njit(**_OPTIONS)
def _bring(shop: Arrays, schedule: PartialSchedule, job: Int, vehicle: Int) -> Number:
    """When a job ends that its vehicle is loaded with, which goes there from where it is; put into the schedule."""
    now_s: Number = schedule.ready_s[vehicle] + shop.travel_s[schedule.at[vehicle], shop.last_place[job]]
    now_s = _served(shop, schedule, shop.first_service[job] + 1, now_s, True)
    schedule.at[vehicle], schedule.ready_s[vehicle] = shop.last_place[job], now_s
    return now_s


@njit(**_OPTIONS)
def _with_end(shop: Arrays, total: Number, job: Int, vehicle: Int, end_s: Number) -> Number:
    """The objective with one more job."""
    total += shop.extra[vehicle, job] + shop.weight[job] * end_s
    if end_s > shop.due_s[job]:
        total += shop.late_cost[job] + shop.late_weight[job] * (end_s - shop.due_s[job])
    return total


@njit(**_OPTIONS)
def evaluate(shop: Arrays, schedule: PartialSchedule, order: Int64Array, vehicle: Int64Array, bound: Number) -> Number:
    """The objective of a plan; inf as soon as it is certain to be above `bound`.

    Args:
        shop: The shop.
        schedule: Memory; afterwards the stations' timetable, if the result is finite.
        order: Jobs that are planned, in order, shape (n,).
        vehicle: Vehicle of each job, shape (n_jobs,).
        bound: See above.
    """
    _clear(shop, schedule)
    total, last_s = 0.0, 0.0
    for k in range(len(order)):
        job = order[k]
        v = vehicle[job]
        if shop.n_carried[v] == 1 or shop.loaded_at[job] < 0:
            end_s = _job_end(shop, schedule, job, v, True)
            total = _with_end(shop, total, job, v, end_s)
            last_s = max(last_s, end_s)
        elif schedule.n_loads[v] > 0:
            schedule.n_loads[v] -= 1  # it was put in with one before it
        else:
            for i in range(_load_together(shop, schedule, order, vehicle, k)):
                job = schedule.together[i]
                end_s = _bring(shop, schedule, job, v)
                total = _with_end(shop, total, job, v, end_s)
                last_s = max(last_s, end_s)
        if not total + shop.makespan_weight * last_s <= bound:
            return np.inf
    return total + shop.makespan_weight * last_s


@njit(**_OPTIONS)
def dispatch(shop: Arrays, schedule: PartialSchedule, regret: Number, order: Int64Array, vehicle: Int64Array) -> int:
    """Make a plan job by job, each at the end of a vehicle's list, class by class.

    Next is the job with the least of: its end by the vehicle that ends it first, less `regret` x how much later the
    second best vehicle ends it. With 0 this is greedy; ties go to the lowest job and vehicle.

    Args:
        shop: The shop.
        schedule: Memory.
        regret: See above, >= 0.
        order: In: jobs to plan, shape (n,); out: in order, those nobody can do at the end.
        vehicle: Out: vehicle of each job of `order`, shape (n_jobs,).

    Returns:
        How many were planned.
    """
    _clear(shop, schedule)
    for done in range(len(order)):
        chosen_k, chosen_v, chosen_class, least = -1, -1, 0, np.inf
        for k in range(done, len(order)):
            job = order[k]
            if chosen_k >= 0 and shop.class_of[job] > chosen_class:
                continue
            best, second, best_v = np.inf, np.inf, -1
            for v in range(len(shop.start)):
                if shop.extra[v, job] == np.inf:
                    continue
                end_s = _likely_end(shop, schedule, job, v, False)
                if end_s < best:
                    best, second, best_v = end_s, best, v
                elif end_s < second:
                    second = end_s
            if best_v < 0:
                continue
            rank = best
            if regret > 0.0 and second < np.inf:
                rank -= regret * (second - best)
            if chosen_k < 0 or rank < least or shop.class_of[job] < chosen_class:
                chosen_k, chosen_v, chosen_class, least = k, best_v, shop.class_of[job], rank
        if chosen_k < 0:
            return done
        job = order[chosen_k]
        _move(order, chosen_k, done)
        vehicle[job] = chosen_v
        _likely_end(shop, schedule, job, chosen_v, True)
    return len(order)


@njit(**_OPTIONS)
def append(shop: Arrays, schedule: PartialSchedule, n_planned: int, order: Int64Array, vehicle: Int64Array) -> int:
    """Complete a plan: the jobs it does not have yet are put to its end in their order, each where it ends first.

    Args:
        shop: The shop.
        schedule: Memory.
        n_planned: How many jobs the plan has.
        order: In: its jobs in order, then the others, shape (n,); out: in order, those nobody can do at the end.
        vehicle: In: vehicle of each job that is planned; out: of each job of `order`, shape (n_jobs,).

    Returns:
        How many are planned then; fewer than before if somebody has no way to a job any more.
    """
    _clear(shop, schedule)
    done = 0
    for k in range(len(order)):
        # What nobody can do has been moved behind the end.
        job = order[done]
        best, best_v = np.inf, -1
        first, last = (vehicle[job], vehicle[job] + 1) if k < n_planned else (0, len(shop.start))
        for v in range(first, last):
            if shop.extra[v, job] == np.inf:
                continue
            end_s = _likely_end(shop, schedule, job, v, False)
            if end_s < best:
                best, best_v = end_s, v
        if best_v < 0:
            _move(order, done, len(order) - 1)
            continue
        vehicle[job] = best_v
        _likely_end(shop, schedule, job, best_v, True)
        done += 1
    return done


@njit(**_OPTIONS)
def _move(order: Int64Array, source: Int, target: Int) -> None:
    """Take the job at one position out of the order and put it in at another."""
    job = order[source]
    for k in range(source, target):
        order[k] = order[k + 1]
    for k in range(source, target, -1):
        order[k] = order[k - 1]
    order[target] = job


@njit(**_OPTIONS)
def _swap_tails(order: Int64Array, vehicle: Int64Array, position: Int, a: Int, b: Int) -> None:
    """Two vehicles swap all their jobs from a position on."""
    for k in range(position, len(order)):
        if vehicle[order[k]] == a:
            vehicle[order[k]] = b
        elif vehicle[order[k]] == b:
            vehicle[order[k]] = a


@njit(**_OPTIONS)
def _copy(source: Int64Array, target: Int64Array) -> None:
    for k in range(len(source)):
        target[k] = source[k]


@njit(**_OPTIONS)
def _swap(values: Int64Array, a: Int, b: Int) -> None:
    values[a], values[b] = values[b], values[a]


@njit(**_OPTIONS)
def _random(state: npt.NDArray[np.uint64]) -> float:
    """A number in [0, 1) by xorshift64*, Vigna, ACM Transactions on Mathematical Software 42(4), 2016."""
    x = state[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[0] = x
    return float((x * np.uint64(2685821657736338717)) >> np.uint64(11)) / 9007199254740992.0


@njit(**_OPTIONS)
def _below(state: npt.NDArray[np.uint64], n: Int) -> int:
    return int(_random(state) * n)


@njit(**_OPTIONS)
def anneal(
    shop: Arrays,
    schedule: PartialSchedule,
    plan: JobPlan,
    best_plan: JobPlan,
    cooling: Cooling,
    state: npt.NDArray[np.uint64],
) -> Number:
    """Improve a plan by random changes, taken by the rule of Metropolis while the temperature falls.

    A change moves a job in the order, maybe to another vehicle; swaps two positions; swaps the vehicles of two jobs; or
    swaps all that two vehicles do from some position on. Source: Kirkpatrick, Gelatt, Vecchi, "Optimization by
    simulated annealing", Science 220, 1983.

    Args:
        shop: The shop.
        schedule: Memory.
        plan: The plan, of at least one job; changed.
        best_plan: Out: the best plan met, arrays of the same shapes.
        cooling: How long, and from which temperature to which.
        state: State of the random numbers, not 0, shape (1,); changed.

    Returns:
        The objective of the best plan, never above that of the first.
    """
    order, vehicle = plan.order, plan.vehicle
    n, n_vehicles = len(order), len(shop.start)
    current = evaluate(shop, schedule, order, vehicle, np.inf)
    best: Number = current
    _copy(order, best_plan.order)
    _copy(vehicle, best_plan.vehicle)
    temperature, factor = cooling.hot, (cooling.cold / cooling.hot) ** (1.0 / max(cooling.iterations, 1))
    for _ in range(cooling.iterations):
        temperature *= factor
        bound = current - temperature * np.log(1.0 - _random(state))
        kind = _random(state)
        source = _below(state, n)
        if kind < MOVE_SHARES[0]:
            if _random(state) < 0.5:
                target = _below(state, n)
            else:
                target = min(n - 1, max(0, source + _below(state, 2 * NEAR_POSITIONS + 1) - NEAR_POSITIONS))
            job = order[source]
            before = vehicle[job]
            if _random(state) < 0.5:
                vehicle[job] = _below(state, n_vehicles)
            _move(order, source, target)
            changed = evaluate(shop, schedule, order, vehicle, bound)
            if changed == np.inf:
                _move(order, target, source)
                vehicle[job] = before
        elif kind < MOVE_SHARES[1]:
            target = _below(state, n)
            with_vehicles = _random(state) < 0.5
            a, b = order[source], order[target]
            _swap(order, source, target)
            if with_vehicles:
                _swap(vehicle, a, b)
            changed = evaluate(shop, schedule, order, vehicle, bound)
            if changed == np.inf:
                _swap(order, source, target)
                if with_vehicles:
                    _swap(vehicle, a, b)
        elif kind < MOVE_SHARES[2]:
            a, b = _below(state, n_vehicles), _below(state, n_vehicles)
            _swap_tails(order, vehicle, source, a, b)
            changed = evaluate(shop, schedule, order, vehicle, bound)
            if changed == np.inf:
                _swap_tails(order, vehicle, source, a, b)
        else:
            a, b = order[source], order[_below(state, n)]
            _swap(vehicle, a, b)
            changed = evaluate(shop, schedule, order, vehicle, bound)
            if changed == np.inf:
                _swap(vehicle, a, b)
        if changed == np.inf:
            continue
        current = changed
        if current < best:
            best = current
            _copy(order, best_plan.order)
            _copy(vehicle, best_plan.vehicle)
    return best
