"""Recipes of driving: cars go to places, among each other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from fleet.training.layout import Group, RowLayout
from fleet.training.recipes.recipe import Recipe, TrainingStage, weights_of
from fleet.training.settings import PpoConfig

if TYPE_CHECKING:
    from fleet.envs.policies.policy import Policy


def _navigate(*, weights: Mapping[str, float] | None = None, **arguments: Any) -> Any:
    from fleet.envs.navigate.navigation import NavigationWeights, parallel_env

    return parallel_env(weights=weights_of(NavigationWeights, weights), **arguments)


def _car(**arguments: Any) -> Any:
    from fleet.envs.navigate.car_navigate import CarNavigateEnv
    from fleet.training.solo import SoloEnv

    return SoloEnv.of(CarNavigateEnv, "car_0", "car_navigate_v1", arguments)


def _pursuit() -> Policy:
    from fleet.envs.navigate.navigation_policy import PursuitPolicy

    return PursuitPolicy()


def _backing(seed: int = 0) -> Policy:
    from fleet.envs.navigate.navigation_policy import BackingPolicy

    del seed  # it leaves nothing to chance
    return BackingPolicy()


CAR_LAYOUT = RowLayout(groups=(Group(first=19, n_each=16, n_things=4, present=0),))
"""Other cars; numbers as in `fleet.envs.navigate.rows`: FIRST_OTHER, N_PER_OTHER, N_OTHERS."""

_TEAMS = ({"n_cars": 6}, {"n_cars": 9}, {"n_cars": 16}, {"site": "twin", "n_cars": 3})

NAVIGATE = Recipe(
    summary="cars drive to places, among each other",
    make=_navigate,
    scripted=_pursuit,
    script="pure pursuit that brakes for what is ahead",
    figures=("places", "touches", "tows"),
    n_steps=6_600_000,
    # In physics friction holds noses at walls: where they slide along, nobody learns to reverse.
    arguments={"weights": {"touch": -20.0, "towed": -10.0}, "contact": "hold"},
    # Knocked from beginning to end: where cars are seldom stopped, how to reverse is forgotten again.
    stages=(TrainingStage(name="knocked", arguments={"knocks_per_min": 4.0}, mix=_TEAMS),),
    layouts={"car": CAR_LAYOUT},
    # To reverse is shown: who drives ahead with a little noise never tries it.
    teacher=_backing,
    ppo=PpoConfig(learning_rate=1e-3, minibatch_n=2048, clone_n=120_000, log_std=-1.5, anchor=0.01),
)

CAR = Recipe(
    summary="one car drives to places, among cars that a script drives",
    make=_car,
    scripted=_pursuit,
    script="pure pursuit that brakes for what is ahead",
    figures=("places", "touches", "tows"),
    n_steps=1_000_000,
    ppo=PpoConfig(envs_n=16, horizon_n=256),
)
