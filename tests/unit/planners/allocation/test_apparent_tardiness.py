"""ApparentTardiness: which pair goes first, against indices worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from planners.allocation.apparent_tardiness import ApparentTardiness
from planners.allocation.problem import AllocationProblem
from planners.allocation.shop import NO_STATION, Shop

TAKES_S = (20.0, 60.0)
"""Time from the only vehicle to the end of each of two jobs; 40 s on average."""


def taken(*due_s: float, held: int = -1, ready_s: float = 0.0) -> list[list[int]]:
    """What one vehicle takes of two jobs that it drives to, 5 s of which it stands."""
    way_s = np.array(TAKES_S) - 5.0
    travel_s = np.array([[0.0, *way_s], [np.inf, 0.0, np.inf], [np.inf, np.inf, 0.0]])
    shop = Shop(
        travel_s=travel_s,
        start=np.array([0], dtype=np.int32),
        ready_s=np.array([ready_s]),
        first_errand=np.array([0, 1, 2], dtype=np.int32),
        place=np.array([1, 2], dtype=np.int32),
        station=np.full(2, NO_STATION, dtype=np.int32),
        service_s=np.full(2, 5.0),
        due_s=np.array(due_s),
    )
    own = np.array([held], dtype=np.int32)
    problem = AllocationProblem(cost=np.array([TAKES_S]), shop=shop, held=own, keep_gain=50.0)
    return ApparentTardiness().allocate(problem).pairs.tolist()


def test_of_two_jobs_that_do_not_press_the_shorter_one_goes_first() -> None:
    assert taken(np.inf, np.inf) == [[0, 0]]


def test_of_two_late_jobs_the_shorter_one_goes_first() -> None:
    assert taken(0.0, 0.0) == [[0, 0]]


@pytest.mark.parametrize(("slack_s", "job"), [(80.0, 0), (90.0, 1)])
def test_a_job_three_times_as_long_goes_first_if_the_other_has_enough_time(slack_s: float, job: int) -> None:
    """exp(-slack / 80 s) falls below a third after 80 ln 3 = 87.9 s."""
    assert taken(TAKES_S[0] + slack_s, 0.0) == [[0, job]]


@pytest.mark.parametrize(("slack_s", "job"), [(80.0, 0), (90.0, 1)])
def test_time_to_spare_begins_when_the_vehicle_is_ready(slack_s: float, job: int) -> None:
    assert taken(1000.0 + TAKES_S[0] + slack_s, 0.0, ready_s=1000.0) == [[0, job]]


def test_a_job_with_a_due_date_goes_before_one_without() -> None:
    assert taken(np.inf, 100.0) == [[0, 1]]


def test_what_is_held_is_kept_unless_much_is_gained() -> None:
    assert taken(0.0, 0.0, held=1) == [[0, 1]]
