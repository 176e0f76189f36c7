"""Instances that contradict themselves are refused by name."""

from __future__ import annotations

import numpy as np
import pytest

from planners.mapf.problem import Instance, InstanceError
from tests.unit.planners.mapf.lanes import graph_of, instance_of, open_grid


def test_two_agents_in_one_cell_are_refused_even_in_different_states() -> None:
    graph = graph_of([0, 1, 1], [(0, 1)])
    with pytest.raises(InstanceError, match="agents 0 and 1 both start in cell 1"):
        instance_of(graph, [1, 2])


@pytest.mark.parametrize(
    ("starts", "goals", "match"),
    [([0, 4], None, r"starts\[1\] = 4; valid: states 0\.\.3"), ([0], [-2], r"goals\[0\] = -2; valid: states -1\.\.3")],
)
def test_a_state_that_does_not_exist_is_refused(starts: list[int], goals: list[int] | None, match: str) -> None:
    with pytest.raises(InstanceError, match=match):
        instance_of(open_grid(1, 4), starts, goals)


def test_an_array_of_the_wrong_length_is_refused() -> None:
    with pytest.raises(InstanceError, match=r"stay has shape \(1,\); valid: \(2,\)"):
        instance_of(open_grid(1, 4), [0, 1], stay=[True])


def test_blocked_counts_cells() -> None:
    plain = instance_of(open_grid(1, 4), [0])
    with pytest.raises(InstanceError, match=r"blocked has shape \(3,\)"):
        Instance(**{**vars(plain), "blocked": np.zeros(3, dtype=np.bool_)})


def test_a_negative_horizon_is_refused() -> None:
    with pytest.raises(InstanceError, match="horizon = -1"):
        instance_of(open_grid(1, 4), [0], horizon=-1)


def test_a_priority_that_is_no_number_is_refused() -> None:
    with pytest.raises(InstanceError, match=r"priorities\[1\] = nan"):
        instance_of(open_grid(1, 4), [0, 1], priorities=[1.0, float("nan")])
