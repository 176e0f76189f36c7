"""Advantages: hand-computed returns, and what the end of an episode changes."""

import numpy as np
import pytest

from fleet.training.ppo.advantages import advantages


def column(*values: float) -> np.ndarray:
    return np.array(values, dtype=np.float32)[:, None]


def test_with_lambda_one_it_is_the_discounted_return_less_the_value() -> None:
    ended = np.zeros((3, 1), dtype=np.bool_)
    found = advantages(column(1, 2, 4), column(5, 6, 7), column(6, 7, 8), ended, discount=0.5, gae=1.0)
    assert found[:, 0].tolist() == [1 + 1 + 1 + 1 - 5, 2 + 2 + 2 - 6, 4 + 4 - 7]


def test_with_lambda_zero_it_is_the_error_of_one_step() -> None:
    ended = np.zeros((2, 1), dtype=np.bool_)
    found = advantages(column(1, 2), column(3, 4), column(4, 6), ended, discount=0.5, gae=0.0)
    assert found[:, 0].tolist() == [1 + 2 - 3, 2 + 3 - 4]


@pytest.mark.parametrize("after", [0.0, 10.0])
def test_nothing_is_taken_over_the_end_of_an_episode(after: float) -> None:
    """Terminated: nothing follows. Truncated: the value of the last state does."""
    ended = np.array([[True], [False]])
    found = advantages(column(1, 100), column(0, 0), column(after, 100), ended, discount=0.5, gae=1.0)
    assert found[0, 0] == 1 + 0.5 * after
