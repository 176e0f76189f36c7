"""Every pair that was not chosen has the reason a person would give."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planners.allocation import ALLOCATORS
from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.allocation.reasons import Reason, reasons
from planners.status import Status

INF = np.inf


def told(cost: list[list[float]], pairs: list[tuple[int, int]], **more: Any) -> list[list[Reason]]:
    problem = AllocationProblem(cost=np.array(cost), **more)
    found = reasons(problem, assignment(problem, pairs, Status.FEASIBLE))
    return [[Reason(code) for code in row] for row in found]


def test_the_task_went_to_a_nearer_vehicle_and_the_vehicle_to_a_nearer_task() -> None:
    assert told([[1.0], [2.0]], [(0, 0)]) == [[Reason.CHOSEN], [Reason.TASK_GOT_NEARER]]
    assert told([[1.0, 2.0]], [(0, 0)]) == [[Reason.CHOSEN, Reason.VEHICLE_GOT_BETTER]]


def test_a_pair_that_is_not_allowed_says_so_first() -> None:
    assert told([[1.0, INF]], [(0, 0)])[0][1] is Reason.NOT_ALLOWED


def test_a_cheap_pair_gives_way_to_the_whole() -> None:
    assert told([[1.0, 2.0], [2.0, 9.0]], [(0, 1), (1, 0)])[0][0] is Reason.BETTER_FOR_ALL


def test_a_more_urgent_task_came_first() -> None:
    found = told([[1.0, 9.0]], [(0, 1)], class_of=np.array([1, 0]))
    assert found == [[Reason.CLASS_FIRST, Reason.CHOSEN]]


def test_a_task_under_way_changes_hands_only_for_a_gain() -> None:
    held = np.array([0, -1])
    assert told([[9.0], [8.0]], [(0, 0)], held=held, keep_gain=5.0) == [[Reason.CHOSEN], [Reason.KEPT]]
    assert told([[9.0, 8.0]], [(0, 0)], held=np.array([0]), keep_gain=5.0) == [[Reason.CHOSEN, Reason.KEPT]]


def test_what_is_planned_ahead_is_not_rejected() -> None:
    problem = AllocationProblem(cost=np.array([[1.0, 2.0]]))
    ahead = Assignment(pairs=np.array([[0, 0]]), cost=1.0, status=Status.FEASIBLE, sequence=((0, 1),))
    assert reasons(problem, ahead)[0, 1] == Reason.PLANNED_LATER


def test_nobody_and_nothing_left_over() -> None:
    assert told([[3.0]], []) == [[Reason.LEFT_FOR_LATER]]
    assert reasons(*2 * [AllocationProblem(cost=np.zeros((0, 3)))]).shape == (0, 3)  # type: ignore[arg-type]


@pytest.mark.parametrize("allocator", ALLOCATORS)
@pytest.mark.parametrize("seed", range(3))
def test_exactly_the_pairs_are_chosen(allocator: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = np.where(rng.random((5, 7)) < 0.3, INF, rng.uniform(1.0, 9.0, (5, 7)))
    problem = AllocationProblem(cost=cost, class_of=rng.integers(0, 2, 7))
    answer = ALLOCATORS[allocator]().allocate(problem)
    found = reasons(problem, answer)
    assert np.argwhere(found == Reason.CHOSEN).tolist() == answer.pairs.tolist()
    assert ((found == Reason.NOT_ALLOWED) == np.isinf(cost)).all()
    assert not (found == Reason.LEFT_FOR_LATER).any()
    assert all(str(Reason(code)) for code in found.ravel())
