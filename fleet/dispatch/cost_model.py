"""Costs: what each task costs each car, and which pairs are infeasible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray, IntArray
from fleet.config import AllocationConfig
from fleet.dispatch.fitness import Codes, Fitness
from fleet.dispatch.pair_times import CarSide, TaskSide, pair_times
from fleet.dispatch.situation import CAN_TAKE, Situation
from fleet.missions.charging import Charging
from fleet.missions.state import Missions
from fleet.missions.turns import Booked, free_times
from fleet.missions.visit_routes import VisitRoutes
from fleet.missions.ways import MOVE_S, Ways
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Delivery
from fleet.tasks.reasons import CODE_OF_REASON, PairReason
from planners.allocation.costs import CostWeights, task_costs
from planners.mapf.distance_table import UNREACHABLE

FULL_S = 300.0
"""To charge a car that is full costs so much more than to charge an empty one, as seconds of travel [s]."""
_NO_WAY, _OUT = CODE_OF_REASON[PairReason.NO_WAY], CODE_OF_REASON[PairReason.CAR_OUT]


@dataclass(frozen=True, kw_only=True, eq=False)
class CostMatrix:
    """What each task costs each car, tasks in the columns."""

    now_s: float
    tasks: list[Task]
    cars: npt.NDArray[np.intp]
    """Cars that can take a task at all, ascending, shape (n_able,): what tasks cost the others need not be known."""
    cost_s: npt.NDArray[np.float64]
    """Cost for each of these, shape (n_able, n_tasks); inf = not allowed."""
    codes: npt.NDArray[np.int8]
    """Why a pair is not allowed, as an index into `PAIR_REASONS`; `CAN_TAKE` where it is, shape (n_cars, n_tasks)."""
    pressure_s: FloatArray
    """How much each task presses for being served, the same for all cars, shape (n_tasks,) [s]."""
    states: npt.NDArray[np.int32]
    """Lane-graph state in which each car can begin, shape (n_cars,)."""
    free_s: npt.NDArray[np.float64]
    """Time until it can, shape (n_cars,)."""

    @property
    def wanted(self) -> npt.NDArray[np.bool_]:
        """Whether any car may have each task, shape (n_tasks,)."""
        return np.asarray((self.cost_s < np.inf).any(axis=0))

    def rows_for(self, columns: list[int]) -> npt.NDArray[np.intp]:
        """Rows of the cars that may have any of some tasks, ascending."""
        # Tasks are contiguous, so that whole columns are compared.
        least_s = np.full(len(self.cost_s), np.inf)
        for column in columns:
            np.minimum(least_s, self.cost_s[:, column], out=least_s)
        return np.flatnonzero(least_s < np.inf)

    def of_pair(self, car: int, column: int) -> float:
        """What a task costs a car, inf = not allowed."""
        row = int(np.searchsorted(self.cars, car))
        found = row < len(self.cars) and self.cars[row] == car
        return float(self.cost_s[row, column]) if found else np.inf


class _Work(NamedTuple):
    """What some tasks ask of cars."""

    moves: FloatArray
    """Of each car to where tasks begin, shape (n_rows, n_cars)."""
    begin: IntArray
    """The row of each task, shape (n_tasks,)."""
    pick: IntArray
    """Arm where it begins, -1 = it is a visit, shape (n_tasks,)."""
    drop: IntArray
    """Arm where it ends, the same."""
    n_rest_moves: FloatArray
    """Moves from where it begins on, shape (n_tasks,)."""
    service_s: FloatArray
    """Time at docks or places, shape (n_tasks,) [s]."""


class CostModel:
    """Tells what tasks cost, see `planners.allocation.costs.task_costs`.

    Args:
        config: Ageing, lateness and due dates.
        missions: Stations, and how long their arms take.
        ways: How far cars are from where tasks begin.
        routes: Of visits.
        fitness: What each car can do.
        charging: Tells which cars have the charge for a task; None = all.
    """

    def __init__(
        self,
        config: AllocationConfig,
        missions: Missions,
        ways: Ways,
        routes: VisitRoutes,
        fitness: Fitness,
        charging: Charging | None,
    ) -> None:
        self._config = config
        self._stations = missions.stations
        self._ways = ways
        self._routes = routes
        self._fitness = fitness
        self._charging = charging

    def change(self, config: AllocationConfig) -> None:
        """Go on with other weights."""
        self._config = config

    def of(
        self,
        tasks: list[Task],
        not_before_s: FloatArray,
        situation: Situation,
        booked: Booked,
        soon_s: float,
        now_s: float,
    ) -> CostMatrix:
        """Price tasks.

        Args:
            tasks: The tasks.
            not_before_s: Time before which the pick station of each cannot begin with it, shape (n_tasks,) [s].
            situation: What cars are about.
            booked: The turns that are taken at stations.
            soon_s: Cars that cannot take a task now are counted in if they can in so many seconds [s].
            now_s: Simulated time [s].
        """
        soon = situation.soon(soon_s)
        states = situation.begins(soon_s)
        free_s = np.where(soon, situation.free_s, 0.0)
        out = np.where(soon, CAN_TAKE, situation.standing)
        work = self._work(tasks, states)
        codes = self._codes(tasks, out, work, situation.kept)
        if self._charging is not None:
            for k, task in enumerate(tasks):
                self._refuse_low(self._charging, codes[k], task, work.moves[work.begin[k]])
        column_of = {task.index: k for k, task in enumerate(tasks)}
        own = np.full(len(states), -1)
        own[list(situation.held)] = [column_of[task.index] for task in situation.held.values()]
        cars = np.flatnonzero(out == CAN_TAKE)
        slowness = self._fitness.slowness[cars]
        times = pair_times(
            work.moves[:, cars] * slowness,
            codes[:, cars],
            CarSide(free_s[cars], own[cars], booked.early_s[cars]),
            TaskSide(work.begin, work.pick, work.drop, work.n_rest_moves * MOVE_S, not_before_s),
            free_times(booked.turns),
        )
        rest_s, travel_s = work.n_rest_moves * MOVE_S, times.travel_s
        if (slowness > 1.0).any():
            # Slow cars are later where a task ends, too, which counts as if they came later to where it begins.
            travel_s = travel_s + np.outer(np.minimum(work.n_rest_moves, UNREACHABLE) * MOVE_S, slowness - 1.0)
        cost_s, pressure_s = task_costs(
            travel_s=travel_s.T,
            rest_s=rest_s,
            service_s=work.service_s,
            since_s=np.array([task.since_s[TaskState.BACKLOG] for task in tasks]),
            due_s=np.array([task.order.due_s for task in tasks]),
            now_s=now_s,
            weights=CostWeights(self._config.lateness, self._config.ageing, self._config.due),
        )
        cost_s += times.dear_s.T
        for k, task in enumerate(tasks):
            if task.visit is not None and task.visit.until_full and self._charging is not None:
                cost_s[:, k] += FULL_S * self._charging.batteries.charge[cars]
        return CostMatrix(
            now_s=now_s,
            tasks=tasks,
            cars=cars,
            cost_s=cost_s,
            codes=codes.T,
            pressure_s=pressure_s,
            states=states,
            free_s=free_s,
        )

    def _work(self, tasks: Sequence[Task], states: npt.NDArray[np.int32]) -> _Work:
        """What tasks ask for."""
        n = len(tasks)
        begin, pick, drop = np.empty(n, dtype=np.int64), np.full(n, -1), np.full(n, -1)
        n_rest_moves, service_s = np.empty(n), np.empty(n)
        deliveries, ends = [], []
        rows: list[FloatArray] = []
        for k, task in enumerate(tasks):
            if isinstance(task.order, Delivery):
                deliveries.append(k)
                ends.append((task.pick, task.order.drop))
            else:
                begin[k] = len(rows)
                rows.append(self._routes.to_errand(task, states))
                n_rest_moves[k], service_s[k] = self._routes.rest(task)
        moves = np.array(rows, dtype=np.float64).reshape(len(rows), len(states))
        if deliveries:
            docks, mean_s = self._stations.dock_states, self._stations.mean_s()
            picks, drops = self._stations.arms_of(ends).T
            used, which = np.unique(picks, return_inverse=True)  # many tasks begin at few stations
            begin[deliveries] = len(rows) + which
            moves = np.concatenate((moves, self._ways.moves_to(states, docks[used])))
            pick[deliveries], drop[deliveries] = picks, drops
            n_rest_moves[deliveries] = self._ways.moves_each(docks[picks], docks[drops])
            service_s[deliveries] = mean_s[picks] + mean_s[drops]
        return _Work(moves, begin, pick, drop, n_rest_moves, service_s)

    def least_s(self, task: Task, move_s: float) -> float:
        """The time from the best pick station to the delivery, or from the first place of a visit to its end [s].

        Nobody is in the way, and arms take as long as usual. It is inf if there is no way.

        Args:
            task: The task.
            move_s: Time of one move at full speed [s].
        """
        if task.visit is not None:
            n_rest_moves, stand_s = self._routes.rest(task)
            return n_rest_moves * move_s + stand_s if n_rest_moves < UNREACHABLE else np.inf
        order = task.delivery
        return min(self._from_pick_s(pick, order.drop, move_s) for pick in order.picks)

    def _from_pick_s(self, pick: str, drop: str, move_s: float) -> float:
        """Time from a pick station to the delivery [s]."""
        moves = self._moves(pick, drop)
        return moves * move_s + self._service_s(pick, drop) if moves < UNREACHABLE else np.inf

    def _moves(self, pick: str, drop: str) -> int:
        return self._ways.between(self._stations.named(pick).dock_state, self._stations.named(drop).dock_state)

    def _service_s(self, pick: str, drop: str) -> float:
        """Time at both docks [s]."""
        named, time = self._stations.named, self._stations.time
        return time(named(pick)).mean_s + time(named(drop)).mean_s

    def _codes(self, tasks: Sequence[Task], out: Codes, work: _Work, kept: Mapping[int, Task]) -> Codes:
        """Why each car cannot take each task, `CAN_TAKE` for those that can; what lasts longest counts first.

        Returns:
            Indices into `PAIR_REASONS`, shape (n_tasks, n_cars).
        """
        no_way = (work.moves >= UNREACHABLE)[work.begin] | (work.n_rest_moves >= UNREACHABLE)[:, None]
        codes = np.where(no_way, np.int8(_NO_WAY), out.astype(np.int8))
        codes[:, out == _OUT] = _OUT
        for k, task in enumerate(tasks):
            unfit = self._fitness.codes(task)
            if unfit is not None:
                codes[k] = np.where(unfit != CAN_TAKE, unfit, codes[k])
            if task.shunned:
                _refuse_shunned(codes[k], task)
            if kept:
                _refuse_kept(codes[k], task, kept)
        return codes

    def _refuse_low(self, charging: Charging, codes: Codes, task: Task, moves: FloatArray) -> None:
        """Refuse the cars, of those that could take a task, that have too little charge for it."""
        cars = np.flatnonzero(codes == CAN_TAKE)
        if task.visit is None:
            order = task.delivery
            stations = self._stations.named(task.pick), self._stations.named(order.drop)
            allowed = charging.allows(cars.tolist(), moves[cars], *stations, order.mass_kg)
        elif task.visit.until_full:
            return
        else:
            errands = self._routes.errands(task)
            n_rest_moves, stand_s = self._routes.rest(task)
            n_home_moves = float(charging.moves_home(np.array(errands[-1][0].states[:1]))[0])
            allowed = charging.allows_way(cars.tolist(), moves[cars] + n_rest_moves + n_home_moves, stand_s)
        codes[cars[~allowed]] = CODE_OF_REASON[PairReason.LOW_CHARGE]


def _refuse_kept(codes: Codes, task: Task, kept: Mapping[int, Task]) -> None:
    """Refuse the cars, of those that could take a task, that are kept for another, or that it is not kept for."""
    mine = next((car for car, leg in kept.items() if leg is task), None)
    for car in np.flatnonzero(codes == CAN_TAKE).tolist():
        if mine is not None and car != mine:
            codes[car] = CODE_OF_REASON[PairReason.OTHER_CAR]
        elif car in kept and kept[car] is not task:
            codes[car] = CODE_OF_REASON[PairReason.KEPT_FOR_LEG]


def _refuse_shunned(codes: Codes, task: Task) -> None:
    """Refuse the cars that a task was taken from, if another one can take it: better one that failed than nobody."""
    shunned = np.isin(np.arange(len(codes)), list(task.shunned)) & (codes == CAN_TAKE)
    if ((codes == CAN_TAKE) & ~shunned).any():
        codes[shunned] = CODE_OF_REASON[PairReason.SHUNNED]
