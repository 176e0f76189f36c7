"""Bounds: what could be delivered at most by the cars, the arms and the lanes of a run, and which of them binds."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array

from fleet.arrays import CellArray, FloatArray, IntArray
from fleet.config import Fidelity
from fleet.missions.turns import CHANGE_S
from fleet.run.view import RunView
from fleet.stations.stations import Stations
from fleet.tasks.board import DONE_STATES, Task
from fleet.traffic.drivers import PASS_SPEED_MPS
from maps.lane_graph import LaneGraph
from planners.mapf.distance_table import UNREACHABLE, DistanceTable

HEADWAY_S = 2.35
"""Time from one car to the next in a lane at full speed [s]: what is seen most on a busy floor; 0.4 % of the cars
follow by less than 2.15 s."""
GRID_CHANGE_S, GRID_HEADWAY_S, GRID_MOVE_S = 1.0, 1.0, 1.0
"""The same two on the grid, where a car takes a place a timestep after the one before has left it, and the time of a
move there [s]."""
BOUNDS = ("cars", "arms", "lanes", "orders")
"""What may bind."""
_FAR = 1e6
"""Moves that stand for no way at all: more than any table of distances holds."""


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Deliveries an hour at most, for the mix of deliveries that were made, and each without the other limits."""

    cars_per_h: float
    """Cars never wait: each drives the loaded ways, the shortest empty ways that join them, and stands while it is
    served. With several places in its tray it drives each way for as many parcels."""
    arms_per_h: float
    """Some arm never waits: it serves, and cars change."""
    lanes_per_h: float
    """Across some straight line through the floor, cars follow each other as closely as they can. In the long run as
    many go across it one way as the other, some of them empty."""
    orders_per_h: float | None
    """Orders are delivered as fast as they come; None = all were there from the start."""
    binds: str
    """The least of these: `cars`, `arms`, `lanes` or `orders`."""
    where: str
    """The station whose arm, or the lanes that bind; empty for `cars` and `orders`."""
    delivered_per_h: float
    """What was delivered."""
    share: float
    """Part of the least bound that was."""
    loaded_m: float
    """Shortest way from where a parcel is picked to where it is dropped, mean [m]."""
    empty_m: float
    """Shortest way from a drop to the next pick, mean, if cars were sent as well as can be [m]."""

    @property
    def per_h(self) -> float:
        """The least bound."""
        found: float = getattr(self, f"{self.binds}_per_h")
        return found

    def __str__(self) -> str:
        by = f"{self.binds} ({self.where})" if self.where else self.binds
        return f"{by}: at most {self.per_h:.0f} deliveries an hour, of which {100.0 * self.share:.0f} % were made"


class CrossLine(NamedTuple):
    """A straight line through the floor, and how many cars cross it."""

    words: str
    n_lanes: int
    """Lanes across it in one direction."""
    n_crossings: int
    """Times that cars have to cross it that way."""


def deliveries_of(tasks: Iterable[Task], stations: Stations) -> IntArray:
    """Deliveries that were made from each station to each other one, shape (n_stations, n_stations)."""
    deliveries = np.zeros((len(stations), len(stations)), dtype=np.int64)
    for task in tasks:
        if task.state in DONE_STATES and task.visit is None:
            deliveries[stations.named(task.pick).arm, stations.named(task.delivery.drop).arm] += 1
    return deliveries


def bounds_of(run: RunView, deliveries: IntArray, time_s: float, *, from_start: bool) -> Bounds | None:
    """What could have been delivered.

    Args:
        run: The run.
        deliveries: Those made in some time, shape (n_stations, n_stations).
        time_s: How long it took [s].
        from_start: Whether that is the run from its start, when cars came from their parking places, or a part of it.

    Returns:
        The bounds; None if nothing was delivered.
    """
    n = int(deliveries.sum())
    if not n or time_s <= 0.0:
        return None
    stations, free = run.stations, run.setup.distances.exact
    service_s = stations.mean_s()
    starts = run.setup.start_states % run.graph.n_places if from_start else np.empty(0, dtype=np.int32)
    loaded = float((moves_between(free, stations.dock_states, stations.dock_states) * deliveries).sum())
    empty = fewest_empty_moves(free, stations.dock_states, deliveries, starts)
    served_s = float(((service_s[:, None] + service_s[None, :]) * deliveries).sum())
    on_grid = run.config.fidelity is Fidelity.GRID
    change_s, headway_s = (GRID_CHANGE_S, GRID_HEADWAY_S) if on_grid else (CHANGE_S, HEADWAY_S)
    # A car on the grid is there as soon as its last move begins: each way, loaded or empty, takes one move less.
    n_saved = min(loaded, n) + min(empty, n) if on_grid else 0
    move_m = run.site.grid.cell_m
    move_s = GRID_MOVE_S if on_grid else move_m / PASS_SPEED_MPS
    driven_s = (loaded + empty - n_saved) * move_s
    parcels = run.scene.cars.parcels_at_a_time(fill_trays=run.config.allocation.fill_trays)
    needed_s = driven_s / parcels + served_s

    cycle_s = np.maximum(service_s + change_s, stations.least_cycle_s(run.config.collect_after_s))
    visits = deliveries.sum(axis=0) + deliveries.sum(axis=1)
    arm = int(np.argmax(cycle_s * visits))
    line = narrowest(lines_of(run.graph, run.site.grid.cols, stations.dock_states, deliveries))
    per_h = {
        "cars": 3600.0 * n * float((1.0 / needed_s).sum()),
        "arms": 3600.0 * n / float(cycle_s[arm] * visits[arm]),
        "lanes": math.inf if line is None else 3600.0 * n * line.n_lanes / (headway_s * line.n_crossings),
        "orders": _orders_per_h(run),
    }
    binds = min(per_h, key=lambda name: per_h[name])
    where = {"arms": stations[arm].name, "lanes": "" if line is None else line.words}
    delivered_per_h = 3600.0 * n / time_s
    return Bounds(
        cars_per_h=round(per_h["cars"], 1),
        arms_per_h=round(per_h["arms"], 1),
        lanes_per_h=round(per_h["lanes"], 1),
        orders_per_h=round(per_h["orders"], 1) if math.isfinite(per_h["orders"]) else None,
        binds=binds,
        where=where.get(binds, ""),
        delivered_per_h=round(delivered_per_h, 1),
        share=round(delivered_per_h / per_h[binds], 4),
        loaded_m=round(move_m * loaded / n, 2),
        empty_m=round(move_m * empty / n, 2),
    )


