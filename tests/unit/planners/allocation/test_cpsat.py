"""The solver's plan is taken when it is better, and the note says who answered when it is not."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest

from planners.allocation.cpsat import CpSat, CpSatConfig
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.regret_lns import RegretLns, RegretLnsConfig
from planners.allocation.shop import Shop
from planners.allocation.validate import faults

solver = pytest.mark.skipif(importlib.util.find_spec("ortools") is None, reason="the package ortools is optional")


def problem_of(seed: int, n_jobs: int = 7, n_vehicles: int = 3) -> AllocationProblem:
    rng = np.random.default_rng(seed)
    places = rng.integers(0, 30, (2 * n_jobs + n_vehicles, 2))
    travel_s = np.abs(places[:, None] - places[None]).sum(axis=2).astype(np.float64)
    shop = Shop(
        travel_s=travel_s,
        start=np.arange(n_vehicles),
        ready_s=np.zeros(n_vehicles),
        first_errand=2 * np.arange(n_jobs + 1),
        place=n_vehicles + np.arange(2 * n_jobs),
        station=np.tile([0, -1], n_jobs),
        service_s=np.tile([12.0, 0.0], n_jobs),
        free_s=np.array([20.0]),
        n_buffer_places=np.array([2]),
        due_s=rng.uniform(50.0, 150.0, n_jobs),
        makespan_weight=float(n_jobs),
    )
    cost = travel_s[:n_vehicles, shop.place[::2]]
    cost[0, 1] = np.inf
    return AllocationProblem(cost=cost, shop=shop, held=np.array([2, -1, -1], dtype=np.int32), keep_gain=3.0)


def objective_of(problem: AllocationProblem, assignment: Assignment) -> float:
    assert faults(problem, assignment) == []
    assert assignment.timetable is not None
    return assignment.timetable.objective


@solver
@pytest.mark.parametrize("seed", range(2))
def test_it_improves_a_poor_plan_and_answers_the_same_again(seed: int) -> None:
    problem = problem_of(seed)
    poor = objective_of(problem, RegretLns(RegretLnsConfig(iterations=0)).allocate(problem))
    found = CpSat(CpSatConfig(iterations=0)).allocate(problem)
    assert objective_of(problem, found) < poor
    assert found.note == ""
    assert CpSat(CpSatConfig(iterations=0)).allocate(problem).sequence == found.sequence


@solver
def test_a_budget_that_is_too_small_says_so() -> None:
    note = CpSat(CpSatConfig(budget=1e-9)).allocate(problem_of(0)).note
    assert note.endswith("regret_lns answered")


def test_without_the_package_local_search_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ortools.sat.python", None)
    problem = problem_of(0)
    found = CpSat().allocate(problem)
    assert found.note == "cpsat: the package ortools is not installed (pip install '.[cpsat]'); regret_lns answered"
    assert found.sequence == RegretLns().allocate(problem).sequence


def test_without_a_shop_the_matching_answers() -> None:
    found = CpSat().allocate(AllocationProblem(cost=np.ones((2, 3))))
    assert len(found.pairs) == 2
    assert "no stations" in found.note
