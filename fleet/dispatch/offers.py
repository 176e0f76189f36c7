"""Offers: tasks that may be given out now, and the time before which their stations cannot begin with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.config import AllocationConfig
from fleet.dispatch.cost_model import CostMatrix
from fleet.dispatch.fitness import Fitness
from fleet.missions.state import Missions
from fleet.missions.turns import TakenTurns, first_turn, next_turns
from fleet.missions.visit_queue import VisitQueue
from fleet.missions.visit_routes import VisitRoutes
from fleet.missions.ways import MOVE_S, Ways
from fleet.tasks.board import Task
from fleet.tasks.open_deliveries import OpenDeliveries, by_due
from planners.mapf.distance_table import UNREACHABLE

N_EXCHANGED = 8
"""Deliveries of each station that cars may exchange theirs for. Fewer cost throughput: with none, 300 cars on 60 x 100
cells deliver 4 % less."""
N_SPARE = 3
"""So many more deliveries of each station are offered than cars could take, for some choice of where they go."""


def share_of(n_free: int, n_stations: int) -> int:
    """Twice the share of one of some pick stations in the cars that have no task, at most all of them."""
    return min(n_free, -(-2 * n_free // max(1, n_stations)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Offer:
    """Tasks on offer."""

    tasks: list[Task]
    not_before_s: npt.NDArray[np.float64]
    """Time before which a station cannot begin with each, because those before it come first, shape (n_tasks,) [s]."""


class Offers:
    """Says which tasks may be given out.

    However many deliveries wait, of each station only so many are looked at as cars could take before the furthest of
    them arrives, and no more than twice its share of the cars that have none, and some for those that have one.

    Args:
        missions: Tells of stations.
        ways: How far cars are.
        routes: Room at the places of visits.
        fitness: Which cars can do what.
        open_deliveries: Deliveries that no car has.
        visit_queue: Visits that no car has.
        config: When drop stations are busy.
    """

    def __init__(
        self,
        missions: Missions,
        ways: Ways,
        routes: VisitRoutes,
        fitness: Fitness,
        open_deliveries: OpenDeliveries,
        visit_queue: VisitQueue,
        config: AllocationConfig,
    ) -> None:
        self._stations = missions.stations
        self._ways = ways
        self._routes = routes
        self._fitness = fitness
        self._open = open_deliveries
        self._visit_queue = visit_queue
        self._loading = missions.stations.loading()
        self._config = config
        self._docks = np.array([station.dock_state for station in self._loading], dtype=np.int32)

    def change(self, config: AllocationConfig) -> None:
        """Go on with other settings."""
        self._config = config

    def of(
        self,
        cars: npt.NDArray[np.intp],
        n_held: int,
        states: npt.NDArray[np.int32],
        turns: TakenTurns,
        kept: Set[int] = frozenset(),
    ) -> Offer:
        """Tasks for some cars.

        Args:
            cars: Cars that can take one, ascending, shape (n,).
            n_held: How many of them have one that they may give away.
            states: Lane-graph state in which each can begin, shape (n,).
            turns: Turns that are taken.
            kept: Indices of tasks that are kept for other cars.
        """
        tasks: list[Task] = []
        not_before_s: list[float] = []
        offered: set[int] = set()
        moves = self._ways.moves_to(states, self._docks)
        far_s = MOVE_S * np.where(moves < UNREACHABLE, moves, 0).max(axis=1, initial=0)
        busy = self._busy_drops(turns, float(far_s.max(initial=0.0)))
        share = share_of(len(cars) - n_held, len(self._loading)) + min(n_held, N_EXCHANGED)
        fits: dict[int, bool] = {}

        def fits_any(task: Task) -> bool:
            if task.index not in fits:  # a task is offered by all stations that have it
                fits[task.index] = self._fitness.fits_any(task, cars)
            return fits[task.index]

        for station, longest_s in zip(self._loading, far_s.tolist(), strict=True):
            if not self._stations.is_open(station.name):
                continue
            n_turns = int(longest_s / turns.pace.cycle_s[station.arm]) + 1
            urgent = self._open.urgent(station.name, fits_any)
            most = min(share, n_turns) + N_SPARE
            here = self._first((task for task in urgent if task.index not in kept), most, fits_any, busy)
            # Those that are due first are to be done first, so the others are begun after them.
            here.sort(key=by_due)
            begin_s = next_turns(turns, station.arm, len(here)).tolist()
            for task in here:
                if task.index in offered:
                    continue
                if task.pick_slot is None:
                    task.pick = self._best_source(task, turns)
                if task.pick == station.name:
                    offered.add(task.index)
                    tasks.append(task)
                    # Who nobody can do at present takes no turn.
                    not_before_s.append(begin_s.pop(0) if fits_any(task) else 0.0)
        visits = self._visit_queue.ready()
        return Offer(tasks=[*tasks, *visits], not_before_s=np.array([*not_before_s, *(0.0 for _ in visits)]))

    def with_room(self, costs: CostMatrix, n: int) -> tuple[list[int], set[int]]:
        """Which of the first tasks can be given out.

        Args:
            costs: What they cost.
            n: How many they are.

        Returns:
            Columns of those that a car can take, the most urgent first, and of visits that wait for room at a place.
        """
        rooms: dict[int, int] = {}
        offered: list[int] = []
        full: set[int] = set()
        wanted = costs.wanted[:n].nonzero()[0].tolist()
        wanted.sort(key=lambda k: (costs.tasks[k].order.rank, -costs.pressure_s[k], costs.tasks[k].index))
        for k in wanted:
            task = costs.tasks[k]
            if task.visit is None or self._routes.take_room(task, rooms):
                offered.append(k)
            else:
                full.add(k)
        return offered, full

    def _busy_drops(self, turns: TakenTurns, far_s: float) -> set[str]:
        """The stations whose arms have so much to do that who sets off for them now would wait there for long."""
        work_s = np.diff(turns.first) * turns.pace.cycle_s
        return {self._stations[arm].name for arm in (work_s > far_s + self._config.busy_s).nonzero()[0].tolist()}

    def _first(self, urgent: Iterator[Task], most: int, fits_any: Callable[[Task], bool], busy: Set[str]) -> list[Task]:
        """The first so many that one of some cars can do, and those before them, which nobody can do at present.

        Of those that go to busy drop stations there are as many besides: else the oldest tasks were all for a station
        that has too much to do already, and none for those that have nothing.
        """
        found: list[Task] = []
        left = {False: most, True: most}
        for task in urgent:
            drop = task.delivery.drop
            is_busy = drop in busy
            if not self._stations.is_open(drop) or left[is_busy] == 0:
                continue
            found.append(task)
            left[is_busy] -= fits_any(task)
            if left[False] == 0:
                break
        return found

    def _best_source(self, task: Task, turns: TakenTurns) -> str:
        """The pick station from which a task would be done soonest; of equal ones, the first that was named."""
        picks = task.delivery.picks
        if len(picks) > 1:
            picks = tuple(name for name in picks if self._stations.is_open(name)) or picks
        if len(picks) == 1:
            return picks[0]
        drop = self._stations.named(task.delivery.drop)

        def takes_s(name: str) -> float:
            station = self._stations.named(name)
            comes_s = MOVE_S * float(self._ways.moves(self._ways.tails, station.dock_state).min())
            n_moves_on = self._ways.between(station.dock_state, drop.dock_state)
            return first_turn(turns, station.arm, comes_s) + MOVE_S * n_moves_on

        return min(picks, key=takes_s)
