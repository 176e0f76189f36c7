"""Outlook: a fleet played on by a rule in a model without traffic, thousands of times faster than on the grid.

Cars drive the shortest ways at one move a timestep, wait for the arm in the order in which they come, and are served
for a fixed time; whenever cars have no task, a rule gives them some. So nothing happens between two events, and a
rollout of some minutes takes tens of microseconds. What is left out is that cars stand in each other's way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.abstract.kernel import FREE, LOADING, NEVER, NONE, TO_DROP, TO_PICK, UNLOADING, Floor, Ints, SmallInts
from planners.allocation.apparent_tardiness import FAR_OFF
from planners.allocation.costs import LOOK_AHEAD

CHANGE_STEPS = 3
"""Timesteps in which one car leaves a dock and the next one that waits for it drives in."""


class Jobs(NamedTuple):
    """Deliveries, ascending in release; times in timesteps. Of those of one order one is made; they are neighbours."""

    release: Ints
    due: Ints
    """`NEVER` = any time."""
    pick: Ints
    drop: Ints
    """Stations."""
    rank: Ints
    """Priority classes, 0 = most urgent."""
    order: Ints
    """Numbers of the orders; all of shape (m,)."""


class Outlook(NamedTuple):
    """A fleet at one moment, without what is still to be ordered; n cars, m deliveries that are known and not done."""

    now: int
    """The timestep."""
    state: Ints
    """Lane-graph state of each car, shape (n,)."""
    phase: SmallInts
    """`fleet.abstract.kernel.Phase` of each car, shape (n,)."""
    left: Ints
    """Timesteps of service that are left, or until the car goes on, shape (n,)."""
    job: Ints
    """Delivery of each car, as a row of `jobs`, `NONE` = it has none, shape (n,)."""
    jobs: Jobs
    number: Ints
    """What the environment calls each of them (`DispatchView.task`), ascending, shape (m,)."""


class Rule(NamedTuple):
    """How the fleet goes on, and what is thought of it."""

    horizon: int
    """Timesteps to play on."""
    step: int
    """Tasks are given out every so many timesteps."""
    room: int
    """Tasks that may be under way to one station."""
    mean: float
    """Mean time of a delivery, in timesteps; 0 = the nearest delivery is next, whatever its due date."""
    late: float
    """Price of a timestep of tardiness, in deliveries."""
    depth: int
    """Deliveries of each pick station that can be chosen, the most pressing ones."""
    strict: bool
    """Whether those of a class go before those of the next, at any cost."""


@njit(cache=True, nogil=True)
def _line_up(jobs: Jobs, line: Ints, n: int, row: int) -> int:  # pragma: no cover - compiled
    """Put a delivery where it belongs in a line, by class, due date and release; returns how many are in it."""
    k = n
    while k > 0:
        other = line[k - 1]
        if jobs.rank[other] < jobs.rank[row] or (
            jobs.rank[other] == jobs.rank[row] and jobs.due[other] <= jobs.due[row]
        ):
            break
        line[k] = other
        k -= 1
    line[k] = row
    return n + 1


@njit(cache=True, nogil=True)
def _leave(jobs: Jobs, line: Ints, n: int, row: int) -> int:  # pragma: no cover - compiled
    """Take the deliveries of a delivery's order out of a line; returns how many are left."""
    left = 0
    for k in range(n):
        if jobs.order[line[k]] != jobs.order[row]:
            line[left] = line[k]
            left += 1
    return left


