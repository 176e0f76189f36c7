"""GridBlock: many fleets on one floor, side by side in arrays with a leading axis.

The kernels of `fleet.abstract.kernel` are called for one fleet after the other, on rows of these arrays: so a fleet of
a block goes the same way as a `GridFleet`, to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.abstract import kernel
from fleet.abstract.compiled import inner
from fleet.abstract.fleet import FleetSite, cars_at_start, spot_users_at_start, tasks_of
from fleet.abstract.kernel import Bools, CarTable, Counts, Floor, Ints, StationTable, TaskTable
from fleet.tasks.order import Delivery
from planners.mapf.inheritance import claims_of
from planners.mapf.options import options_of
from planners.mapf.pibt import decide

_MORE = 1.25
"""Room for tasks, as a multiple of those of the episode that first needed more room."""


class BlockRows(NamedTuple):
    """What a fleet has besides its tables, for B fleets of n cars on a floor of p parking places."""

    spot_user: Ints
    """Car whose own each parking place is, or `NONE`, shape (B, p)."""
    priority: npt.NDArray[np.float64]
    """Larger goes first in the next timestep, shape (B, n)."""
    locked: Bools
    """Cars that do not move in it, shape (B, n)."""
    order: Ints
    """Cars in the order of an earlier timestep, the first in front, shape (B, n)."""
    salt: npt.NDArray[np.int64]
    """State of the tie-breaking of PIBT, shape (B,)."""
    dice: npt.NDArray[np.int64]
    """Source of breakdowns, shape (B,)."""
    now: npt.NDArray[np.int64]
    """Timesteps that have passed, shape (B,)."""
    n_tasks: npt.NDArray[np.int64]
    """Tasks of the episode, shape (B,); what is behind them in the table of tasks means nothing."""


class FleetRow(NamedTuple):
    """One fleet of a block: rows of its arrays, not copies."""

    cars: CarTable
    tasks: TaskTable
    stations: StationTable
    counts: Counts
    spot_user: Ints
    priority: npt.NDArray[np.float64]
    locked: Bools
    order: Ints


class Stepping(NamedTuple):
    """What PIBT needs for one timestep, and memory that one thread works in."""

    options: tuple[Any, ...]
    claims: tuple[Any, ...]
    keys: npt.NDArray[np.int64]
    state_cell: Ints
    after: Ints
    """Receives the states after the timestep, shape (n,)."""
    first: Ints
    """Working memory of `kernel.direct`, shape (k,)."""
    nobody: Ints
    """Wishes of nobody, shape (0,)."""


class GridBlock:
    """B fleets of n cars on one floor.

    Args:
        place: The site.
        n_cars: Cars of each fleet, at most the parking places.
        n_fleets: B.
    """

    def __init__(self, place: FleetSite, n_cars: int, n_fleets: int) -> None:
        self.place = place
        self._names = [station.name for station in place.site.stations]
        self._start = cars_at_start(place.floor, n_cars)
        self._spots = spot_users_at_start(place.floor, n_cars)
        k = len(self._names)
        self.cars = CarTable(*_repeated(self._start, n_fleets))
        self.tasks = TaskTable(*_repeated(tasks_of((), []), n_fleets))
        self.stations = StationTable(*np.zeros((3, n_fleets, k), dtype=np.int32))
        self.counts = Counts(*_repeated(Counts.of(n_cars, np.int32), n_fleets))
        self.rows = BlockRows(
            spot_user=np.repeat(self._spots[None], n_fleets, axis=0),
            priority=np.zeros((n_fleets, n_cars)),
            locked=np.zeros((n_fleets, n_cars), dtype=np.bool_),
            order=np.repeat(np.arange(n_cars, dtype=np.int32)[None], n_fleets, axis=0),
            salt=np.zeros(n_fleets, dtype=np.int64),
            dice=np.zeros(n_fleets, dtype=np.int64),
            now=np.zeros(n_fleets, dtype=np.int64),
            n_tasks=np.zeros(n_fleets, dtype=np.int64),
        )

    @property
    def capacity(self) -> int:
        """Tasks of one fleet that there is room for."""
        return int(self.tasks.stage.shape[1])

    def arrays(self) -> tuple[tuple[Any, ...], ...]:
        """All of it for `fleet_at`, as plain tuples, which numba takes faster than those with names."""
        return tuple(self.cars), tuple(self.tasks), tuple(self.stations), tuple(self.counts), tuple(self.rows)

    def begin(self, index: int, orders: Sequence[Delivery], seed: int) -> None:
        """Put a fleet where its episode begins, as `GridFleet` does, before its first `turn`.

        Args:
            index: Which fleet.
            orders: Deliveries, ascending in release.
            seed: Seed of the tie-breaking of PIBT, and of breakdowns.
        """
        tasks = tasks_of(orders, self._names)
        n = len(tasks.stage)
        if n > self.capacity:
            self._make_room(int(_MORE * n))
        _set_row(self.tasks, index, tasks)
        _set_row(self.cars, index, self._start)
        for group in (self.stations, self.counts):
            for table in group:
                table[index] = 0
        rows = self.rows
        rows.spot_user[index] = self._spots
        # As `Stepper` draws it.
        rows.salt[index] = np.random.default_rng(seed).integers(2**62)
        rows.dice[index] = seed
        rows.now[index], rows.n_tasks[index] = 0, n

    def stepping(self) -> Stepping:
        """Memory for one thread."""
        graph, n_cars = self.place.graph, len(self._start.state)
        options = options_of(graph, np.zeros(graph.n_cells, dtype=np.bool_))
        return Stepping(
            options=tuple(options),
            claims=tuple(claims_of(options, graph.n_cells, n_cars)),
            keys=np.empty((n_cars, options.widest + 1), dtype=np.int64),
            state_cell=graph.state_cell,
            after=np.empty(n_cars, dtype=np.int32),
            first=np.empty(len(self._names), dtype=np.int32),
            nobody=np.empty(0, dtype=np.int32),
        )

    def _make_room(self, capacity: int) -> None:
        window = self.tasks.window
        more = ((0, 0), (0, capacity - self.capacity))
        longer: list[Any] = [np.pad(table, more) for table in self.tasks]
        self.tasks = TaskTable(*longer)._replace(window=window)


def _repeated(table: Iterable[npt.NDArray[Any]], n: int) -> list[Any]:
    """Arrays with a leading axis, along which they are all alike."""
    return [np.repeat(array[None], n, axis=0) for array in table]


def _set_row(table: Iterable[npt.NDArray[Any]], index: int, rows: Iterable[npt.NDArray[Any]]) -> None:
    """Make the rows of one fleet begin with those of another table."""
    for array, row in zip(table, rows, strict=True):
        array[index, : len(row)] = row


@inner
def fleet_at(
    cars: tuple[Any, ...],
    tasks: tuple[Any, ...],
    stations: tuple[Any, ...],
    counts: tuple[Any, ...],
    rows: BlockRows,
    b: int,
) -> FleetRow:  # pragma: no cover - compiled
    """One fleet of the arrays of a block."""
    (state, phase, held, booked, task, station, spot, charger, charge, left, bound, since, goal, row) = cars
    (release, due, pick, drop, rank, stage, car, done, order, window) = tasks
    n = rows.n_tasks[b]
    return FleetRow(
        CarTable(
            state[b],
            phase[b],
            held[b],
            booked[b],
            task[b],
            station[b],
            spot[b],
            charger[b],
            charge[b],
            left[b],
            bound[b],
            since[b],
            goal[b],
            row[b],
        ),
        TaskTable(
            release[b, :n],
            due[b, :n],
            pick[b, :n],
            drop[b, :n],
            rank[b, :n],
            stage[b, :n],
            car[b, :n],
            done[b, :n],
            order[b, :n],
            window[b],
        ),
        StationTable(stations[0][b], stations[1][b], stations[2][b]),
        Counts(counts[0][b], counts[1][b], counts[2][b], counts[3][b]),
        rows.spot_user[b],
        rows.priority[b],
        rows.locked[b],
        rows.order[b],
    )


@inner
def turn(floor: Floor, fleet: FleetRow, first: Ints, now: int) -> None:  # pragma: no cover - compiled
    """Everything that happens between two moves."""
    kernel.serve(floor, fleet.cars, fleet.tasks, fleet.stations, fleet.counts, now)
    kernel.release(fleet.tasks, fleet.counts, now)
    send(floor, fleet, first, now)


@inner
def send(floor: Floor, fleet: FleetRow, first: Ints, now: int) -> None:  # pragma: no cover - compiled
    """Give every car its goal, and its rank in the right of way."""
    kernel.direct(floor, fleet.cars, fleet.stations, fleet.spot_user, first, now)
    kernel.rank_cars(floor, fleet.cars, fleet.tasks, now, fleet.priority, fleet.locked)


@inner
def plan(
    floor: Floor, fleet: FleetRow, stepping: Stepping, salt: int, wished: Ints
) -> None:  # pragma: no cover - compiled
    """Fill in `stepping.after`: where PIBT lets every car go in the next timestep.

    Args:
        floor: What never changes.
        fleet: The fleet.
        stepping: Memory of the thread.
        salt: State of the tie-breaking, one more than before the timestep.
        wished: State that each car prefers, shape (n,), or nobody's, (0,).
    """
    put_in_order(fleet.priority, fleet.order)
    cars = fleet.cars
    wishes = (floor.distance, cars.row, fleet.order, fleet.locked, False, wished)
    decide(
        stepping.options, wishes, stepping.claims, stepping.keys, stepping.state_cell, salt, cars.state, stepping.after
    )


@inner
def put_in_order(priority: npt.NDArray[np.float64], order: Ints) -> None:  # pragma: no cover - compiled
    """Sort cars by priority, larger first, of equal ones the lower index first.

    From one timestep to the next few cars change their places, as all that wait gain alike: so by insertion.
    """
    for place in range(1, len(order)):
        car, k = order[place], place
        own = priority[car]
        while k > 0:
            before = order[k - 1]
            if priority[before] > own or (priority[before] == own and before < car):
                break
            order[k] = before
            k -= 1
        order[k] = car
