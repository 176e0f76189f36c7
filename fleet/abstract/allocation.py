"""Allocation: an allocator gives the tasks of an abstract fleet to its cars."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.abstract.compiled import compiled
from fleet.abstract.fleet import STATION_ROOM, TIMESTEP_S, GridFleet
from fleet.abstract.kernel import FREE, NEVER, READY, Floor, Ints, StationTable, TaskTable
from fleet.arrays import FloatArray
from fleet.config import AllocationConfig
from fleet.dispatch.allocation import MOST_ASKED
from fleet.dispatch.offers import N_SPARE, share_of
from fleet.dispatch.situation import in_turn
from fleet.errors import ConfigError
from planners.allocation.costs import CostWeights, task_costs
from planners.allocation.problem import AllocationProblem, Allocator
from planners.mapf.distance_table import UNREACHABLE

AT_ONCE = ("greedy", "hungarian", "fifo")
"""Allocators that give cars one task at a time."""


class Room(NamedTuple):
    """What stations have room for, shape (k,) each."""

    most: Ints
    """Tasks under way at once, at most."""
    left: Ints
    """More of them now; working memory."""


class Lines(NamedTuple):
    """How the tasks of each pick station stand in line, the most urgent class first."""

    first: Ints
    """The first of each station in the lines, shape (k + 1,)."""
    by_age: Ints
    by_due: Ints
    """Tasks, station by station, shape (m,); those without a due date come last by it."""
    head: Ints
    """The first of each station that no car has, in either line, shape (2, k)."""
    seen: Ints
    """Round in which each task was last looked at, shape (m,)."""
    round: Ints
    """Number of the round, shape (1,)."""


class OfferTable(NamedTuple):
    """Tasks on offer, at least as long as the table of tasks."""

    task: Ints
    begin: Ints
    """Timesteps before which the pick station cannot begin with it, because of those before it."""


class AbstractAllocation:
    """Gives ready tasks to cars without one, in every timestep, at the costs of whole runs; cars keep what they have.

    Args:
        config: The allocator and what things are worth.
        fleet: The fleet.

    Raises:
        ConfigError, PlanningError: See `make_allocator`.
    """

    def __init__(self, config: AllocationConfig, fleet: GridFleet) -> None:
        self._allocator = make_allocator(config)
        self._weights = CostWeights(config.lateness, config.ageing, config.due)
        self._fleet = fleet
        floor = fleet.place.floor
        self._service_s = _seconds(floor.load_steps[fleet.tasks.pick] + floor.unload_steps[fleet.tasks.drop])
        k, m = len(floor.dock_state), len(fleet.tasks.stage)
        self._room = Room(
            # So many tasks under way keep an arm busy until who is farthest off has come.
            most=np.maximum(STATION_ROOM, fleet.place.far_steps // floor.cycle_steps + 1).astype(np.int32),
            left=np.empty(k, dtype=np.int32),
        )
        self._lines = _lines(fleet.tasks, k)
        self._offer = OfferTable(task=np.empty(m, dtype=np.int32), begin=np.empty(m, dtype=np.int32))
        self._n_picks = len(fleet.place.site.station_names("pick"))
        self._turn = 0

    def give_out(self) -> None:
        """Give out what can be given out now, and send the cars on their way."""
        fleet = self._fleet
        cars = self._asked()
        if not len(cars):
            return
        most = share_of(len(cars), self._n_picks) + N_SPARE
        n = _find_offers(fleet.place.floor, fleet.tasks, fleet.stations, self._lines, self._room, most, self._offer)
        if n == 0:
            return
        tasks, begin = self._offer.task[:n], self._offer.begin[:n]
        taken = self._allocator.allocate(self._problem(cars, tasks, begin))
        for row, column in taken.pairs.tolist():
            task = int(tasks[column])
            if fleet.tasks.stage[task] == READY:  # it is not when the order is had from another station
                fleet.assign(int(cars[row]), task)
        if len(taken.pairs):
            fleet.direct()

    def _asked(self) -> npt.NDArray[np.intp]:
        """The cars without a task, at most `MOST_ASKED`, others in each round."""
        free = np.flatnonzero(self._fleet.cars.phase == FREE)
        if len(free) <= MOST_ASKED:
            return free
        asked = np.sort(in_turn(free, MOST_ASKED, self._turn))
        self._turn += 1
        return asked

    def _problem(self, cars: npt.NDArray[np.intp], tasks: Ints, begin: Ints) -> AllocationProblem:
        grid = self._fleet
        floor, table, now_s = grid.place.floor, grid.tasks, grid.now * TIMESTEP_S
        pick, due = table.pick[tasks], table.due[tasks]
        # Stations are fewer than tasks: the way to each is looked up once for each car.
        at, column = np.unique(pick, return_inverse=True)
        moves = floor.distance[floor.dock_row[at][:, None], grid.cars.state[cars]]
        ways_s = np.where(moves == UNREACHABLE, np.inf, moves * TIMESTEP_S)
        rest = floor.distance[floor.dock_row[table.drop[tasks]], floor.dock_state[pick]]
        since_s = _seconds(table.release[tasks])
        costs = task_costs(
            # Who comes before its turn waits for it.
            travel_s=np.maximum(ways_s[column], begin[:, None] * TIMESTEP_S).T,
            rest_s=_seconds(rest),
            service_s=self._service_s[tasks],
            since_s=since_s,
            due_s=np.where(due == NEVER, np.inf, due * TIMESTEP_S),
            now_s=now_s,
            weights=self._weights,
        )
        return AllocationProblem(cost=costs.cost_s, class_of=table.rank[tasks].astype(np.int32), since_s=since_s)


def make_allocator(config: AllocationConfig) -> Allocator:
    """The allocator that is named, if abstract runs can ask it.

    Raises:
        ConfigError: See `require_at_once`.
        PlanningError: There is no such allocator, or it has no such settings.
    """
    allocator = config.make_allocator()
    require_at_once(config.allocator, allocator)
    return allocator


def require_at_once(name: str, allocator: Allocator) -> None:
    """Refuse an allocator that abstract runs cannot ask.

    Raises:
        ConfigError: It plans ahead.
    """
    if getattr(allocator, "plans_ahead", False):
        raise ConfigError(
            f"allocator {name} plans ahead; valid with --fidelity abstract: {', '.join(AT_ONCE)}, "
            "or one of your own that does not"
        )


def _seconds(steps: npt.NDArray[np.integer[Any]]) -> FloatArray:
    return steps.astype(np.float64) * TIMESTEP_S


def _lines(tasks: TaskTable, n_stations: int) -> Lines:
    """Let the tasks of each pick station stand in line."""
    by_age, by_due = (np.lexsort((key, tasks.rank, tasks.pick)) for key in (tasks.release, tasks.due))
    first = np.searchsorted(tasks.pick[by_age], np.arange(n_stations + 1))
    return Lines(
        first=first.astype(np.int32),
        by_age=by_age.astype(np.int32),
        by_due=by_due.astype(np.int32),
        head=np.repeat(first[None, :-1], 2, axis=0).astype(np.int32),
        seen=np.zeros(len(by_age), dtype=np.int32),
        round=np.zeros(1, dtype=np.int32),
    )


@compiled
def _find_offers(
    floor: Floor, tasks: TaskTable, stations: StationTable, lines: Lines, room: Room, most: int, offer: OfferTable
) -> int:  # pragma: no cover - compiled
    """Fill in the ready tasks that may be given out, the most urgent of each station; returns how many.

    At each station the one that is due first and the oldest take turns, as in whole runs.

    Args:
        floor: What never changes.
        tasks: The tasks.
        stations: The stations.
        lines: How the tasks stand in line.
        room: What stations have room for.
        most: Tasks of one pick station that are offered at once.
        offer: Receives the tasks.
    """
    for station in range(len(room.left)):
        room.left[station] = room.most[station] - stations.under_way[station]
    lines.round[0] += 1
    n = 0
    for pick in range(len(room.left)):
        end = lines.first[pick + 1]
        for line, order in enumerate((lines.by_age, lines.by_due)):
            while lines.head[line, pick] < end and tasks.stage[order[lines.head[line, pick]]] > READY:
                lines.head[line, pick] += 1
        oldest, due = lines.head[0, pick], lines.head[1, pick]
        n_here, is_due = 0, True
        while n_here < most and room.left[pick] > 0 and (oldest < end or due < end):
            if due < end and (is_due or oldest >= end):
                task = lines.by_due[due]
                due += 1
            else:
                task = lines.by_age[oldest]
                oldest += 1
            if tasks.stage[task] != READY or lines.seen[task] == lines.round[0]:
                continue
            lines.seen[task] = lines.round[0]
            is_due = not is_due
            if room.left[tasks.drop[task]] > 0:
                offer.task[n] = task
                offer.begin[n] = (stations.under_way[pick] + n_here) * floor.cycle_steps[pick]
                room.left[pick] -= 1
                room.left[tasks.drop[task]] -= 1
                n_here += 1
                n += 1
    return n
