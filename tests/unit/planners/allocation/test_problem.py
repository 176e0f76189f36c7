"""Malformed problems are refused by one line that names the field, the place, the value and what is valid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planners.allocation.problem import AllocationProblem, TaskError
from planners.allocation.shop import Shop, ShopError


def shop(**changes: Any) -> Shop:
    """Two vehicles, three jobs; the first has two errands."""
    fields: dict[str, Any] = {
        "travel_s": np.ones((3, 3)),
        "start": np.array([0, 1]),
        "ready_s": np.zeros(2),
        "first_errand": np.array([0, 2, 3, 4]),
        "place": np.array([0, 1, 2, 0]),
        "station": np.array([0, -1, 0, 1]),
        "service_s": np.ones(4),
        "free_s": np.zeros(2),
        "n_buffer_places": np.array([1, 2]),
    }
    return Shop(**(fields | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"class_of": np.zeros(2)}, r"class_of has shape \(2,\); valid: \(3,\)"),
        ({"class_of": np.array([0, -1, 0])}, r"class_of\[1\] = -1"),
        ({"since_s": np.array([0.0, 1.0, np.nan])}, r"since_s\[2\] = nan"),
        ({"held": np.array([0, 3])}, r"held\[1\] = 3; valid: 0\.\.2, or -1"),
        ({"held": np.array([1, 1])}, r"task 1 twice"),
        ({"keep_gain": -1.0}, r"keep_gain = -1"),
        ({"keep_share": 2.0}, r"keep_share = 2"),
    ],
)
def test_what_is_said_beside_the_costs_is_checked(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(TaskError, match=message):
        AllocationProblem(cost=np.zeros((2, 3)), **changes)


def test_a_shop_has_the_vehicles_and_tasks_of_its_problem() -> None:
    AllocationProblem(cost=np.zeros((2, 3)), shop=shop())
    with pytest.raises(TaskError, match=r"\(2, 3\); valid: \(3, 2\)"):
        AllocationProblem(cost=np.zeros((3, 2)), shop=shop())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"travel_s": np.ones((3, 2))}, r"travel_s has shape \(3, 2\)"),
        ({"travel_s": np.full((3, 3), -1.0)}, r"travel_s\[0, 0\] = -1.0; valid: a number >= 0 or inf"),
        ({"start": np.array([0, 3])}, r"start\[1\] = 3; valid: 0\.\.2"),
        ({"ready_s": np.zeros(3)}, r"ready_s has shape \(3,\); valid: \(2,\)"),
        ({"first_errand": np.array([0, 2, 2, 4])}, r"first_errand = \[0, 2, 2, 4\]"),
        ({"station": np.array([0, -1, 0, 2])}, r"station\[3\] = 2; valid: -1\.\.1"),
        ({"service_s": np.full(4, np.inf)}, r"service_s\[0\] = inf"),
        ({"n_buffer_places": np.array([1, 0])}, r"n_buffer_places\[1\] = 0; valid: at least 1"),
        ({"due_s": np.array([1.0, np.inf, np.nan])}, r"due_s\[2\] = nan; valid: a number or inf"),
        ({"weight": np.array([1.0, -1.0, 1.0])}, r"weight\[1\] = -1.0"),
        ({"makespan_weight": np.inf}, r"makespan_weight = inf"),
    ],
)
def test_a_malformed_shop_is_refused_by_place(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ShopError, match=message):
        shop(**changes)


def test_a_held_task_is_cheaper_by_the_larger_of_gain_and_share() -> None:
    held = np.array([1, 0])
    problem = AllocationProblem(cost=np.array([[9.0, 100.0], [20.0, 9.0]]), held=held, keep_gain=5.0, keep_share=0.1)
    assert problem.choice_cost().tolist() == [[9.0, 90.0], [15.0, 9.0]]
    assert problem.cost[1, 0] == 20.0
