"""Allocation: which car should take which ready task, by the allocator that the run names, and why no other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.config import AllocationConfig
from fleet.dispatch.allocation_round import AllocationRound, Answer
from fleet.dispatch.cost_model import CostMatrix, CostModel
from fleet.dispatch.horizon import RollingHorizon
from fleet.dispatch.offers import Offers
from fleet.dispatch.situation import CAN_TAKE, Situation
from fleet.dispatch.solver import Solver
from fleet.missions.state import Missions
from fleet.missions.turns import TurnBook
from fleet.tasks.board import Task
from fleet.tasks.reasons import PAIR_REASONS, PairReason, ReasonBook, TaskReason
from planners.allocation.problem import Assignment

OTHERS_TOLD = 2
"""Cars whose costs are told beside that of the one that gets a task."""
TOLD_IN_TURNS = 6
"""Why a task waits is found out anew in one of so many rounds in which tasks change hands: it seldom changes."""

MOST_ASKED = 1_000
"""So many cars are asked in a round at most, in turn, as time and memory grow with the square of them: a round of
10,000 cars took 50 s and 3 GB."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What an allocation changes."""

    taken: list[tuple[int, str]]
    """Cars that lose the task they had not picked yet, and why."""
    given: list[tuple[int, Task, str]]
    """Cars, their new tasks, and why."""
    more: bool = False
    """Whether it goes on: tasks were given out, and there are cars that were not asked."""


