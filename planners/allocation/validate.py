"""Referee: lists everything that is wrong with an assignment. Shares no code with the allocators."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.shop import Shop, Timetable

TOLERANCE_S = 1e-6
"""Rounding that is no fault."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One thing that is wrong with an assignment."""

    kind: str
    """unknown, vehicle_twice, task_twice, not_allowed, cost; of tasks planned ahead also not_first (the pair of a
    vehicle is not its first task), planned_twice, travel, release, service, errands (not in the task's order), load
    (more tasks aboard than may be), closed (before the station is free), overlap (two served at once), buffer,
    objective."""
    pair: tuple[int, int] | None
    """(vehicle, task); for vehicle_twice and task_twice the other one is -1; None where no pair is to blame."""


def faults(problem: AllocationProblem, assignment: Assignment) -> list[Fault]:
    """Check an assignment against its problem; empty = legal."""
    n_vehicles, n_tasks = problem.cost.shape
    pairs = [(int(vehicle), int(task)) for vehicle, task in assignment.pairs]
    found = []
    total = 0.0
    for vehicle, task in pairs:
        if not (0 <= vehicle < n_vehicles and 0 <= task < n_tasks):
            found.append(Fault(kind="unknown", pair=(vehicle, task)))
        elif problem.cost[vehicle, task] == math.inf:
            found.append(Fault(kind="not_allowed", pair=(vehicle, task)))
        else:
            total += float(problem.cost[vehicle, task])
    for vehicle, times in Counter(vehicle for vehicle, _ in pairs).items():
        if times > 1:
            found.append(Fault(kind="vehicle_twice", pair=(vehicle, -1)))
    for task, times in Counter(task for _, task in pairs).items():
        if times > 1:
            found.append(Fault(kind="task_twice", pair=(-1, task)))
    if not found and not math.isclose(total, assignment.cost, rel_tol=1e-9, abs_tol=1e-9):
        found.append(Fault(kind="cost", pair=None))
    found += _sequence_faults(problem, assignment)
    if not found and problem.shop is not None and assignment.timetable is not None:
        found += _timetable_faults(problem.shop, assignment.timetable, assignment.sequence)
    return found


def _sequence_faults(problem: AllocationProblem, assignment: Assignment) -> list[Fault]:
    """Tasks planned ahead: each once, allowed, and the pairs are those that come first."""
    found: list[Fault] = []
    if not assignment.sequence:
        return found
    n_vehicles, n_tasks = problem.cost.shape
    chosen = {int(vehicle): int(task) for vehicle, task in assignment.pairs}
    first = {vehicle: tasks[0] for vehicle, tasks in enumerate(assignment.sequence) if tasks}
    for vehicle in sorted(chosen.keys() | first.keys()):
        if chosen.get(vehicle) != first.get(vehicle):
            found.append(Fault(kind="not_first", pair=(vehicle, chosen.get(vehicle, -1))))
    seen: set[int] = set()
    for vehicle, tasks in enumerate(assignment.sequence):
        for task in tasks:
            if not (0 <= vehicle < n_vehicles and 0 <= task < n_tasks):
                found.append(Fault(kind="unknown", pair=(vehicle, task)))
            elif problem.cost[vehicle, task] == math.inf:
                found.append(Fault(kind="not_allowed", pair=(vehicle, task)))
            if task in seen:
                found.append(Fault(kind="planned_twice", pair=(vehicle, task)))
            seen.add(task)
    return found