@njit(cache=True, nogil=True)
def score_choices(
    floor: Floor,
    outlook: Outlook,
    futures: Jobs,
    cars: Ints,
    jobs: Ints,
    first: int,
    last: int,
    rule: Rule,
    scores: npt.NDArray[np.float64],
) -> None:  # pragma: no cover - compiled
    """Play every choice in some of the futures.

    Args:
        floor: The site.
        outlook: The fleet.
        futures: Orders to come, shape (n_futures, f), `NEVER` in the release fills up.
        cars: Car of each choice, shape (c,).
        jobs: Row of the delivery that it is given at once, `NONE` = as the rule has it, shape (c,).
        first: The first of the futures to be played.
        last: The one behind the last of them.
        rule: How the fleet goes on.
        scores: Receives the worth of each choice in these futures, shape (c, n_futures).
    """
    m, width = len(outlook.number), futures.release.shape[1]
    table = np.empty((len(outlook.jobs), m + width), dtype=np.int32)
    all_jobs = Jobs(table[0], table[1], table[2], table[3], table[4], table[5])
    for column in range(len(table)):
        table[column, :m] = outlook.jobs[column]
    waits = np.ones(m, dtype=np.bool_)
    for job in outlook.job:
        if job != NONE:
            waits &= outlook.jobs.order != outlook.jobs.order[job]
    line = np.empty(m + width, dtype=np.int32)
    n_in_line = 0
    for row in range(m):
        if waits[row]:
            n_in_line = _line_up(outlook.jobs, line, n_in_line, row)
    memory = np.empty((4, len(outlook.state)), dtype=np.int32)
    at_stations = np.empty((3, len(floor.dock_row)), dtype=np.int32)
    waiting = np.empty(m + width, dtype=np.int32)
    for future in range(first, last):
        for column in range(len(table)):
            table[column, m:] = futures[column][future]
        for choice in range(len(cars)):
            waiting[:n_in_line] = line[:n_in_line]
            scores[choice, future] = _play_on(
                floor, outlook, all_jobs, cars[choice], jobs[choice], rule, memory, at_stations, waiting, n_in_line
            )


@njit(cache=True, nogil=True)
def _play_on(
    floor: Floor,
    outlook: Outlook,
    jobs: Jobs,
    chosen_car: int,
    chosen_job: int,
    rule: Rule,
    memory: npt.NDArray[np.int32],
    at_stations: npt.NDArray[np.int32],
    waiting: Ints,
    n_waiting: int,
) -> float:  # pragma: no cover - compiled
    """Play one future to the horizon; returns what it is worth."""
    n, m = len(outlook.state), len(outlook.number)
    # When the next thing happens to each car, what it is about, where it stands, what it brings.
    time, phase, place, job = memory
    arm, under_way, _ = at_stations
    end = outlook.now + rule.horizon
    _begin(floor, outlook, jobs, memory, at_stations)
    coming = m
    if chosen_job != NONE:
        n_waiting = _leave(jobs, waiting, n_waiting, chosen_job)
        _set_off(floor, jobs, chosen_car, chosen_job, outlook.now, memory, under_way)
    worth = 0.0
    while True:
        car = time.argmin()
        now = time[car]
        if now >= end:
            break
        if phase[car] == TO_PICK or phase[car] == TO_DROP:
            station = jobs.pick[job[car]] if phase[car] == TO_PICK else jobs.drop[job[car]]
            begin = max(now, arm[station] + CHANGE_STEPS)
            place[car] = floor.dock_state[station]
            time[car] = arm[station] = begin + floor.service_steps
            phase[car] = LOADING if phase[car] == TO_PICK else UNLOADING
        elif phase[car] == LOADING:
            under_way[jobs.pick[job[car]]] -= 1
            time[car] = now + floor.distance[floor.dock_row[jobs.drop[job[car]]], place[car]]
            phase[car] = TO_DROP
        elif phase[car] == UNLOADING:
            under_way[jobs.drop[job[car]]] -= 1
            worth += 1.0 - rule.late * max(0, now - jobs.due[job[car]])
            phase[car], job[car] = FREE, NONE
            time[car] = _next_round(outlook.now, now, rule.step)
        else:
            while coming < len(jobs.release) and jobs.release[coming] <= now:
                n_waiting = _line_up(jobs, waiting, n_waiting, coming)
                coming += 1
            n_waiting = _give_out(floor, jobs, now, rule, memory, at_stations, waiting, n_waiting)
            again = now + rule.step
            if n_waiting == 0:
                arrival = jobs.release[coming] if coming < len(jobs.release) else end
                again = max(again, _next_round(outlook.now, min(arrival, end), rule.step))
            for other in range(n):
                if phase[other] == FREE and time[other] <= now:
                    time[other] = again
    # What is under way counts by how far it has come, what is late by how late it is already.
    for car in range(n):
        if job[car] != NONE:
            worth += 0.5 * (phase[car] in (TO_DROP, UNLOADING)) - rule.late * max(0, end - jobs.due[job[car]])
    for k in range(n_waiting):
        if k == 0 or jobs.order[waiting[k]] != jobs.order[waiting[k - 1]]:
            worth -= rule.late * max(0, end - jobs.due[waiting[k]])
    return worth


