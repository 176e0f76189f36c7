"""What a task costs, against numbers worked out by hand."""

import math

import numpy as np
import numpy.typing as npt
import pytest

from planners.allocation.costs import CostWeights, TaskCosts, task_costs

WEIGHTS = CostWeights(lateness=2.0, ageing=0.5, due=3.0)
NO_DUE_DATES = WEIGHTS._replace(due=0.0)


def costs(
    *,
    travel_s: npt.ArrayLike = ((10.0,), (30.0,)),
    due_s: npt.ArrayLike = (math.inf,),
    since_s: npt.ArrayLike = (100.0,),
    weights: CostWeights = WEIGHTS,
) -> TaskCosts:
    """Two vehicles, 10 and 30 s away from tasks of 20 s of travel and 6 s of service; it is 100 s."""
    travel = np.array(travel_s, dtype=float)
    return task_costs(
        travel_s=travel,
        rest_s=np.full(travel.shape[1], 20.0),
        service_s=np.full(travel.shape[1], 6.0),
        since_s=np.array(since_s, dtype=float),
        due_s=np.array(due_s, dtype=float),
        now_s=100.0,
        weights=weights,
    )


def test_a_task_that_is_new_and_never_late_costs_its_travel() -> None:
    found = costs()
    assert found.cost_s.tolist() == [[10.0], [30.0]]
    assert found.pressure_s.tolist() == [0.0]


def test_a_task_that_has_waited_presses_for_its_age() -> None:
    found = costs(since_s=[60.0])
    assert found.pressure_s.tolist() == [20.0]  # 0.5 x 40 s
    assert found.cost_s.tolist() == [[-10.0], [10.0]]


def test_a_task_with_a_due_date_ages_from_that_on() -> None:
    assert costs(since_s=[60.0], due_s=[130.0], weights=NO_DUE_DATES).pressure_s.tolist() == [0.0]
    assert costs(since_s=[60.0], due_s=[80.0], weights=NO_DUE_DATES).pressure_s.tolist() == [10.0]


def test_only_the_vehicle_that_brings_it_later_pays_for_lateness() -> None:
    """The vehicles end at 136 s and 156 s."""
    assert costs(due_s=[150.0], weights=NO_DUE_DATES).cost_s.tolist() == [[10.0], [30.0 + 2 * 6.0]]
    # Late with both: only by how much it is later counts.
    assert costs(due_s=[120.0], weights=NO_DUE_DATES._replace(ageing=0.0)).cost_s.tolist() == [
        [10.0],
        [30.0 + 2 * 20.0],
    ]


def test_a_task_whose_time_is_used_up_presses_most() -> None:
    """Tasks take 36 s at least; three of them, with 0, 72 (the look-ahead) and infinite time to spare."""
    travel = np.full((2, 3), 10.0)
    found = costs(travel_s=travel, due_s=(136.0, 136.0 + 2 * 36.0, math.inf), since_s=(100.0,) * 3)
    assert found.pressure_s.tolist() == pytest.approx([3 * 36.0, 3 * 36.0 / math.e, 0.0])
    late = costs(travel_s=travel[:, :1], due_s=(110.0,), since_s=(100.0,))
    assert late.pressure_s.tolist() == [3 * 36.0]  # no more than what is just in time


def test_of_two_tasks_that_press_the_shorter_one_presses_more() -> None:
    """They take 36 s and 66 s, 51 s on average."""
    found = costs(travel_s=((10.0, 40.0), (30.0, 60.0)), due_s=(100.0, 100.0), since_s=(100.0, 100.0))
    assert found.pressure_s.tolist() == pytest.approx([3 * 51 * 51 / 36, 3 * 51 * 51 / 66])


def test_a_pair_that_is_not_allowed_stays_so_and_tells_nothing() -> None:
    found = costs(travel_s=((10.0, math.inf), (math.inf, math.inf)), due_s=(110.0, 110.0), since_s=(100.0, 100.0))
    assert found.cost_s[:, 1].tolist() == [math.inf, math.inf]
    assert found.cost_s[1, 0] == math.inf
    assert found.pressure_s[0] == 3 * 36.0
    assert np.isfinite(costs(travel_s=((math.inf,), (math.inf,))).pressure_s).all()


def test_no_task_has_no_cost() -> None:
    found = costs(travel_s=np.zeros((2, 0)), due_s=(), since_s=())
    assert found.cost_s.shape == (2, 0)
    assert found.pressure_s.shape == (0,)
