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

from fleet.envs.grid.kernel import FREE, LOADING, NEVER, NONE, TO_DROP, TO_PICK, UNLOADING, Floor, Ints, SmallInts
from planners.allocation.apparent_tardiness import FAR_OFF
from planners.allocation.costs import LOOK_AHEAD

CHANGE_STEPS = 3
"""Timesteps in which one car leaves a dock and the next one that waits for it drives in."""
_OUT = -1
"""Phase of a car that does nothing more."""


class Jobs(NamedTuple):
    """Deliveries, ascending in release; times in timesteps."""

    release: Ints
    due: Ints
    """`NEVER` = any time."""
    pick: Ints
    drop: Ints
    """Stations; all of shape (m,)."""


class Outlook(NamedTuple):
    """A fleet at one moment, without what is still to be ordered; n cars, m deliveries that are known and not done."""

    now: int
    """The timestep."""
    state: Ints
    """Lane-graph state of each car, shape (n,)."""
    phase: SmallInts
    """`fleet.envs.grid.kernel.Phase` of each car, shape (n,)."""
    left: Ints
    """Timesteps of service that are left, shape (n,)."""
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
    n, m, f = len(outlook.state), len(outlook.number), futures.release.shape[1]
    release, due = np.empty(m + f, dtype=np.int32), np.empty(m + f, dtype=np.int32)
    pick, drop = np.empty(m + f, dtype=np.int32), np.empty(m + f, dtype=np.int32)
    jobs_now = Jobs(release, due, pick, drop)
    release[:m], due[:m] = outlook.jobs.release, outlook.jobs.due
    pick[:m], drop[:m] = outlook.jobs.pick, outlook.jobs.drop
    memory = np.empty((5, n), dtype=np.int32)
    arm, under_way = np.empty(len(floor.dock_row), dtype=np.int32), np.empty(len(floor.dock_row), dtype=np.int32)
    waiting = np.empty(m + f, dtype=np.int32)
    for future in range(first, last):
        release[m:], due[m:] = futures.release[future], futures.due[future]
        pick[m:], drop[m:] = futures.pick[future], futures.drop[future]
        for choice in range(len(cars)):
            scores[choice, future] = _play_on(
                floor, outlook, jobs_now, cars[choice], jobs[choice], rule, memory, arm, under_way, waiting
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
    arm: Ints,
    under_way: Ints,
    waiting: Ints,
) -> float:  # pragma: no cover - compiled
    """Play one future to the horizon; returns what it is worth."""
    n, m = len(outlook.state), len(outlook.number)
    # When the next thing happens to each car, what it is about, where it stands, what it brings.
    time, phase, place, job = memory[0], memory[1], memory[2], memory[3]
    end = outlook.now + rule.horizon
    arm[:] = outlook.now - CHANGE_STEPS
    under_way[:] = 0
    n_waiting = 0
    waiting[:m] = 1
    for car in range(n):
        if outlook.job[car] != NONE:
            waiting[outlook.job[car]] = 0
    for row in range(m):
        if waiting[row]:
            waiting[n_waiting] = row
            n_waiting += 1
    coming = m
    for car in range(n):
        phase[car], place[car], job[car] = outlook.phase[car], outlook.state[car], outlook.job[car]
        time[car] = outlook.now
        if phase[car] in (TO_PICK, TO_DROP):
            station = jobs.pick[job[car]] if phase[car] == TO_PICK else jobs.drop[job[car]]
            time[car] += floor.distance[floor.dock_row[station], place[car]]
        elif phase[car] in (LOADING, UNLOADING):
            time[car] += outlook.left[car]
            arm[jobs.pick[job[car]] if phase[car] == LOADING else jobs.drop[job[car]]] = time[car]
        elif phase[car] != FREE:
            phase[car], time[car] = _OUT, NEVER
        if job[car] != NONE:
            under_way[jobs.drop[job[car]]] += 1
            under_way[jobs.pick[job[car]]] += phase[car] in (TO_PICK, LOADING)
    if chosen_job != NONE:
        for k in range(n_waiting):
            if waiting[k] == chosen_job:
                n_waiting -= 1
                waiting[k] = waiting[n_waiting]
                break
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
            worth += 1.0
            if now > jobs.due[job[car]]:
                worth -= rule.late * (now - jobs.due[job[car]])
            phase[car], job[car] = FREE, NONE
            time[car] = outlook.now + -((outlook.now - now) // rule.step) * rule.step
        else:
            while coming < len(jobs.release) and jobs.release[coming] <= now:
                waiting[n_waiting] = coming
                n_waiting += 1
                coming += 1
            n_waiting = _give_out(floor, jobs, now, rule, memory, under_way, waiting, n_waiting)
            next_time = now + rule.step
            if n_waiting == 0:
                arrival = jobs.release[coming] if coming < len(jobs.release) else NEVER
                next_time = end if arrival >= end else outlook.now - ((outlook.now - arrival) // rule.step) * rule.step
            for other in range(n):
                if phase[other] == FREE and time[other] <= now:
                    time[other] = max(next_time, now + rule.step)
    # What is under way counts by how far it has come, what is late by how late it is already.
    for car in range(n):
        if job[car] != NONE:
            if phase[car] in (TO_DROP, UNLOADING):
                worth += 0.5
            if end > jobs.due[job[car]]:
                worth -= rule.late * (end - jobs.due[job[car]])
    for k in range(n_waiting):
        if end > jobs.due[waiting[k]]:
            worth -= rule.late * (end - jobs.due[waiting[k]])
    return worth


@njit(cache=True, nogil=True)
def _give_out(
    floor: Floor,
    jobs: Jobs,
    now: int,
    rule: Rule,
    memory: npt.NDArray[np.int32],
    under_way: Ints,
    waiting: Ints,
    n_waiting: int,
) -> int:  # pragma: no cover - compiled
    """Give the free cars deliveries, the best pair of car and delivery first; returns how many still wait."""
    time, phase, place = memory[0], memory[1], memory[2]
    while n_waiting > 0:
        best, best_car, best_k = 0.0, NONE, NONE
        for k in range(n_waiting):
            row = waiting[k]
            pick, drop = jobs.pick[row], jobs.drop[row]
            if under_way[pick] >= rule.room or under_way[drop] >= rule.room:
                continue
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
                if index > best:
                    best, best_car, best_k = index, car, k
        if best_car == NONE:
            break
        row = waiting[best_k]
        n_waiting -= 1
        waiting[best_k] = waiting[n_waiting]
        _set_off(floor, jobs, best_car, row, now, memory, under_way)
    return n_waiting


@njit(cache=True, nogil=True)
def _set_off(
    floor: Floor, jobs: Jobs, car: int, row: int, now: int, memory: npt.NDArray[np.int32], under_way: Ints
) -> None:  # pragma: no cover - compiled
    time, phase, place, job = memory[0], memory[1], memory[2], memory[3]
    under_way[jobs.pick[row]] += 1
    under_way[jobs.drop[row]] += 1
    phase[car], job[car] = TO_PICK, row
    time[car] = now + floor.distance[floor.dock_row[jobs.pick[row]], place[car]]
