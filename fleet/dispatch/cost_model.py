"""Costs: what each task costs each car, and which pairs are infeasible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.config import AllocationConfig
from fleet.dispatch.fitness import Codes, Fitness
from fleet.dispatch.situation import CAN_TAKE, Situation
from fleet.missions.admission import CALL_EARLY_S
from fleet.missions.charging import Charging
from fleet.missions.state import Missions
from fleet.missions.turns import Booked, Deliveries, waits
from fleet.missions.visit_routes import VisitRoutes
from fleet.missions.ways import MOVE_S, Ways
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Delivery
from fleet.tasks.reasons import CODE_OF_REASON, PairReason
from planners.allocation.costs import CostWeights, task_costs
from planners.mapf.distance_table import UNREACHABLE

LONG_WAIT_COST = 3.0
"""What a second of waiting for an arm costs beyond itself, past the wait that keeps arms from waiting for cars: so a
car goes further to an arm that is idle, rather than to wait as long for one that is not."""
FULL_S = 300.0
"""To charge a car that is full costs so much more than to charge an empty one, as seconds of travel [s]."""
_CODE = CODE_OF_REASON
_NO_WAY, _OUT = _CODE[PairReason.NO_WAY], _CODE[PairReason.CAR_OUT]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class CostMatrix:
    """What each task costs each car, tasks in the columns."""

    now_s: float
    tasks: list[Task]
    cost_s: npt.NDArray[np.float64]
    """Shape (n_cars, n_tasks); inf = not allowed."""
    codes: npt.NDArray[np.int8]
    """Why a pair is not allowed, as an index into `PAIR_REASONS`; `CAN_TAKE` where it is, same shape."""
    pressure_s: FloatArray
    """How much each task presses for being served, the same for all cars, shape (n_tasks,) [s]."""
    states: npt.NDArray[np.int32]
    """Lane-graph state in which each car can begin, shape (n_cars,)."""
    free_s: npt.NDArray[np.float64]
    """Time until it can, shape (n_cars,)."""

    def offers(self, column: int) -> bool:
        """Whether any car may have a task."""
        return bool(self.cost_s[:, column].min() < np.inf)

    def cars_for(self, columns: list[int]) -> npt.NDArray[np.intp]:
        """Cars that may have any of some tasks, ascending."""
        # Tasks are contiguous, so that whole columns are compared.
        least_s = np.full(len(self.cost_s), np.inf)
        for column in columns:
            np.minimum(least_s, self.cost_s[:, column], out=least_s)
        return np.flatnonzero(least_s < np.inf)


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
        moves, n_rest_moves, service_s = self._work(tasks, states)
        codes = self._codes(tasks, out, (moves >= UNREACHABLE) | (n_rest_moves >= UNREACHABLE), situation.kept)
        if self._charging is not None:
            for k, task in enumerate(tasks):
                self._refuse_low(self._charging, codes[:, k], task, moves[:, k])
        travel_s = free_s[:, None] + moves * MOVE_S
        way_s, able = n_rest_moves * MOVE_S, (out == CAN_TAKE).nonzero()[0]
        waits_s = np.zeros_like(travel_s)
        waits_s[able] = self._waits(tasks, travel_s[able], way_s, not_before_s, booked)
        column_of = {task.index: k for k, task in enumerate(tasks)}
        for car, task in situation.held.items():
            # Its own turn does not keep it. Who would take the task over is kept by it: without that brake, tasks of a
            # fleet that sets off at once change hands so often that 300 cars deliver an eighth less.
            own = car, column_of[task.index]
            waits_s[own] = min(waits_s[own], booked.early_s[car])
        travel_s += waits_s
        np.copyto(travel_s, np.inf, where=codes != CAN_TAKE)
        cost_s, pressure_s = task_costs(
            travel_s=travel_s,
            rest_s=n_rest_moves * MOVE_S,
            service_s=service_s,
            since_s=np.array([task.since_s[TaskState.BACKLOG] for task in tasks]),
            due_s=np.array([task.order.due_s for task in tasks]),
            now_s=now_s,
            weights=CostWeights(self._config.lateness, self._config.ageing, self._config.due),
        )
        cost_s += LONG_WAIT_COST * np.maximum(waits_s - CALL_EARLY_S, 0.0)
        for k, task in enumerate(tasks):
            if task.visit is not None and task.visit.until_full and self._charging is not None:
                cost_s[:, k] += FULL_S * self._charging.batteries.charge
        return CostMatrix(
            now_s=now_s, tasks=tasks, cost_s=cost_s, codes=codes, pressure_s=pressure_s, states=states, free_s=free_s
        )

    def _waits(
        self,
        tasks: Sequence[Task],
        comes_s: FloatArray,
        way_s: FloatArray,
        not_before_s: FloatArray,
        booked: Booked,
    ) -> FloatArray:
        """How long cars that come at some times would wait for arms, shape of `comes_s`; nobody waits on a visit."""
        waits_s = np.zeros_like(comes_s)
        columns = np.array([k for k, task in enumerate(tasks) if task.visit is None], dtype=np.intp)
        if not columns.size:
            return waits_s
        ends = self._stations.arms_of([(tasks[k].pick, tasks[k].delivery.drop) for k in columns.tolist()])
        deliveries = Deliveries(ends[:, 0], ends[:, 1], way_s[columns], not_before_s[columns])
        waits_s[:, columns] = waits(booked.turns, comes_s[:, columns], deliveries)
        return waits_s

    def _work(self, tasks: Sequence[Task], states: npt.NDArray[np.int32]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Moves of each car to each task, shape (n_cars, n_tasks), moves of each task from there on and time it takes
        at docks or places, shape (n_tasks,) each."""
        moves = np.empty((len(tasks), len(states)))
        n_rest_moves, service_s = np.empty(len(tasks)), np.empty(len(tasks))
        deliveries, ends = [], []
        for k, task in enumerate(tasks):
            if isinstance(task.order, Delivery):
                deliveries.append(k)
                ends.append((task.pick, task.order.drop))
            else:
                moves[k] = self._routes.to_errand(task, states)
                n_rest_moves[k], service_s[k] = self._routes.rest(task)
        if deliveries:
            docks, mean_s = self._stations.dock_states, self._stations.mean_s()
            picks, drops = self._stations.arms_of(ends).T
            used, which = np.unique(picks, return_inverse=True)  # many tasks begin at few stations
            moves[deliveries] = self._ways.moves_to(states, docks[used])[which]
            n_rest_moves[deliveries] = self._ways.moves_each(docks[picks], docks[drops])
            service_s[deliveries] = mean_s[picks] + mean_s[drops]
        return moves.T, n_rest_moves, service_s

    def least_s(self, task: Task, move_s: float) -> float:
        """The least time from the best pick station to the delivery, or from the first place of a visit to its end [s].

        It is inf if there is no way.

        Args:
            task: The task.
            move_s: Time of one move at full speed [s].
        """
        if task.visit is not None:
            n_rest_moves, stand_s = self._routes.rest(task)
            return n_rest_moves * move_s + stand_s if n_rest_moves < UNREACHABLE else np.inf
        order = task.delivery
        moves = min(self._moves(pick, order.drop) for pick in order.picks)
        return moves * move_s + self._service_s(task.pick, order.drop) if moves < UNREACHABLE else np.inf

    def _moves(self, pick: str, drop: str) -> int:
        return self._ways.between(self._stations.named(pick).dock_state, self._stations.named(drop).dock_state)

    def _service_s(self, pick: str, drop: str) -> float:
        """Time at both docks [s]."""
        named, time = self._stations.named, self._stations.time
        return time(named(pick)).mean_s + time(named(drop)).mean_s

    def _codes(
        self,
        tasks: Sequence[Task],
        out: Codes,
        unreachable: npt.NDArray[np.bool_],
        kept: Mapping[int, Task],
    ) -> Codes:
        """Why each car cannot take each task, `CAN_TAKE` for those that can; what lasts longest counts first."""
        codes = np.where(unreachable, np.int8(_NO_WAY), out[:, None].astype(np.int8))
        codes[out == _OUT] = _OUT
        for k, task in enumerate(tasks):
            unfit = self._fitness.codes(task)
            if unfit is not None:
                codes[:, k] = np.where(unfit != CAN_TAKE, unfit, codes[:, k])
            if task.shunned:
                _refuse_shunned(codes[:, k], task)
            if kept:
                _refuse_kept(codes[:, k], task, kept)
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
        codes[cars[~allowed]] = _CODE[PairReason.LOW_CHARGE]


def _refuse_kept(codes: Codes, task: Task, kept: Mapping[int, Task]) -> None:
    """Refuse the cars, of those that could take a task, that are kept for another, or that it is not kept for."""
    mine = next((car for car, leg in kept.items() if leg is task), None)
    for car in np.flatnonzero(codes == CAN_TAKE).tolist() if kept else ():
        if mine is not None and car != mine:
            codes[car] = _CODE[PairReason.OTHER_CAR]
        elif car in kept and kept[car] is not task:
            codes[car] = _CODE[PairReason.KEPT_FOR_LEG]


def _refuse_shunned(codes: Codes, task: Task) -> None:
    """Refuse the cars that a task was taken from, if another one can take it: better one that failed than nobody."""
    shunned = np.isin(np.arange(len(codes)), list(task.shunned)) & (codes == CAN_TAKE)
    if ((codes == CAN_TAKE) & ~shunned).any():
        codes[shunned] = _CODE[PairReason.SHUNNED]
