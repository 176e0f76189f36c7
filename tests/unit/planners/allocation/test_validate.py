"""The referee is tested on assignments that are broken by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planners.allocation.problem import AllocationProblem, Assignment, CostError
from planners.allocation.shop import Shop, Timetable
from planners.allocation.validate import Fault, faults
from planners.status import Status

PROBLEM = AllocationProblem(cost=np.array([[1.0, np.inf, 3.0], [4.0, 5.0, 6.0]]))


def broken(pairs: list[tuple[int, int]], cost: float) -> list[Fault]:
    assignment = Assignment(pairs=np.array(pairs, dtype=np.int32).reshape(-1, 2), cost=cost, status=Status.FEASIBLE)
    return faults(PROBLEM, assignment)


def test_a_legal_assignment_has_no_faults() -> None:
    assert broken([(0, 2), (1, 0)], 7.0) == []
    assert broken([], 0.0) == []


def test_every_fault_is_named() -> None:
    assert broken([(0, 1)], 0.0) == [Fault(kind="not_allowed", pair=(0, 1))]
    assert broken([(2, 0)], 0.0) == [Fault(kind="unknown", pair=(2, 0))]
    assert broken([(0, -1)], 0.0) == [Fault(kind="unknown", pair=(0, -1))]
    assert broken([(1, 0), (1, 1)], 9.0) == [Fault(kind="vehicle_twice", pair=(1, -1))]
    assert broken([(0, 2), (1, 2)], 9.0) == [Fault(kind="task_twice", pair=(-1, 2))]
    assert broken([(0, 2)], 2.0) == [Fault(kind="cost", pair=None)]


@pytest.mark.parametrize("entry", [np.nan, -np.inf])
def test_a_cost_that_means_nothing_is_refused_by_place(entry: float) -> None:
    with pytest.raises(CostError, match=r"cost\[1, 0\]"):
        AllocationProblem(cost=np.array([[0.0], [entry]]))


def test_a_cost_without_columns_is_refused() -> None:
    with pytest.raises(CostError, match=r"shape \(2,\)"):
        AllocationProblem(cost=np.zeros(2))


SHOP = Shop(
    travel_s=np.array([[0.0, 5.0], [5.0, 0.0]]),
    start=np.array([0, 0]),
    ready_s=np.array([10.0, 10.0]),
    first_errand=np.arange(4),
    place=np.array([1, 1, 0]),
    station=np.array([0, 0, -1]),
    service_s=np.array([4.0, 4.0, 1.0]),
    free_s=np.array([16.0]),
    n_buffer_places=np.array([1]),
    release_s=np.array([0.0, 0.0, 26.0]),
    due_s=np.array([20.0, 22.0, np.inf]),
    makespan_weight=2.0,
)
AHEAD = ((0, 2), (1,))
ARRIVE_S, ENTER_S, START_S, END_S = [15.0, 15.0, 25.0], [15.0, 20.0, 25.0], [16.0, 20.0, 26.0], [20.0, 24.0, 27.0]
OBJECTIVE = 20.0 + 24.0 + 27.0 + 2.0 + 2.0 * 27.0
"""Ends, two seconds of lateness, the last end twice."""


def kinds_ahead(sequence: tuple[tuple[int, ...], ...] = AHEAD, **changes: Any) -> list[str]:
    """Faults of a plan in which one row of times, or the objective, is changed."""
    problem = AllocationProblem(cost=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, np.inf]]), shop=SHOP)
    times: dict[str, Any] = {"arrive_s": ARRIVE_S, "enter_s": ENTER_S, "start_s": START_S, "end_s": END_S} | changes
    objective = times.pop("objective", OBJECTIVE)
    rows = {name: np.array(row) for name, row in times.items()}
    timetable = Timetable(vehicle=np.array([0, 1, 0]), objective=objective, **rows)
    pairs = np.array([(0, 0), (1, 1)], dtype=np.int32)
    plan = Assignment(pairs=pairs, cost=0.0, status=Status.FEASIBLE, sequence=sequence, timetable=timetable)
    return [fault.kind for fault in faults(problem, plan)]


def test_a_legal_plan_has_no_faults() -> None:
    assert kinds_ahead() == []


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({"sequence": ((2, 0), (1,))}, "not_first"),
        ({"sequence": ((0,), (1, 2))}, "not_allowed"),
        ({"sequence": ((0, 0), (1,))}, "planned_twice"),
        ({"arrive_s": [14.0, 15.0, 25.0]}, "travel"),
        ({"arrive_s": [np.nan, 15.0, 25.0]}, "travel"),
        ({"end_s": [19.0, 24.0, 27.0]}, "service"),
        ({"start_s": [16.0, 20.0, 25.5], "end_s": [20.0, 24.0, 26.5]}, "release"),
        ({"start_s": [15.0, 20.0, 26.0], "end_s": [19.0, 24.0, 27.0]}, "closed"),
        ({"enter_s": [15.0, 19.0, 25.0], "start_s": [16.0, 19.0, 26.0], "end_s": [20.0, 23.0, 27.0]}, "overlap"),
        ({"enter_s": [15.0, 19.0, 25.0]}, "buffer"),
        ({"objective": OBJECTIVE + 1.0}, "objective"),
    ],
)
def test_every_fault_of_a_plan_is_named(changes: dict[str, Any], kind: str) -> None:
    assert kind in kinds_ahead(**changes)
