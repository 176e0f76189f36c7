"""Kernel of `TrafficVec`: a timestep of some of the fleets of a block, and what their cars see after it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.abstract import kernel
from fleet.abstract.block import BlockRows, FleetRow, Stepping, fleet_at, plan, send, turn
from fleet.abstract.compiled import compiled, inner
from fleet.abstract.fleet import STATION_ROOM
from fleet.abstract.kernel import NONE, Bools, Floor, Ints, SmallInts
from fleet.envs.traffic.view import CellMemory, FloorTold, TrafficView, observe
from planners.mapf.distance_table import UNREACHABLE

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]


class TrafficTables(NamedTuple):
    """What traffic has besides the block; B fleets of n cars."""

    rows: Floats
    """Observations, shape (B, n, n_numbers)."""
    mask: SmallInts
    """Legal actions, shape (B, n, n_actions)."""
    terms: Doubles
    """Weighted terms of the rewards, shape (B, n, 5)."""
    waits: Bools
    """Cars that stand although they wished to move, shape (B, n)."""
    pushed: Bools
    """Cars that go where they did not wish to, shape (B, n)."""
    illegal: Bools
    """Cars whose action was illegal, shape (B, n)."""


class TrafficMemory(NamedTuple):
    """Memory that one thread works in, besides that of observations."""

    wanted: Ints
    """State that each car wishes to go to, shape (n,)."""
    asked: Bools
    """Cells that some car wishes to enter; none between calls, shape (n_cells,)."""


@compiled
def step_some(
    first: int,
    last: int,
    floor_arrays: tuple[Any, ...],
    told_arrays: tuple[Any, ...],
    block: tuple[tuple[Any, ...], ...],
    table_arrays: tuple[Any, ...],
    stepping_arrays: tuple[Any, ...],
    cell_arrays: tuple[Any, ...],
    memory_arrays: tuple[Any, ...],
    actions: npt.NDArray[np.int64],
    weights: tuple[float, float, float, float, float],
    team_share: float,
) -> None:  # pragma: no cover - compiled
    """Make a step of the fleets from `first` to before `last`.

    Args:
        first: The first fleet.
        last: The one behind the last.
        floor_arrays: A `Floor`.
        told_arrays: A `FloorTold`.
        block: Of `GridBlock.arrays`.
        table_arrays: `TrafficTables`; receives observations, masks, terms.
        stepping_arrays: A `Stepping`.
        cell_arrays: A `CellMemory`.
        memory_arrays: A `TrafficMemory`.
        actions: Shape (B, n).
        weights: Of the terms, in their order.
        team_share: Share of the reward for a parcel that all cars are given alike.
    """
    floor, told = Floor(*floor_arrays), FloorTold(*told_arrays)
    tables, memory = TrafficTables(*table_arrays), TrafficMemory(*memory_arrays)
    stepping, rows = Stepping(*stepping_arrays), BlockRows(*block[4])
    for b in range(first, last):
        fleet = fleet_at(block[0], block[1], block[2], block[3], rows, b)
        for count in fleet.counts:
            count[:] = 0
        _wish(told, fleet, tables, memory, actions[b], b)
        rows.salt[b] += 1
        plan(floor, fleet, stepping, rows.salt[b], memory.wanted)
        _judge(told, fleet, tables, memory, stepping.after, weights, b)
        kernel.count_moves(fleet.cars, stepping.after, fleet.counts)
        rows.now[b] += 1
        turn(floor, fleet, stepping.first, rows.now[b])
        _give_out(floor, fleet, stepping.first, rows.now[b])
        delivered = fleet.counts.delivered
        shared = team_share * (delivered.sum() / len(delivered))
        for car in range(len(delivered)):
            tables.terms[b, car, 1] = weights[1] * ((1.0 - team_share) * delivered[car] + shared)
        _observe(floor, told, fleet, tables, stepping, CellMemory(*cell_arrays), rows.salt[b], b)


@compiled
def begin_one(
    b: int,
    floor_arrays: tuple[Any, ...],
    told_arrays: tuple[Any, ...],
    block: tuple[tuple[Any, ...], ...],
    table_arrays: tuple[Any, ...],
    stepping_arrays: tuple[Any, ...],
    cell_arrays: tuple[Any, ...],
) -> None:  # pragma: no cover - compiled
    """Begin the episode of one fleet that `GridBlock.begin` has put in its place, and observe it."""
    floor, tables, rows = Floor(*floor_arrays), TrafficTables(*table_arrays), BlockRows(*block[4])
    stepping = Stepping(*stepping_arrays)
    fleet = fleet_at(block[0], block[1], block[2], block[3], rows, b)
    turn(floor, fleet, stepping.first, rows.now[b])
    _give_out(floor, fleet, stepping.first, rows.now[b])
    _observe(floor, FloorTold(*told_arrays), fleet, tables, stepping, CellMemory(*cell_arrays), rows.salt[b], b)


@inner
def _wish(
    told: FloorTold,
    fleet: FleetRow,
    tables: TrafficTables,
    memory: TrafficMemory,
    actions: npt.NDArray[np.int64],
    b: int,
) -> None:  # pragma: no cover - compiled
    """Fill in the states that cars wish to go to."""
    state, n_actions = fleet.cars.state, tables.mask.shape[2]
    for car in range(len(state)):
        action = actions[car]
        legal = 0 <= action < n_actions and tables.mask[b, car, action] == 1
        tables.illegal[b, car] = not legal
        memory.wanted[car] = told.move_to[state[car], action - 1] if legal and action > 0 else state[car]


@inner
def _judge(
    told: FloorTold,
    fleet: FleetRow,
    tables: TrafficTables,
    memory: TrafficMemory,
    after: Ints,
    weights: tuple[float, float, float, float, float],
    b: int,
) -> None:  # pragma: no cover - compiled
    """Fill in the terms that follow from wishes and moves, and what became of the wishes, as `TrafficEnv` has them."""
    cars, locked, wanted, asked = fleet.cars, fleet.locked, memory.wanted, memory.asked
    state, goal, terms, cell = cars.state, cars.goal, tables.terms[b], told.state_cell
    for car in range(len(state)):
        if wanted[car] != state[car]:
            asked[cell[wanted[car]]] = True
    for car in range(len(state)):
        granted, stands = after[car] == wanted[car], after[car] == state[car]
        gain, row = np.int64(0), np.int32(NONE)
        if goal[car] != NONE:
            row = told.goal_row[goal[car]]
        if row != NONE and told.distance[row, after[car]] < UNREACHABLE:
            gain = np.int64(told.distance[row, state[car]]) - np.int64(told.distance[row, after[car]])
        terms[car, 0] = weights[0] * gain
        terms[car, 2] = weights[2] * (stands and state[car] != goal[car] and not locked[car])
        terms[car, 3] = weights[3] * (not granted)
        terms[car, 4] = weights[4] * (stands and granted and not locked[car] and asked[cell[state[car]]])
        tables.waits[b, car] = stands and not granted
        tables.pushed[b, car] = not stands and not granted
    for car in range(len(state)):
        asked[cell[wanted[car]]] = False


@inner
def _give_out(floor: Floor, fleet: FleetRow, first: Ints, now: int) -> None:  # pragma: no cover - compiled
    """Give the ready tasks to the nearest free cars."""
    kernel.assign_nearest(floor, fleet.cars, fleet.tasks, fleet.stations, STATION_ROOM, now)
    send(floor, fleet, first, now)


@inner
def _observe(
    floor: Floor,
    told: FloorTold,
    fleet: FleetRow,
    tables: TrafficTables,
    stepping: Stepping,
    cells: CellMemory,
    salt: int,
    b: int,
) -> None:  # pragma: no cover - compiled
    """Fill in observations and masks, by the kernel of `TrafficObserver`."""
    cars = fleet.cars
    # What PIBT would do: the timestep that comes if nobody has a wish, of the same chance.
    plan(floor, fleet, stepping, salt + 1, stepping.nobody)
    view = TrafficView(cars.state, cars.goal, cars.phase, cars.held, fleet.locked, fleet.priority, stepping.after)
    rows, mask = tables.rows[b], tables.mask[b]
    rows[:] = 0.0
    mask[:] = 0
    observe(view, told, cells, rows, mask)
