"""VectorBatch says what an EnvBatch of the same environments says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from fleet.envs import dispatch_v1, traffic_v1
from fleet.training.batch import BatchStep, EnvBatch, TypeView
from fleet.training.errors import TrainingError
from fleet.training.layout import Group, RowLayout
from fleet.training.vector_batch import VectorBatch

CHOICE = RowLayout(groups=(Group(first=12, n_each=11),), chosen=0)
CASES: dict[str, tuple[Any, list[dict[str, Any]], Mapping[str, RowLayout], int]] = {
    "dispatch, a choice": (
        dispatch_v1.parallel_env,
        [{"site": "small", "n_cars": 3, "max_cycles": 20}] * 3,
        {"car": CHOICE},
        0,
    ),
    "traffic, teams mixed": (
        traffic_v1.parallel_env,
        [{"site": "small", "n_cars": n, "max_cycles": 20} for n in (2, 4, 2, 3)],
        {},
        1100,
    ),
}
FIGURES = ("delivered", "waiting", "nothing")


def assert_same_views(one: Mapping[str, TypeView], other: Mapping[str, TypeView]) -> None:
    assert one.keys() == other.keys()
    for name, view in one.items():
        for field in ("rows", "mask", "active", "state"):
            np.testing.assert_array_equal(getattr(view, field), getattr(other[name], field))


def assert_same_last(one: BatchStep, other: BatchStep) -> None:
    assert one.last.keys() == other.last.keys()
    for name, view in other.last.items():
        asked = other.truncated[name]
        for field in ("rows", "mask", "active", "state"):
            if getattr(view, field) is not None:
                np.testing.assert_array_equal(getattr(one.last[name], field)[asked], getattr(view, field)[asked])


@pytest.mark.parametrize("case", CASES)
def test_it_says_what_the_environments_say(case: str) -> None:
    make, dealt, layouts, n_state = CASES[case]
    told: dict[str, Any] = {"figures": FIGURES, "layouts": layouts, "n_state": n_state}
    batch, loop = VectorBatch(make, dealt, **told), EnvBatch([make(**one) for one in dealt], **told)
    assert batch.types == loop.types
    assert batch.n_agents == loop.n_agents
    rng = np.random.default_rng(0)
    seeds = list(range(len(dealt)))
    cuts = [7, 13, 0, 20][: len(dealt)]
    n_last = 0
    for cut in (cuts, None):
        batch.reset(seeds, cut)
        loop.reset(seeds, cut)
        for _ in range(45):
            assert_same_views(batch.views, loop.views)
            mask = batch.views["car"].mask
            assert mask is not None
            actions = {"car": (rng.random(mask.shape) * mask).argmax(axis=1)}
            one, other = batch.step(actions), loop.step(actions)
            for name in ("rewards", "ended", "truncated"):
                np.testing.assert_equal(getattr(one, name), getattr(other, name))
            assert_same_last(one, other)
            n_last += bool(one.last)
            assert len(one.episodes) == len(other.episodes)
            key = lambda episode: (episode.length, sorted(episode.returns.items()))  # noqa: E731
            for mine, its in zip(sorted(one.episodes, key=key), sorted(other.episodes, key=key), strict=True):
                assert mine.length == its.length
                assert mine.returns == pytest.approx(its.returns)
                assert mine.figures == pytest.approx(its.figures)
    assert n_last > 4
    batch.close()
    loop.close()


def test_agents_of_a_type_are_alike_in_all() -> None:
    dealt = [{"site": "small", "n_cars": 2, "candidates_n": k} for k in (3, 4)]
    with pytest.raises(TrainingError, match="valid: the same in all"):
        VectorBatch(dispatch_v1.parallel_env, dealt)
