"""Recipes of driving: cars go to places, among each other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fleet.envs.policies.policy import Policy
from fleet.training.layout import Group, RowLayout
from fleet.training.recipes.recipe import Recipe, TrainingStage
from fleet.training.settings import PpoConfig
from fleet.training.solo import SoloEnv


def _navigate(*, weights: Mapping[str, float] | None = None, **arguments: Any) -> Any:
    from fleet.envs.navigate.navigation import NavigationWeights, parallel_env

    return parallel_env(weights=NavigationWeights(**weights or {}), **arguments)


def _car(**arguments: Any) -> Any:
    from fleet.envs.navigate.car_navigate import CarNavigateEnv

    return SoloEnv(CarNavigateEnv(**arguments), "car_0")


def _pursuit() -> Policy:
    from fleet.envs.navigate.navigation_policy import PursuitPolicy

    return PursuitPolicy()


CAR_LAYOUT = RowLayout(groups=(Group(first=19, n_each=16, n_things=4, present=0),))
"""Other cars; numbers as in `fleet.envs.navigate.rows`: FIRST_OTHER, N_PER_OTHER, N_OTHERS."""

_TEAMS = ({"n_cars": 6}, {"n_cars": 9}, {"n_cars": 6}, {"site": "twin", "n_cars": 3})

NAVIGATE = Recipe(
    summary="cars drive to places, among each other",
    make=_navigate,
    scripted=_pursuit,
    script="pure pursuit that brakes for what is ahead",
    figures=("places", "touches", "towed"),
    n_steps=2_500_000,
    # A touch that costs 10 is still worth a hurry: in physics such a policy touched twice as often as the script.
    arguments={"weights": {"touch": -30.0, "towed": -10.0}},
    stages=(
        TrainingStage(name="kinematic", mix=_TEAMS, longest=0.8),
        # How cars drift in sharp curves, and what it takes to get away from a wall.
        TrainingStage(name="physics", arguments={"fidelity": "physics"}, mix=_TEAMS),
    ),
    layouts={"car": CAR_LAYOUT},
    teacher=_pursuit,
    ppo=PpoConfig(learning_rate=1e-3, minibatch_n=2048, clone_n=60_000, log_std=-1.5),
)

CAR = Recipe(
    summary="one car drives to places, among cars that a script drives",
    make=_car,
    scripted=_pursuit,
    script="pure pursuit that brakes for what is ahead",
    figures=("places", "touches", "towed"),
    n_steps=1_000_000,
    ppo=PpoConfig(envs_n=16, horizon_n=256),
)
