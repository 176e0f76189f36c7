"""RowLayout: it fits the observations and the actions, or says what does not."""

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from fleet.training.errors import TrainingError
from fleet.training.layout import Group, RowLayout


def test_things_that_actions_choose_among_are_counted_by_the_actions() -> None:
    layout = RowLayout(groups=(Group(first=2, n_each=3),), chosen=0).sized("car", 10, Discrete(3))
    assert layout.groups[0].n_things == 2
    assert layout.own(10) == [0, 1, 8, 9]


def test_things_may_be_as_many_as_actions() -> None:
    group = Group(first=0, n_each=1, n_things=5)
    assert RowLayout(groups=(group,), chosen=0).sized("car", 5, Discrete(5)).groups == (group,)


@pytest.mark.parametrize(
    ("groups", "chosen", "words"),
    [
        ((Group(first=0, n_each=2),), None, "group 0 has None things; valid: an integer >= 1"),
        ((Group(first=0, n_each=2, n_things=6),), None, r"groups take \[\(0, 12\)\] of 10 numbers"),
        ((Group(first=0, n_each=2, n_things=2), Group(first=3, n_each=1, n_things=1)), None, "none twice"),
        ((Group(first=-1, n_each=2, n_things=2),), None, "inside"),
        ((Group(first=0, n_each=1, n_things=5),), 0, "3 actions choose among 5 things; valid: as many, or one more"),
    ],
)
def test_what_does_not_fit_is_refused(groups: tuple[Group, ...], chosen: int | None, words: str) -> None:
    with pytest.raises(TrainingError, match=words):
        RowLayout(groups=groups, chosen=chosen).sized("car", 10, Discrete(3))


def test_continuous_actions_choose_nothing() -> None:
    layout = RowLayout(groups=(Group(first=0, n_each=1, n_things=2),), chosen=0)
    with pytest.raises(TrainingError, match="0 actions choose among 2 things"):
        layout.sized("car", 10, Box(-1, 1, (2,), np.float32))


def test_numbers_that_are_not_shown_are_some_of_the_observation() -> None:
    tip = Box(-1, 1, (2,), np.float32)
    assert RowLayout(unseen=(0, 9)).sized("arm", 10, tip).unseen == (0, 9)
    with pytest.raises(TrainingError, match="layout of arm: number 10 is unseen; valid: from 0 to 9"):
        RowLayout(unseen=(3, 10)).sized("arm", 10, tip)
