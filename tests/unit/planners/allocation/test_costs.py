"""What a task costs, against numbers worked out by hand."""

import math

import numpy as np
import numpy.typing as npt

from planners.allocation.costs import CostWeights, TaskCosts, task_costs

WEIGHTS = CostWeights(lateness=2.0, ageing=0.5, next_turn=3.0)


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


def test_only_the_vehicle_that_brings_it_late_pays_for_lateness() -> None:
    """The vehicles end at 136 s and 156 s; left to the next turn the best one would end at 172 s."""
    found = costs(due_s=[150.0])
    assert found.pressure_s.tolist() == [66.0]  # 3 x 22 s
    assert found.cost_s.tolist() == [[10.0 - 66.0], [30.0 + 2 * 6.0 - 66.0]]


def test_a_late_task_is_cheaper_for_every_vehicle_than_one_in_time() -> None:
    found = costs(
        travel_s=((10.0, 10.0), (30.0, 30.0)),
        due_s=(120.0, math.inf),
        since_s=(100.0, 100.0),
        weights=CostWeights(lateness=1.0, ageing=0.5, next_turn=1.0),
    )
    # Late by 16 s and 36 s, by 52 s in the next turn.
    assert found.cost_s.tolist() == [[10.0 + 16.0 - 52.0, 10.0], [30.0 + 36.0 - 52.0, 30.0]]


def test_each_weight_weighs_its_own_term() -> None:
    only_age = costs(due_s=[130.0], since_s=[60.0], weights=CostWeights(lateness=0.0, ageing=1.0, next_turn=0.0))
    assert only_age.cost_s.tolist() == [[-30.0], [-10.0]]
    only_late = costs(due_s=[130.0], since_s=[60.0], weights=CostWeights(lateness=1.0, ageing=0.0, next_turn=0.0))
    assert only_late.cost_s.tolist() == [[16.0], [56.0]]
    only_next = costs(due_s=[130.0], since_s=[60.0], weights=CostWeights(lateness=0.0, ageing=0.0, next_turn=1.0))
    assert only_next.cost_s.tolist() == [[10.0 - 42.0], [30.0 - 42.0]]


def test_no_task_has_no_cost() -> None:
    found = costs(travel_s=np.zeros((2, 0)), due_s=(), since_s=())
    assert found.cost_s.shape == (2, 0)
    assert found.pressure_s.shape == (0,)
