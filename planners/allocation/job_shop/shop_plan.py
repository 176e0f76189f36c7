"""Between a shop and its kernels: the arrays they read, and the timetable of what they chose."""

from __future__ import annotations

import numpy as np

from planners.allocation.arrays import Int64Array
from planners.allocation.job_shop.shop_kernel import Arrays
from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.allocation.shop import NO_STATION, Shop, Timetable
from planners.status import Status

CLASS_FACTOR = 100.0
"""A class weighs so many times what the next does. Within a plan classes are weighed: a vehicle that passes an
ordinary job on its way may do it first; where jobs are chosen one at a time, classes are strict."""


def arrays_of(problem: AllocationProblem, shop: Shop, class_factor: float = CLASS_FACTOR) -> Arrays:
    """What the kernels read of a problem.

    Args:
        problem: The problem; says who may do what, which class each task has, and who holds what.
        shop: Its shop.
        class_factor: How many times what the next class weighs a class weighs.
    """
    n, zero_s = shop.n_jobs, origin_s(shop)
    class_of = np.zeros(n, dtype=np.int64) if problem.class_of is None else problem.class_of.astype(np.int64)
    factor = class_factor ** (class_of.max(initial=0) - class_of)
    ones, ever = np.ones(n), np.full(n, np.inf)
    first, last = shop.first_errand[:-1], shop.first_errand[1:] - 1

    served = shop.station != NO_STATION
    lead_s, tail_s = [], np.zeros(n)
    for job in range(n):
        gone_s = 0.0
        for errand in range(first[job], last[job] + 1):
            if errand > first[job]:
                gone_s += shop.travel_s[shop.place[errand - 1], shop.place[errand]]
            if served[errand]:
                lead_s.append(gone_s)
                gone_s = 0.0
            else:
                gone_s += shop.service_s[errand]
        tail_s[job] = gone_s
    weight = (ones if shop.weight is None else shop.weight) * factor
    return Arrays(
        travel_s=np.ascontiguousarray(shop.travel_s, dtype=np.float64),
        start=shop.start.astype(np.int64),
        ready_s=shop.ready_s - zero_s,
        free_s=shop.free_s - zero_s,
        first_place=shop.place[first].astype(np.int64),
        last_place=shop.place[last].astype(np.int64),
        release_s=np.zeros(n) if shop.release_s is None else shop.release_s - zero_s,
        first_service=np.concatenate(([0], np.cumsum(served)))[shop.first_errand].astype(np.int64),
        lead_s=np.array(lead_s, dtype=np.float64),
        station=shop.station[served].astype(np.int64),
        service_s=shop.service_s[served].astype(np.float64),
        tail_s=tail_s,
        due_s=ever if shop.due_s is None else shop.due_s - zero_s,
        weight=weight,
        late_weight=(ones if shop.late_weight is None else shop.late_weight) * factor,
        late_cost=(np.zeros(n) if shop.late_cost is None else shop.late_cost) * factor,
        makespan_weight=float(shop.makespan_weight),
        class_of=class_of,
        extra=_extra(problem, weight),
        n_carried=np.ones(shop.n_vehicles, dtype=np.int64)
        if shop.n_carried is None
        else shop.n_carried.astype(np.int64),
        loaded_at=shop.loaded_at.astype(np.int64),
    )


def origin_s(shop: Shop) -> float:
    """The time that is zero in the kernels: the first moment a vehicle is ready."""
    return float(shop.ready_s.min(initial=np.inf)) if shop.n_vehicles else 0.0


def _extra(problem: AllocationProblem, weight: np.ndarray) -> np.ndarray:
    """Forbidden pairs, and what it costs to take a task from the vehicle that holds it."""
    extra = np.where(np.isinf(problem.cost), np.inf, 0.0)
    holders, tasks, worth = problem.kept()
    extra[:, tasks] += worth * weight[tasks]
    extra[holders, tasks] -= worth * weight[tasks]
    return extra


