"""Situation: what cars are about, as far as it matters for who gets which task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fleet.missions.charging import Charging
from fleet.missions.phases import AT_CHARGER, NUMBER_OF_PHASE, OUT, PHASES, CarPhase
from fleet.missions.state import NO_TASK, Missions
from fleet.missions.ways import STEP_S, Ways
from fleet.tasks.board import NUMBER_OF_STATE, Task, TaskState
from fleet.tasks.reasons import CODE_OF_REASON, PairReason
from planners.mapf.distance_table import UNREACHABLE

CAN_TAKE = CODE_OF_REASON[PairReason.LEFT_OVER]
"""Code of a car that can take a task."""

_STANDING = (
    dict.fromkeys(CarPhase, PairReason.CAR_BUSY)
    | dict.fromkeys((CarPhase.IDLE, *AT_CHARGER), PairReason.CAR_CHARGES)
    | dict.fromkeys(OUT, PairReason.CAR_OUT)
)
_STANDING_CODES = np.array([CODE_OF_REASON[_STANDING[phase]] for phase in PHASES], dtype=np.int8)
"""Why a car in a phase cannot take a task, as a code; one that is idle and cannot is about to charge."""

_ASSIGNED, _LOADING = NUMBER_OF_STATE[TaskState.ASSIGNED], NUMBER_OF_STATE[TaskState.LOADING]
_CARRIED, _UNLOADING = NUMBER_OF_STATE[TaskState.CARRIED], NUMBER_OF_STATE[TaskState.UNLOADING]

_NOT_ASKED = np.int8(CODE_OF_REASON[PairReason.NOT_ASKED])


def _is_one_of(*phases: CarPhase) -> npt.NDArray[np.bool_]:
    return np.array([phase in phases for phase in PHASES])


_UNDER_WAY = _is_one_of(CarPhase.TO_PICK, CarPhase.TO_PLACE, CarPhase.HELD)
_AT_CHARGER = _is_one_of(*AT_CHARGER)
_SOON_FREE = _is_one_of(
    CarPhase.TO_PICK,
    CarPhase.LOADING,
    CarPhase.HELD,
    CarPhase.TO_DROP,
    CarPhase.UNLOADING,
    CarPhase.TO_CHARGER,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """What cars are about."""

    standing: npt.NDArray[np.int8]
    """Why each car cannot take a task now, an index into `PAIR_REASONS`; `CAN_TAKE` where it can, shape (n_cars,)."""
    held: Mapping[int, Task]
    """Tasks that cars have but may still give away, by car; these cars can take another."""
    kept: Mapping[int, Task]
    """Tasks that no other car may have, by car; these cars can take no other."""
    state: npt.NDArray[np.int32]
    """State in which each car that cannot take a task now will be free, shape (n_cars,)."""
    free_s: npt.NDArray[np.float64]
    """Time until then, inf where that is not known, or the car can take a task now, shape (n_cars,) [s]."""
    ahead: npt.NDArray[np.int32]
    """State up to which each car was granted moves, shape (n_cars,)."""
    exchange: bool
    """Whether tasks that are not picked yet may change hands."""

    def soon(self, soon_s: float) -> npt.NDArray[np.bool_]:
        """Cars that cannot take a task now, and can in so many seconds, shape (n_cars,)."""
        soon: npt.NDArray[np.bool_] = np.isfinite(self.free_s) & (self.free_s <= soon_s)
        return soon

    def begins(self, soon_s: float) -> npt.NDArray[np.int32]:
        """State in which each car begins that is free now, or in so many seconds, shape (n_cars,)."""
        return np.where(self.soon(soon_s), self.state, self.ahead).astype(np.int32)

    def limited(self, most: int, turn: int, soon_s: float) -> Situation:
        """The same with no more than so many cars that are asked, which others are from round to round.

        Half of them are free, of those that will be soon it is a quarter, the first ones, and the rest may give their
        tasks away; where there are fewer of one kind, more are free.

        Args:
            most: How many cars are asked, at least 4.
            turn: Number of the round.
            soon_s: Cars that cannot take a task now are asked if they can in so many seconds [s].
        """
        soon = self.soon(soon_s).nonzero()[0]
        can_take = self.standing == CAN_TAKE
        if can_take.sum() + len(soon) <= most:
            return self
        gives = np.zeros(len(can_take), dtype=np.bool_)
        gives[list(self.held)] = True
        free, held = (can_take & ~gives).nonzero()[0], gives.nonzero()[0]
        soon = soon[np.argsort(self.free_s[soon], kind="stable")][: most // 4]
        held = in_turn(held, most - len(soon) - min(len(free), most // 2), turn)
        free = in_turn(free, most - len(soon) - len(held), turn)
        asked, comes = np.zeros((2, len(can_take)), dtype=np.bool_)
        asked[free] = asked[held] = comes[soon] = True
        return replace(
            self,
            standing=np.where(can_take & ~asked, _NOT_ASKED, self.standing),
            held={car: task for car, task in self.held.items() if asked[car]},
            free_s=np.where(comes, self.free_s, np.inf),
        )


def in_turn(cars: npt.NDArray[np.intp], most: int, turn: int) -> npt.NDArray[np.intp]:
    """So many of some cars, others from round to round."""
    return np.roll(cars, -turn * most)[:most]


def situation_of(
    missions: Missions, ways: Ways, charging: Charging | None, now_s: float, *, exchange: bool
) -> Situation:
    """Look at all cars; those that are to pick a task may give it away only where tasks are exchanged.

    When busy cars will be free is found from the ways that are left and the service times that were learnt; queues are
    not foreseen. What a car has aboard it brings away afterwards, nearest first.
    """
    phase, state = missions.phase_index, missions.task_state
    assigned = (state == _ASSIGNED) & _UNDER_WAY[phase]
    # A car whose way ends in the dock is about to be served.
    cars = assigned.nonzero()[0]
    goal = ways.goals[cars]
    picks = missions.pick_of[cars] >= 0
    goal[picks] = missions.stations.dock_states[missions.pick_of[cars[picks]]]
    held: dict[int, Task] = {}
    for car in cars[ways.tails[cars] != goal].tolist() if exchange else ():
        task = missions.task_of[car]
        if task is not None:
            held[car] = task
    can_take = (phase == NUMBER_OF_PHASE[CarPhase.IDLE]) | (_AT_CHARGER[phase] & (state == NO_TASK))
    if charging is not None:
        for car in can_take.nonzero()[0].tolist():
            can_take[car] = charging.spares(car)
    can_take[list(held)] = True
    can_take[[car for car, carried in enumerate(missions.aboard) if carried]] = False
    standing = np.where(can_take, np.int8(CAN_TAKE), _STANDING_CODES[phase])
    free_state, free_s = _when_free(missions, ways, ~can_take & _SOON_FREE[phase] & (missions.drop_of >= 0), now_s)
    return Situation(
        standing=standing,
        held=held,
        kept=missions.kept(),
        state=free_state,
        free_s=free_s,
        ahead=ways.ahead,
        exchange=exchange,
    )


def _when_free(
    missions: Missions, ways: Ways, busy: npt.NDArray[np.bool_], now_s: float
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """Where and when cars with a delivery will have made it; inf where there is no way, and for the other cars."""
    stations = missions.stations
    state, free_s = np.zeros(missions.n_cars, dtype=np.int32), np.full(missions.n_cars, np.inf)
    cars = busy.nonzero()[0]
    if not cars.size:
        return state, free_s
    pick, drop, task_state = missions.pick_of[cars], missions.drop_of[cars], missions.task_state[cars]
    mean_s = stations.mean_s()
    left_s = stations.times.all_left_s(now_s)
    carried = task_state == _CARRIED
    unloading = task_state == _UNLOADING
    begin = np.where(carried, ways.ahead[cars], stations.dock_states[pick])
    moves = np.where(unloading, 0, ways.moves_each(begin, stations.dock_states[drop]).astype(np.int64))
    load_s = np.where(task_state == _LOADING, left_s[pick], mean_s[pick])
    at_docks_s = np.where(unloading, left_s[drop], np.where(carried, mean_s[drop], load_s + mean_s[drop]))
    state[cars] = stations.dock_states[drop]
    free_s[cars] = np.where(moves < UNREACHABLE, moves * STEP_S + at_docks_s, np.inf)
    for car in [car for car, aboard in enumerate(missions.aboard) if aboard]:
        arms = [stations.named(task.delivery.drop).arm for task in missions.aboard[car]]
        while arms and np.isfinite(free_s[car]):
            moves_to = {arm: ways.between(int(state[car]), int(stations.dock_states[arm])) for arm in sorted(arms)}
            arm = min(moves_to, key=lambda arm: moves_to[arm])
            arms.remove(arm)
            state[car] = stations.dock_states[arm]
            free_s[car] += moves_to[arm] * STEP_S + mean_s[arm] if moves_to[arm] < UNREACHABLE else np.inf
    return state, free_s
