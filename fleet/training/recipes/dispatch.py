"""Recipe of dispatch: cars choose their tasks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fleet.envs.dispatch.view import N_OWN, N_PER_CANDIDATE
from fleet.envs.policies.policy import Policy
from fleet.training.layout import Group, Layout
from fleet.training.recipes.recipe import Recipe
from fleet.training.settings import PpoConfig


def _dispatch(*, weights: Mapping[str, float] | None = None, **arguments: Any) -> Any:
    from fleet.envs.dispatch.env import DispatchWeights, parallel_env

    return parallel_env(weights=DispatchWeights(**weights or {}), **arguments)


def _nearest() -> Policy:
    from fleet.envs.policies.dispatch import Nearest

    return Nearest()


DISPATCH = Recipe(
    summary="cars choose their tasks",
    make=_dispatch,
    scripted=_nearest,
    script="every free car takes the nearest task",
    figures=("delivered", "late", "waiting"),
    n_steps=2_000_000,
    ppo=PpoConfig(horizon_n=240, minibatch_n=4096, entropy=0.003, discount=0.98, learning_rate=1e-3),
    layouts={"car": Layout(groups=(Group(first=N_OWN, n_each=N_PER_CANDIDATE),), chosen=0)},
    # A car that pays for the lateness of what it delivers leaves late tasks to the others, which do the same.
    arguments={"site": "small", "n_cars": 6, "weights": {"late": -0.02, "empty": -0.03}},
)
