"""Kernel of `DispatchVec`: a step of dispatch for some of the fleets of a block, and what their cars see after it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.abstract import kernel
from fleet.abstract.block import BlockRows, FleetRow, Stepping, fleet_at, plan, send
from fleet.abstract.compiled import compiled, inner
from fleet.abstract.fleet import TIMESTEP_S
from fleet.abstract.kernel import (
    FREE,
    NEVER,
    NONE,
    READY,
    TO_DROP,
    UNLOADING,
    Battery,
    Bools,
    Faults,
    Floor,
    Ints,
    SmallInts,
)
from fleet.envs.dispatch.view import N_OWN, N_PER_CANDIDATE, N_SUMMARY, DispatchView, fill_candidates

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
_MINUTES = TIMESTEP_S / 60.0


class DispatchFloor(NamedTuple):
    """What never changes about a floor; S states."""

    goal_row: Ints
    """Row of `Floor.distance` of each state that is a goal, else `NONE`, shape (S,)."""
    where: Floats
    """What a car in each state is told of where it is, shape (S, 4)."""
    pose: Doubles
    """Shape (S, 3)."""
    far_steps: int
    """The longest way between two places, in timesteps."""


class DispatchTables(NamedTuple):
    """What dispatch has besides the block; B fleets of n cars, k candidates."""

    pressing: Ints
    """All tasks of each fleet, the most pressing first, shape (B, capacity)."""
    idle_steps: npt.NDArray[np.int64]
    """Steps for which each car has been waiting for a task, shape (B, n)."""
    rows: Floats
    """Observations, shape (B, n, n_numbers)."""
    mask: SmallInts
    """Legal actions, shape (B, n, k + 1)."""
    candidates: Ints
    """Tasks they stand for, `NONE` for none, shape (B, n, k)."""
    terms: Doubles
    """Weighted terms of the rewards, shape (B, n, 5)."""
    lost: Bools
    """Cars whose choice another one got, shape (B, n)."""
    illegal: Bools
    """Cars whose action was illegal, shape (B, n)."""


class DispatchMemory(NamedTuple):
    """Memory that one thread works in."""

    claim: Ints
    """Car that gets each order; `NONE` for all between calls, shape (capacity,)."""
    wanted: Ints
    """Task that each car wants, shape (n,)."""
    free: Bools
    """Shape (n,)."""
    task: Ints
    pick: Ints
    drop: Ints
    rank: SmallInts
    age_s: Doubles
    due_s: Doubles
    """As in `DispatchView`, the most pressing task first, shape (capacity,)."""
    pressing: npt.NDArray[np.int64]
    """0, 1, 2, ..., shape (capacity,)."""


@compiled
def step_some(
    first: int,
    last: int,
    floor_arrays: tuple[Any, ...],
    told_arrays: tuple[Any, ...],
    block: tuple[tuple[Any, ...], ...],
    table_arrays: tuple[Any, ...],
    stepping_arrays: tuple[Any, ...],
    memory_arrays: tuple[Any, ...],
    actions: npt.NDArray[np.int64],
    weights: tuple[float, float, float, float, float],
    fault_numbers: tuple[float, float, float],
    battery_numbers: tuple[float, float],
    n_timesteps: int,
    left: Doubles,
) -> None:  # pragma: no cover - compiled
    """Make a step of the fleets from `first` to before `last`.

    Args:
        first: The first fleet.
        last: The one behind the last.
        floor_arrays: A `Floor`.
        told_arrays: A `DispatchFloor`.
        block: Of `GridBlock.arrays`.
        table_arrays: `DispatchTables`; receives observations, masks, terms.
        stepping_arrays: A `Stepping`.
        memory_arrays: A `DispatchMemory`.
        actions: Shape (B, n).
        weights: Of the terms, in their order.
        fault_numbers: `Faults`.
        battery_numbers: A `Battery`.
        n_timesteps: Timesteps of a step.
        left: Share of the episode that is left after the step, shape (B,).
    """
    floor, tables, memory = Floor(*floor_arrays), DispatchTables(*table_arrays), DispatchMemory(*memory_arrays)
    stepping, rows = Stepping(*stepping_arrays), BlockRows(*block[4])
    faults, battery = Faults(*fault_numbers), Battery(*battery_numbers)
    for b in range(first, last):
        fleet = fleet_at(block[0], block[1], block[2], block[3], rows, b)
        for count in fleet.counts:
            count[:] = 0
        _give(floor, fleet, tables, memory, stepping.first, actions[b], rows.now[b], b)
        for _ in range(n_timesteps):
            rows.salt[b] += 1
            plan(floor, fleet, stepping, rows.salt[b], stepping.nobody)
            kernel.count_moves(fleet.cars, stepping.after, fleet.counts)
            rows.now[b] += 1
            _turn(floor, fleet, faults, battery, stepping.first, rows.dice[b], rows.now[b])
        _earn(fleet, tables.lost[b], weights, tables.terms[b])
        _observe(floor, DispatchFloor(*told_arrays), fleet, tables, memory, rows.now[b], left[b], b)


@compiled
def begin_one(
    b: int,
    floor_arrays: tuple[Any, ...],
    told_arrays: tuple[Any, ...],
    block: tuple[tuple[Any, ...], ...],
    table_arrays: tuple[Any, ...],
    stepping_arrays: tuple[Any, ...],
    memory_arrays: tuple[Any, ...],
    fault_numbers: tuple[float, float, float],
    battery_numbers: tuple[float, float],
) -> None:  # pragma: no cover - compiled
    """Begin the episode of one fleet that `GridBlock.begin` has put in its place, and observe it."""
    floor, tables, rows = Floor(*floor_arrays), DispatchTables(*table_arrays), BlockRows(*block[4])
    fleet = fleet_at(block[0], block[1], block[2], block[3], rows, b)
    faults, battery = Faults(*fault_numbers), Battery(*battery_numbers)
    _turn(floor, fleet, faults, battery, Stepping(*stepping_arrays).first, rows.dice[b], rows.now[b])
    tables.idle_steps[b] = 0
    _observe(floor, DispatchFloor(*told_arrays), fleet, tables, DispatchMemory(*memory_arrays), rows.now[b], 1.0, b)


@inner
def _turn(
    floor: Floor, fleet: FleetRow, faults: Faults, battery: Battery, first: Ints, dice: int, now: int
) -> None:  # pragma: no cover - compiled
    """Everything that happens between two moves, as `GridFleet` has it."""
    kernel.break_down(fleet.cars, fleet.tasks, fleet.stations, faults, dice, now)
    kernel.serve(floor, fleet.cars, fleet.tasks, fleet.stations, fleet.counts, now)
    kernel.charge_up(floor, fleet.cars, battery)
    kernel.release(fleet.tasks, fleet.counts, now)
    send(floor, fleet, first, now)


@inner
def _give(
    floor: Floor,
    fleet: FleetRow,
    tables: DispatchTables,
    memory: DispatchMemory,
    first: Ints,
    actions: npt.NDArray[np.int64],
    now: int,
    b: int,
) -> None:  # pragma: no cover - compiled
    """Give each order that cars have chosen to the one of them that has waited longest, then to the lowest index."""
    cars, idle_steps, lost = fleet.cars, tables.idle_steps[b], tables.lost[b]
    n, n_actions = tables.mask.shape[1], tables.mask.shape[2]
    wanted, claim = memory.wanted, memory.claim
    for car in range(n):
        action = actions[car]
        legal = 0 <= action < n_actions and tables.mask[b, car, action] == 1
        tables.illegal[b, car] = not legal
        wanted[car] = NONE
        if legal and action > 0:
            task = tables.candidates[b, car, action - 1]
            wanted[car] = task
            order = fleet.tasks.order[task]
            if claim[order] == NONE or idle_steps[car] > idle_steps[claim[order]]:
                claim[order] = car
    given = False
    for car in range(n):
        won = wanted[car] != NONE and claim[fleet.tasks.order[wanted[car]]] == car
        lost[car] = wanted[car] != NONE and not won
        idle_steps[car] = idle_steps[car] + 1 if cars.phase[car] == FREE and not won else 0
    for car in range(n):
        if wanted[car] != NONE and not lost[car]:
            claim[fleet.tasks.order[wanted[car]]] = NONE
            kernel.assign(cars, fleet.tasks, fleet.stations, car, wanted[car], now)
            given = True
    if given:
        send(floor, fleet, first, now)


@inner
def _earn(
    fleet: FleetRow, lost: Bools, weights: tuple[float, float, float, float, float], terms: Doubles
) -> None:  # pragma: no cover - compiled
    """Fill in the terms of the rewards, shape (n, 5), as `DispatchEnv` has them."""
    counts, n = fleet.counts, len(lost)
    for car in range(n):
        terms[car, 0] = weights[0] * counts.delivered[car]
        terms[car, 1] = weights[1] * counts.late[car] * _MINUTES
        terms[car, 2] = weights[2] * counts.empty[car]
        terms[car, 3] = weights[3] * counts.open[0] * _MINUTES / n
        terms[car, 4] = weights[4] * lost[car]


@inner
def _observe(
    floor: Floor,
    told: DispatchFloor,
    fleet: FleetRow,
    tables: DispatchTables,
    memory: DispatchMemory,
    now: int,
    left: float,
    b: int,
) -> None:  # pragma: no cover - compiled
    """Fill in observations, masks and candidates, as `DispatchObserver` has them."""
    cars, tasks = fleet.cars, fleet.tasks
    rows, mask, candidates = tables.rows[b], tables.mask[b], tables.candidates[b]
    n, k = candidates.shape
    rows[:] = 0.0
    mask[:] = 0
    candidates[:] = NONE
    n_free = n_loaded = n_charging = 0
    for car in range(n):
        state, phase, row = cars.state[car], cars.phase[car], rows[car]
        for i in range(4):
            row[i] = told.where[state, i]
        if phase <= UNLOADING:
            row[4 + phase] = 1.0
        row[9] = cars.held[car]
        goal_row = told.goal_row[cars.goal[car]]
        if goal_row != NONE:
            row[10] = floor.distance[goal_row, state] / told.far_steps
        mask[car, 0] = 1
        memory.free[car] = phase == FREE
        n_free += phase == FREE
        n_charging += cars.charger[car] != NONE
        n_loaded += phase in (TO_DROP, UNLOADING)
    m = n_late = 0
    for task in range(tasks.window[0], tasks.window[1]):
        if tasks.stage[task] == READY:
            m += 1
            n_late += tasks.due[task] < now
    if n_free > 0 and m > 0:
        fill_candidates(
            floor,
            _ready(told, fleet, tables.pressing[b], memory, m, now),
            memory.pressing[:m],
            told.far_steps,
            rows,
            mask,
            candidates,
        )
    at = N_OWN + k * N_PER_CANDIDATE
    chargers_left = 1.0 - n_charging / max(1, len(floor.charger_state))
    for car in range(n):
        row = rows[car]
        row[11] = mask[car, 1]
        row[at] = n_free / n
        row[at + 1] = m / (m + n)
        row[at + 2] = n_loaded / n
        row[at + 3] = n_late / m if m > 0 else 0.0
        row[at + 4] = left
        if len(row) > at + N_SUMMARY:
            row[at + N_SUMMARY] = cars.charge[car]
            row[at + N_SUMMARY + 1] = chargers_left
        for i in range(10, at):
            row[i] = min(np.float32(1.0), max(np.float32(-1.0), row[i]))


@inner
def _ready(
    told: DispatchFloor, fleet: FleetRow, pressing: Ints, memory: DispatchMemory, m: int, now: int
) -> DispatchView:  # pragma: no cover - compiled
    """The fleet as `fill_candidates` reads it; its m ready tasks stand in the order in which they press."""
    cars, tasks = fleet.cars, fleet.tasks
    found = 0
    for place in range(len(tasks.stage)):
        task = pressing[place]
        if tasks.stage[task] == READY:
            memory.task[found] = task
            memory.pick[found] = tasks.pick[task]
            memory.drop[found] = tasks.drop[task]
            memory.rank[found] = tasks.rank[task]
            memory.age_s[found] = (now - tasks.release[task]) * TIMESTEP_S
            memory.due_s[found] = np.inf if tasks.due[task] == NEVER else (tasks.due[task] - now) * TIMESTEP_S
            found += 1
            if found == m:
                break
    # Poses of all states, tasks in the place of orders, no free chargers: nobody reads them here.
    return DispatchView(
        0.0,
        0.0,
        told.pose,
        cars.state,
        cars.goal,
        cars.phase,
        cars.held,
        memory.free,
        memory.task[:m],
        memory.task[:m],
        memory.pick[:m],
        memory.drop[:m],
        memory.rank[:m],
        memory.age_s[:m],
        memory.due_s[:m],
        cars.charge,
        0.0,
        fleet.stations.under_way,
    )