@njit(cache=True, nogil=True)
def _begin(
    floor: Floor, outlook: Outlook, jobs: Jobs, memory: npt.NDArray[np.int32], at_stations: npt.NDArray[np.int32]
) -> None:  # pragma: no cover - compiled
    """Fill in what cars and stations are about at the beginning."""
    time, phase, place, job = memory
    arm, under_way, _ = at_stations
    arm[:] = outlook.now - CHANGE_STEPS
    under_way[:] = 0
    phase[:], place[:], job[:] = outlook.phase, outlook.state, outlook.job
    time[:] = outlook.now + outlook.left
    for car in range(len(time)):
        if phase[car] in (TO_PICK, TO_DROP):
            station = jobs.pick[job[car]] if phase[car] == TO_PICK else jobs.drop[job[car]]
            time[car] += floor.distance[floor.dock_row[station], place[car]]
        elif phase[car] in (LOADING, UNLOADING):
            arm[jobs.pick[job[car]] if phase[car] == LOADING else jobs.drop[job[car]]] = time[car]
        elif phase[car] != FREE:
            time[car] = NEVER
        if job[car] != NONE:
            under_way[jobs.drop[job[car]]] += 1
            under_way[jobs.pick[job[car]]] += phase[car] in (TO_PICK, LOADING)


@njit(cache=True, nogil=True)
def _next_round(first: int, time: int, step: int) -> int:  # pragma: no cover - compiled
    """When tasks are given out next, at a time or after it."""
    return first - ((first - time) // step) * step


@njit(cache=True, nogil=True)
def _give_out(
    floor: Floor,
    jobs: Jobs,
    now: int,
    rule: Rule,
    memory: npt.NDArray[np.int32],
    at_stations: npt.NDArray[np.int32],
    waiting: Ints,
    n_waiting: int,
) -> int:  # pragma: no cover - compiled
    """Give the free cars deliveries, the best pair of car and delivery first; returns how many still wait."""
    time, phase, place, _ = memory
    _, under_way, seen = at_stations
    while n_waiting > 0:
        best, best_car, best_row = 0.0, NONE, NONE
        seen[:] = 0
        for k in range(n_waiting):
            row = waiting[k]
            pick, drop = jobs.pick[row], jobs.drop[row]
            if seen[pick] == rule.depth or under_way[pick] >= rule.room or under_way[drop] >= rule.room:
                continue
            seen[pick] += 1
            rest = floor.distance[floor.dock_row[drop], floor.dock_state[pick]] + 2.0 * floor.service_steps
            for car in range(len(phase)):
                if phase[car] != FREE or time[car] > now:
                    continue
                way = float(floor.distance[floor.dock_row[pick], place[car]])
                if rule.mean > 0.0:
                    left = FAR_OFF * rule.mean if jobs.due[row] == NEVER else float(jobs.due[row] - now)
                    spare = max(0.0, left - way - rest)
                    index = math.exp(-spare / (LOOK_AHEAD * rule.mean)) / (way + rest)
                else:
                    index = 1.0 / (1.0 + way)
                if rule.strict:
                    index += 2.0 - jobs.rank[row]  # the index is below 1
                if index > best:
                    best, best_car, best_row = index, car, row
        if best_car == NONE:
            break
        n_waiting = _leave(jobs, waiting, n_waiting, best_row)
        _set_off(floor, jobs, best_car, best_row, now, memory, under_way)
    return n_waiting


@njit(cache=True, nogil=True)
def _set_off(
    floor: Floor, jobs: Jobs, car: int, row: int, now: int, memory: npt.NDArray[np.int32], under_way: Ints
) -> None:  # pragma: no cover - compiled
    time, phase, place, job = memory
    under_way[jobs.pick[row]] += 1
    under_way[jobs.drop[row]] += 1
    phase[car], job[car] = TO_PICK, row
    time[car] = now + floor.distance[floor.dock_row[jobs.pick[row]], place[car]]