def planned(problem: AllocationProblem, shop: Shop, order: Int64Array, vehicle: Int64Array) -> Assignment:
    """The assignment that a plan comes to.

    Args:
        problem: The problem.
        shop: Its shop.
        order: Jobs that are planned, in order, shape (n,).
        vehicle: Vehicle of each of them, shape (n_jobs,).
    """
    sequence: list[list[int]] = [[] for _ in range(shop.n_vehicles)]
    for job in order.tolist():
        sequence[vehicle[job]].append(job)
    first = assignment(problem, [(v, jobs[0]) for v, jobs in enumerate(sequence) if jobs], Status.FEASIBLE)
    return Assignment(
        pairs=first.pairs,
        cost=first.cost,
        status=first.status,
        sequence=tuple(map(tuple, sequence)),
        timetable=timetable(shop, order, vehicle),
    )


def timetable(shop: Shop, order: Int64Array, vehicle: Int64Array) -> Timetable:
    """When everything happens if jobs are put into the timetable in an order, as the kernels do it.

    Args:
        shop: The shop.
        order: Jobs that are planned, in order, shape (n,).
        vehicle: Vehicle of each job, shape (n_jobs,).
    """
    at, ready_s = shop.start.tolist(), shop.ready_s.tolist()
    busy: list[list[tuple[float, float, int]]] = [[] for _ in range(shop.n_stations)]
    arrive_s, start_s, end_s = (np.full(len(shop.place), np.nan) for _ in range(3))
    done_by = np.full(shop.n_jobs, -1, dtype=np.int32)
    for v, jobs in shop.tours(order, vehicle):
        done_by[jobs] = v
        now_s = ready_s[v]
        for job, errand in _errands(shop, jobs):
            place, station, service_s = (
                int(shop.place[errand]),
                int(shop.station[errand]),
                float(shop.service_s[errand]),
            )
            now_s += shop.travel_s[at[v], place]
            arrive_s[errand] = now_s
            if errand == shop.first_errand[job] and shop.release_s is not None:
                now_s = max(now_s, shop.release_s[job])
            if station != NO_STATION:
                now_s = _gap(busy[station], max(now_s, shop.free_s[station]), service_s)
                busy[station].append((now_s, now_s + service_s, errand))
                busy[station].sort()
            start_s[errand], now_s, at[v] = now_s, now_s + service_s, place
            end_s[errand] = now_s
        ready_s[v] = now_s
    return Timetable(
        vehicle=done_by,
        arrive_s=arrive_s,
        enter_s=_entries(shop, busy, arrive_s),
        start_s=start_s,
        end_s=end_s,
        objective=_objective(shop, end_s[shop.first_errand[1:] - 1], done_by >= 0),
    )


def _errands(shop: Shop, jobs: list[int]) -> list[tuple[int, int]]:
    """Jobs and errands of a tour in the order in which they are done."""
    own = [range(int(shop.first_errand[job]), int(shop.first_errand[job + 1])) for job in jobs]
    if len(jobs) == 1:
        return [(jobs[0], errand) for errand in own[0]]
    return [(job, errands[end]) for end in (0, 1) for job, errands in zip(jobs, own, strict=True)]


def _gap(busy: list[tuple[float, float, int]], soonest_s: float, service_s: float) -> float:
    for begin_s, end_s, _ in busy:
        if end_s > soonest_s:
            if begin_s >= soonest_s + service_s:
                break
            soonest_s = end_s
    return soonest_s


def _entries(shop: Shop, busy: list[list[tuple[float, float, int]]], arrive_s: np.ndarray) -> np.ndarray:
    """A vehicle enters when so many services before its own have ended that the buffer has room."""
    enter_s = arrive_s.copy()
    for services, room in zip(busy, shop.n_buffer_places.tolist(), strict=True):
        for k in range(room, len(services)):
            errand = services[k][2]
            enter_s[errand] = max(enter_s[errand], services[k - room][1])
    return enter_s


def _objective(shop: Shop, end_s: np.ndarray, done: np.ndarray) -> float:
    """What the shop wants small, over the jobs that are done; a job may end late, but not early to make up for it."""
    ones = np.ones(shop.n_jobs)
    weight = ones if shop.weight is None else shop.weight
    total = float((weight * end_s)[done].sum())
    if shop.due_s is not None:
        late_weight = ones if shop.late_weight is None else shop.late_weight
        total += float((late_weight * np.maximum(0.0, end_s - shop.due_s))[done].sum())
        if shop.late_cost is not None:
            total += float(shop.late_cost[done & (end_s > shop.due_s)].sum())
    if shop.makespan_weight and done.any():
        total += shop.makespan_weight * float(end_s[done].max())
    return total