class TaskAllocation:
    """Poses the allocation problem, hands on its answer, and keeps the reasons.

    Args:
        missions: What cars and tasks are about.
        cost_model: What each task costs each car.
        solver: The allocator.
        offers: Which tasks there is room for.
        turns: When arms are taken.
        horizon: What can be given out, for allocators that plan ahead.
        reason_book: Told about every decision.
    """

    def __init__(
        self,
        missions: Missions,
        cost_model: CostModel,
        solver: Solver,
        offers: Offers,
        turns: TurnBook,
        horizon: RollingHorizon,
        reason_book: ReasonBook,
    ) -> None:
        self._missions = missions
        self._board = missions.board
        self._cost_model = cost_model
        self._solver = solver
        self._offers = offers
        self._turns = turns
        self._horizon = horizon
        self._reasons = reason_book
        self._turn = 0
        self._n_rounds = 0

    def change(self, config: AllocationConfig) -> None:
        """Go on with other settings."""
        self._cost_model.change(config)
        self._solver.change(config)
        self._offers.change(config)
        self._horizon.change(config)

    @property
    def plans_ahead(self) -> bool:
        """Whether cars are given several tasks, one after the other, so that all of them are planned together."""
        return self._solver.plans_ahead

    def choose(self, situation: Situation, now_s: float) -> Choice:
        """Pairs of a car and a task, at most one for each.

        Raises:
            PlanningError: An allocator of one's own gave an answer that is not legal.
        """
        soon_s = self._solver.soon_s
        everybody, situation = situation, situation.limited(MOST_ASKED, self._n_rounds, soon_s)
        self._n_rounds += 1
        held, soon = situation.held, situation.soon(soon_s)
        cars = ((situation.standing == CAN_TAKE) | soon).nonzero()[0]
        if not len(cars) and not situation.exchange:
            return Choice(taken=[], given=[])  # why tasks wait is told in the rounds in which they change hands
        booked = self._turns.all(now_s)
        kept = self._horizon.loads.spoken_for(held)
        offer = self._offers.of(cars, len(held), situation.begins(soon_s)[cars], booked.turns, kept)
        n = len(offer.tasks)
        if not n and len(held) < 2:
            return Choice(taken=[], given=[])
        not_before_s = np.concatenate((offer.not_before_s, np.zeros(len(held))))
        costs = self._cost_model.of([*offer.tasks, *held.values()], not_before_s, situation, booked, soon_s, now_s)
        offered, full = self._offers.with_room(costs, n)
        columns = [*offered, *range(n, len(costs.tasks))]
        column_of, later, answer = self._allocate(costs, columns, held, soon)
        self._keep_reasons(costs, answer, full, soon, column_of, later, anew=situation.exchange)
        taken, given = [], []
        for column, (car, task) in enumerate(held.items(), start=n):
            if column_of[car] < 0 or costs.tasks[column_of[car]] is not task:
                taken.append((car, self._why_taken(costs, column_of, car, column)))
        for car in (column_of >= 0).nonzero()[0].tolist():
            task = costs.tasks[column_of[car]]
            if held.get(car) is not task:
                given.append((car, task, _why_given(costs, car, int(column_of[car]))))
        return Choice(taken=taken, given=given, more=situation is not everybody and bool(given))

    def _allocate(
        self, costs: CostMatrix, columns: list[int], held: Mapping[int, Task], soon: npt.NDArray[np.bool_]
    ) -> tuple[npt.NDArray[np.int64], dict[int, int], Answer | None]:
        """Pose the problem.

        Returns:
            The column of the task that each car has then, -1 for none, shape (n_cars,); by column the car that is to
            take a task when it is free; and the answer of the allocator, None if there was nothing to ask.
        """
        column_of = np.full(len(costs.codes), -1, dtype=np.int64)
        later: dict[int, int] = {}
        rows = costs.rows_for(columns)
        if not columns or not len(rows):
            return column_of, later, None
        cars = costs.cars[rows]
        horizon = self._horizon if self._solver.plans_ahead else None
        problem = self._solver.problem(costs, columns, rows, held, horizon)
        assignment = self._solver.solve(problem)
        if horizon is not None:
            horizon.keep(costs, problem, assignment, columns, cars, soon)
        for row, k in _in_turn(assignment):
            car, column = int(cars[row]), columns[k]
            if soon[car]:
                later[column] = car
            elif column_of[car] < 0:
                column_of[car] = column
        return column_of, later, Answer(problem=problem, assignment=assignment, cars=cars, columns=columns)

    def _why_taken(self, costs: CostMatrix, column_of: npt.NDArray[np.int64], car: int, column: int) -> str:
        """Why a car loses the task of a column, in words."""
        takers = np.flatnonzero(column_of == column)
        words = [f"cost car_{car} {costs.of_pair(car, column):.1f} s"]
        if takers.size:
            words.append(f"costs car_{takers[0]} {costs.of_pair(int(takers[0]), column):.1f} s now")
        if column_of[car] >= 0:
            words.append(f"car_{car} takes {costs.tasks[column_of[car]].order.name}")
        return "re-assigned: " + ", ".join(words)

    def _keep_reasons(
        self,
        costs: CostMatrix,
        answer: Answer | None,
        full: set[int],
        soon: npt.NDArray[np.bool_],
        column_of: npt.NDArray[np.int64],
        later: Mapping[int, int],
        *,
        anew: bool,
    ) -> None:
        """Keep how the cars were judged for each task, and say why those tasks wait that nobody got.

        Of those that have been told why before it is found out anew only now and then.
        """
        takers = np.flatnonzero(column_of >= 0)
        taker_of = np.full(len(costs.tasks), -1)
        taker_of[column_of[takers]] = takers
        took = self._missions.under_way()
        took[takers] = [costs.tasks[column].index for column in column_of[takers].tolist()]
        judged = AllocationRound(
            costs=costs,
            answer=answer,
            full=frozenset(full),
            soon=soon,
            taker_of=taker_of,
            later=later,
            took=took,
            name_of=self._board.name_of,
        )
        self._reasons.keep(judged)
        for column, car in sorted(later.items()):
            text = f"car_{car} is to take it, and will be free in {costs.free_s[car]:.0f} s"
            self._reasons.note(costs.tasks[column], TaskReason.PLANNED, text, costs.now_s)
        self._turn += anew
        untold = [
            column
            for column in np.flatnonzero(taker_of < 0).tolist()
            if column not in later and self._is_told(costs.tasks[column], anew)
        ]
        for column, codes in zip(untold, judged.codes(untold), strict=True):
            why = self._why_open(costs.tasks[column], codes, column in full)
            self._reasons.note(costs.tasks[column], *why, costs.now_s)

    def _is_told(self, task: Task, anew: bool) -> bool:
        """Whether it is found out why a task waits."""
        in_turn = anew and (task.index + self._turn) % TOLD_IN_TURNS == 0
        return in_turn or self._reasons.present(task) is None

    def _why_open(self, task: Task, codes: npt.NDArray[np.int8], full: bool) -> tuple[TaskReason, str]:
        """Why nobody got a ready task; what lasts longest counts first."""
        reasons = {PAIR_REASONS[code] for code in np.bincount(codes).nonzero()[0].tolist()}
        ends = (task.pick, task.delivery.drop) if task.visit is None else (task.next_words,)
        unfit = {PairReason.TOO_HEAVY, PairReason.LACKS_CAPABILITY, PairReason.CAR_OUT}
        if reasons <= unfit:
            return TaskReason.NO_CAPABLE_CAR, "every car that could do it is out of service"
        if reasons <= unfit | {PairReason.NO_WAY}:
            return TaskReason.UNREACHABLE, f"no car has a way to {' and on to '.join(ends)}"
        if reasons <= unfit | {PairReason.NO_WAY, PairReason.LOW_CHARGE, PairReason.CAR_CHARGES}:
            return TaskReason.CARS_CHARGE, "every car that could take it has to charge before"
        if full:
            return TaskReason.STATION_FULL, f"{' or '.join(ends)} has no room for one more car"
        if PairReason.OTHER_CAR in reasons and PairReason.LEFT_OVER not in reasons:
            return TaskReason.WAITS_FOR_ITS_CAR, "the car that did the leg before it cannot go on yet"
        if PairReason.LEFT_OVER in reasons:
            return TaskReason.LEFT_OVER, "the allocator left it and a free car over"
        if PairReason.NOT_ASKED in reasons:
            return TaskReason.NO_FREE_CAR, "of the cars that were asked every one has another task"
        return TaskReason.NO_FREE_CAR, "every car that could take it has another task"


def _why_given(costs: CostMatrix, car: int, column: int) -> str:
    """Why a car gets the task of a column, in words: what it costs the car, and the others that it costs least."""
    cost_s = costs.cost_s[:, column]
    order = [k for k in np.argsort(cost_s, kind="stable")[: OTHERS_TOLD + 1].tolist() if np.isfinite(cost_s[k])]
    others = [f"car_{costs.cars[k]} {cost_s[k]:.1f} s" for k in order if costs.cars[k] != car][:OTHERS_TOLD]
    beside = f" (others: {', '.join(others)})" if others else ""
    return f"car_{car} was the allocator's choice, its cost is {costs.of_pair(car, column):.1f} s{beside}"


def _in_turn(assignment: Assignment) -> Iterable[tuple[int, int]]:
    """Pairs of a vehicle and a task, those of a vehicle in the order in which it is to do them."""
    if assignment.sequence:
        return [(row, task) for row, planned in enumerate(assignment.sequence) for task in planned]
    return [(row, task) for row, task in assignment.pairs.tolist()]