def moves_between(table: DistanceTable, states: CellArray, goals: CellArray) -> FloatArray:
    """Fewest moves from each state to each goal, shape (n_states, n_goals)."""
    rows, row = table.rows(goals)
    moves = rows[row[None, :], states[:, None]].astype(np.float64)
    return np.where(moves >= UNREACHABLE, _FAR, moves)


def fewest_empty_moves(table: DistanceTable, docks: CellArray, deliveries: IntArray, starts: CellArray) -> float:
    """Fewest moves that cars have to make without a parcel.

    Each delivery needs a car that comes from its start, or from the end of another delivery: a transportation problem,
    solved as a linear program. Source: F. L. Hitchcock, "The distribution of a product from several sources to
    numerous localities", Journal of Mathematics and Physics 20, 1941.

    Args:
        table: Distances.
        docks: State of each station's dock, shape (n_stations,).
        deliveries: Deliveries from each station to each other one, shape (n_stations, n_stations).
        starts: Where cars stand at first, shape (n,); empty = cars have made deliveries before.
    """
    picks, drops = deliveries.sum(axis=1), deliveries.sum(axis=0)
    to, ended = np.flatnonzero(picks), np.flatnonzero(drops)
    sources = np.concatenate((docks[ended], starts))
    cars = np.concatenate((drops[ended], np.ones(len(starts), dtype=np.int64)))
    moves = moves_between(table, sources, docks[to])
    shape, n = moves.shape, moves.size
    source, goal = (index.ravel() for index in np.indices(shape))
    ones, each = np.ones(n), np.arange(n)
    found = linprog(
        moves.ravel(),
        A_ub=csr_array((ones, (source, each)), shape=(shape[0], n)),
        b_ub=cars,
        A_eq=csr_array((ones, (goal, each)), shape=(shape[1], n)),
        b_eq=picks[to],
        method="highs",
    )
    return float(found.fun)


def lines_of(graph: LaneGraph, cols: int, docks: CellArray, deliveries: IntArray) -> list[CrossLine]:
    """All straight lines between rows and between columns that cars have to cross, in both directions.

    Args:
        graph: Lanes.
        cols: Columns of the floor.
        docks: State of each station's dock, shape (n_stations,).
        deliveries: Deliveries from each station to each other one, shape (n_stations, n_stations).
    """
    lines = []
    cells = graph.state_cell[graph.move_from], graph.state_cell[graph.move_to]
    axes = (("columns", "eastward", "westward"), ("rows", "southward", "northward"))
    for (what, up, down), of in zip(axes, (lambda cell: cell % cols, lambda cell: cell // cols), strict=True):
        before, after, dock = of(cells[0]), of(cells[1]), of(graph.state_cell[docks])
        for at in range(1, int(max(before.max(), after.max())) + 1):
            forth = int(deliveries[np.ix_(dock < at, dock >= at)].sum())
            back = int(deliveries[np.ix_(dock >= at, dock < at)].sum())
            # Cars that went across come back, empty if need be.
            crossings = max(forth, back)
            if not crossings:
                continue
            for way, crosses in ((up, (before < at) & (after >= at)), (down, (before >= at) & (after < at))):
                lanes = len(np.unique(cells[1][crosses]))
                where = f"{lanes} lane{'s' if lanes > 1 else ''} {way} between {what} {at - 1} and {at}"
                lines.append(CrossLine(where, lanes, crossings))
    return lines


def narrowest(lines: Iterable[CrossLine]) -> CrossLine | None:
    """The line that has the fewest lanes for those that cross it; None if nobody has to cross any."""
    return min(lines, key=lambda line: line.n_lanes / line.n_crossings, default=None)


def _orders_per_h(run: RunView) -> float:
    """Deliveries that came in, by the time in which they did."""
    releases_s = [task.order.release_s for task in run.board.tasks if task.visit is None]
    last_s = max(release_s for release_s in releases_s if release_s <= run.sim_s)
    n = sum(release_s <= run.sim_s for release_s in releases_s)
    return 3600.0 * n / last_s if last_s > 0.0 else math.inf
