"""A budget is spent once."""

from __future__ import annotations

import pytest

from planners.deadline import Deadline
from planners.errors import PlanningError


def test_iterations_run_out() -> None:
    deadline = Deadline(3)
    assert [deadline.spend(2), deadline.spend(2), deadline.spend(), deadline.spend()] == [True, False, True, False]
    assert deadline.iterations == 3


def test_no_budget_never_ends() -> None:
    assert Deadline().spend(10**9)


def test_the_clock_ends_it_too() -> None:
    now = iter([10.0, 10.4, 10.6])
    deadline = Deadline(wall_s=0.5, clock=lambda: next(now))
    assert [deadline.spend(), deadline.spend()] == [True, False]


def test_without_a_wall_clock_budget_the_clock_is_not_read() -> None:
    def clock() -> float:
        raise AssertionError

    assert Deadline(1, clock=clock).spend()


@pytest.mark.parametrize("budget", [{"iterations": -1}, {"wall_s": -0.1}])
def test_a_negative_budget_is_refused(budget: dict[str, int]) -> None:
    with pytest.raises(PlanningError, match="valid: a number >= 0"):
        Deadline(**budget)
