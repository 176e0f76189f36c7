"""Prices: what each task costs each car, and which pairs are out of the question."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.config import AllocationConfig
from fleet.dispatch.availability import STEP_S, Availability
from fleet.missions.charging import Charging
from fleet.missions.visit_routes import VisitRoutes
from fleet.stations.service_time import Direction, ServiceTimes
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Ability
from fleet.tasks.reasons import CODE_OF_REASON, PairReason
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic
from planners.mapf.distance_table import UNREACHABLE

FULL_S = 300.0
"""To charge a car that is full costs so much more than to charge an empty one, as seconds of travel [s]."""
_CODE = CODE_OF_REASON
_FREE = _CODE[PairReason.LEFT_OVER]


@dataclass(frozen=True, kw_only=True, eq=False)
class CostMatrix:
    """What each task costs each car, tasks in the columns."""

    now_s: float
    tasks: list[Task]
    cost_s: npt.NDArray[np.float64]
    """Shape (n_cars, n_tasks); inf = not allowed."""
    codes: npt.NDArray[np.int8]
    """Why a pair is not allowed, as an index into `PAIR_REASONS`; `LEFT_OVER` where it is, same shape."""
    pressure_s: list[float]
    """How much a task presses for being served, the same for all cars [s]."""
    states: npt.NDArray[np.int32]
    """Lane-graph state in which each car can begin, shape (n_cars,)."""
    free_s: npt.NDArray[np.float64]
    """Time until it can, shape (n_cars,)."""

    def offers(self, column: int) -> bool:
        """Whether any car may have a task."""
        return bool(np.isfinite(self.cost_s[:, column]).any())


class CostModel:
    """Makes prices.

    What a task costs a car is its travel to the pick station, plus a weight times the time it would be late with that
    car, less what the task presses for: a weight times its age, and a weight times the time it would be late if it were
    left to the next turn, as long as itself, even with the best car. So of the tasks a late one goes first, and of the
    cars the one that brings it in time. (That a late task must get cheaper, not dearer, by waiting is the idea of the
    apparent tardiness cost rule: Vepsalainen, Morton, "Priority rules for job shops with weighted tardiness costs",
    Management Science 33(8), 1987.)

    Args:
        config: Ageing and lateness.
        stations: By name.
        service_times: How long the arms take.
        abilities: What each car can carry.
        charging: Tells which cars have the charge for a task; None = all.
        ways: Of visits.
        traffic: Gives distances on the lane graph.
        executor: Gives the states cars can be sent from.
    """

    def __init__(
        self,
        *,
        config: AllocationConfig,
        stations: Mapping[str, Station],
        service_times: ServiceTimes,
        abilities: Sequence[Ability],
        charging: Charging | None,
        ways: VisitRoutes,
        traffic: Traffic,
        executor: Executor,
    ) -> None:
        self._config = config
        self._stations = stations
        self._service_times = service_times
        self._abilities = abilities
        self._charging = charging
        self._ways = ways
        self._traffic = traffic
        self._executor = executor
        self._unfit: dict[int, npt.NDArray[np.int8]] = {}

    def of(
        self,
        tasks: list[Task],
        standing: Sequence[PairReason | None],
        kept: Mapping[int, Task],
        soon: Mapping[int, Availability],
        now_s: float,
    ) -> CostMatrix:
        """Price tasks.

        Args:
            tasks: The tasks.
            standing: Why each car cannot take a task now, shape (n_cars,); None = it can.
            kept: Tasks that no other car may have, by car; these cars can take no other.
            soon: Cars that cannot take a task now, but from a time on that is known.
            now_s: Simulated time [s].
        """
        config = self._config
        states, free_s = self._executor.tail_states().astype(np.int32), np.zeros(len(standing))
        out = np.array([_CODE[reason] if reason is not None else _FREE for reason in standing])
        for car, availability in soon.items():
            states[car], free_s[car], out[car] = availability.state, availability.free_s, _FREE
        cost = np.empty((len(states), len(tasks)))
        codes = np.empty(cost.shape, dtype=np.int8)
        pressure = []
        # Many tasks share few ways.
        to_pick = {
            pick: self._traffic.tables.to(self._stations[pick].dock_state)[states].astype(np.float64)
            for pick in dict.fromkeys(task.pick for task in tasks if task.visit is None)
        }
        ways = {
            way: (self._moves(*way), self._service_s(*way))
            for way in dict.fromkeys((task.pick, task.delivery.drop) for task in tasks if task.visit is None)
        }
        for k, task in enumerate(tasks):
            if task.visit is not None:
                moves = self._ways.to_stop(task, states)
                rest_n, service_s = self._ways.rest(task)
            else:
                moves = to_pick[task.pick]
                rest_n, service_s = ways[task.pick, task.delivery.drop]
            codes[:, k] = self._refusals(task, out, (moves >= UNREACHABLE) | (rest_n >= UNREACHABLE))
            _refuse_kept(codes[:, k], task, kept)
            if self._charging is not None:
                self._refuse_low(self._charging, codes[:, k], task, moves)
            to_pick_s = free_s + moves * STEP_S
            eta_s = now_s + to_pick_s + rest_n * STEP_S + service_s
            late_s = np.maximum(0.0, eta_s - task.order.due_s)
            best_s = float(eta_s.min())
            late_next_turn_s = max(0.0, best_s + (best_s - now_s) - task.order.due_s)
            age_s = now_s - task.since_s[TaskState.BACKLOG]
            pressure.append(config.ageing * age_s + config.lateness * late_next_turn_s)
            cost[:, k] = to_pick_s + config.lateness * late_s - pressure[-1]
            if task.visit is not None and task.visit.until_full and self._charging is not None:
                cost[:, k] += FULL_S * self._charging.batteries.charge
        cost[codes != _FREE] = np.inf
        return CostMatrix(
            now_s=now_s, tasks=tasks, cost_s=cost, codes=codes, pressure_s=pressure, states=states, free_s=free_s
        )

    def source_cost(self, pick: str, task: Task) -> float:
        """Moves from the nearest car to a pick station and on to the task's drop station."""
        state = self._stations[pick].dock_state
        nearest = int(self._traffic.tables.to(state)[self._executor.tail_states()].min())
        return nearest + self._moves(pick, task.delivery.drop)

    def least_s(self, task: Task, move_s: float) -> float:
        """The least time from the best pick station to the delivery, or from the first place of a visit to its end [s].

        It is inf if there is no way.

        Args:
            task: The task.
            move_s: Time of one move at full speed [s].
        """
        if task.visit is not None:
            rest_n, stand_s = self._ways.rest(task)
            return rest_n * move_s + stand_s if rest_n < UNREACHABLE else np.inf
        order = task.delivery
        moves = min(self._moves(pick, order.drop) for pick in order.picks)
        return moves * move_s + self._service_s(task.pick, order.drop) if moves < UNREACHABLE else np.inf

    def _moves(self, pick: str, drop: str) -> int:
        return int(self._traffic.tables.to(self._stations[drop].dock_state)[self._stations[pick].dock_state])

    def _service_s(self, pick: str, drop: str) -> float:
        """Time at both docks [s]."""
        load = self._service_times.of(self._stations[pick].arm, Direction.TO_CAR)
        unload = self._service_times.of(self._stations[drop].arm, Direction.FROM_CAR)
        return load.mean_s + unload.mean_s

    def _refusals(
        self, task: Task, out: npt.NDArray[np.int64], unreachable: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.int8]:
        """Why each car cannot take a task, `LEFT_OVER` for those that can; what lasts longest counts first."""
        codes = np.where(unreachable, _CODE[PairReason.NO_WAY], out).astype(np.int8)
        codes[out == _CODE[PairReason.CAR_OUT]] = _CODE[PairReason.CAR_OUT]
        unfit = self._unfit.get(task.index)
        if unfit is None:
            heavy, lacks = _CODE[PairReason.TOO_HEAVY], _CODE[PairReason.LACKS_CAPABILITY]
            order = task.order
            unfit = np.array(
                [
                    _FREE if a.fits(order) else heavy if order.payload_kg > a.max_payload_kg else lacks
                    for a in self._abilities
                ],
                dtype=np.int8,
            )
            self._unfit[task.index] = unfit
        codes = np.where(unfit != _FREE, unfit, codes)
        if task.shunned:
            shunned = np.isin(np.arange(len(codes)), list(task.shunned)) & (codes == _FREE)
            # Better one that failed before than nobody.
            if ((codes == _FREE) & ~shunned).any():
                codes[shunned] = _CODE[PairReason.SHUNNED]
        return codes

    def _refuse_low(
        self, charging: Charging, codes: npt.NDArray[np.int8], task: Task, moves: npt.NDArray[np.float64]
    ) -> None:
        """Refuse the cars, of those that could take a task, that have too little charge for it."""
        cars = np.flatnonzero(codes == _FREE)
        if task.visit is None:
            order = task.delivery
            stations = self._stations[task.pick], self._stations[order.drop]
            allowed = charging.allows(cars.tolist(), moves[cars], *stations, order.mass_kg)
        elif task.visit.until_full:
            return
        else:
            stops = self._ways.stops(task)
            rest_n, stand_s = self._ways.rest(task)
            home_n = float(charging.moves_home(np.array(stops[-1][0].states[:1]))[0])
            allowed = charging.allows_way(cars.tolist(), moves[cars] + rest_n + home_n, stand_s)
        codes[cars[~allowed]] = _CODE[PairReason.LOW_CHARGE]


def _refuse_kept(codes: npt.NDArray[np.int8], task: Task, kept: Mapping[int, Task]) -> None:
    """Refuse the cars, of those that could take a task, that are kept for another, or that it is not kept for."""
    mine = next((car for car, leg in kept.items() if leg is task), None)
    for car in np.flatnonzero(codes == _FREE).tolist() if kept else ():
        if mine is not None and car != mine:
            codes[car] = _CODE[PairReason.OTHER_CAR]
        elif car in kept and kept[car] is not task:
            codes[car] = _CODE[PairReason.KEPT_FOR_LEG]
