"""The referee is tested on assignments that are broken by hand."""

from __future__ import annotations

import numpy as np
import pytest

from planners.allocation.problem import AllocationProblem, Assignment, CostError
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