def _timetable_faults(shop: Shop, times: Timetable, sequence: tuple[tuple[int, ...], ...]) -> list[Fault]:
    """Replay a timetable: drivers cannot be in two places, stations serve one at a time and have room for so many."""
    found = []
    objective, last_s = 0.0, -math.inf
    visits: list[tuple[int, int, int]] = []  # (errand, vehicle, task) at a station
    for vehicle, tasks in enumerate(sequence):
        at, now_s = int(shop.start[vehicle]), float(shop.ready_s[vehicle])
        begun: dict[int, int] = {}  # errands done of each task that has not ended
        for task, errand in _drive(shop, times, vehicle, tasks):
            pair = (vehicle, task)
            if times.vehicle[task] != vehicle:
                found.append(Fault(kind="unknown", pair=pair))
            # Written so that a time that is not a number is a fault.
            if not times.arrive_s[errand] >= now_s + shop.travel_s[at, shop.place[errand]] - TOLERANCE_S:
                found.append(Fault(kind="travel", pair=pair))
            in_order = times.arrive_s[errand] <= times.enter_s[errand] <= times.start_s[errand]
            if not (
                in_order and abs(times.start_s[errand] + shop.service_s[errand] - times.end_s[errand]) <= TOLERANCE_S
            ):
                found.append(Fault(kind="service", pair=pair))
            if shop.station[errand] >= 0:
                visits.append((errand, vehicle, task))
            at, now_s = int(shop.place[errand]), float(times.end_s[errand])
            first, end = int(shop.first_errand[task]), int(shop.first_errand[task + 1])
            if errand != first + begun.get(task, 0):
                found.append(Fault(kind="errands", pair=pair))
            begun[task] = errand - first + 1
            if len(begun) > (1 if shop.n_carried is None else int(shop.n_carried[vehicle])):
                found.append(Fault(kind="load", pair=pair))
            release_s = -math.inf if shop.release_s is None or errand != first else float(shop.release_s[task])
            if times.start_s[errand] < release_s - TOLERANCE_S:
                found.append(Fault(kind="release", pair=pair))
            if errand < end - 1:
                continue
            del begun[task]
            objective += now_s * (1.0 if shop.weight is None else float(shop.weight[task]))
            if shop.due_s is not None and now_s > shop.due_s[task]:
                late_weight = 1.0 if shop.late_weight is None else float(shop.late_weight[task])
                objective += late_weight * (now_s - float(shop.due_s[task]))
                objective += 0.0 if shop.late_cost is None else float(shop.late_cost[task])
            last_s = max(last_s, now_s)
    found += _station_faults(shop, times, visits)
    if last_s > -math.inf and shop.makespan_weight:
        objective += shop.makespan_weight * last_s
    if not found and not math.isclose(objective, times.objective, rel_tol=1e-9, abs_tol=1e-6):
        found.append(Fault(kind="objective", pair=None))
    return found


def _drive(shop: Shop, times: Timetable, vehicle: int, tasks: tuple[int, ...]) -> list[tuple[int, int]]:
    """Tasks and errands of a vehicle: in the order of its list, or of the timetable if it may carry several tasks."""
    errands = [
        (task, errand)
        for task in tasks
        for errand in range(int(shop.first_errand[task]), int(shop.first_errand[task + 1]))
    ]
    if shop.n_carried is not None and shop.n_carried[vehicle] > 1:
        errands.sort(key=lambda pair: float(times.start_s[pair[1]]))
    return errands


def _station_faults(shop: Shop, times: Timetable, visits: list[tuple[int, int, int]]) -> list[Fault]:
    found = []
    for station in range(shop.n_stations):
        here = [visit for visit in visits if shop.station[visit[0]] == station]
        for errand, vehicle, task in here:
            pair = (vehicle, task)
            begin_s, end_s, enter_s = times.start_s[errand], times.end_s[errand], times.enter_s[errand]
            others = [other for other, _, _ in here if other != errand]
            if begin_s < shop.free_s[station] - TOLERANCE_S:
                found.append(Fault(kind="closed", pair=pair))
            if any(times.start_s[o] < end_s - TOLERANCE_S and begin_s < times.end_s[o] - TOLERANCE_S for o in others):
                found.append(Fault(kind="overlap", pair=pair))
            inside = sum(bool(times.enter_s[o] <= enter_s < times.end_s[o] - TOLERANCE_S) for o in others)
            if inside >= shop.n_buffer_places[station]:
                found.append(Fault(kind="buffer", pair=pair))
    return found
