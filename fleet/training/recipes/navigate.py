"""Recipes of driving: cars go to places, among each other."""

from __future__ import annotations

from typing import Any

from fleet.envs.policies.policy import Policy
from fleet.training.recipes.recipe import Recipe
from fleet.training.settings import PpoConfig
from fleet.training.solo import SoloEnv


def _navigate(**arguments: Any) -> Any:
    from fleet.envs.navigate_v0 import parallel_env

    return parallel_env(**arguments)


def _car(**arguments: Any) -> Any:
    from fleet.envs.navigate.car_navigate import CarNavigateEnv

    return SoloEnv(CarNavigateEnv(**arguments), "car_0")


def _pursuit() -> Policy:
    from fleet.envs.navigate.navigation_policy import PursuitPolicy

    return PursuitPolicy()


NAVIGATE = Recipe(
    summary="cars drive to places, among each other",
    make=_navigate,
    scripted=_pursuit,
    script="pure pursuit that brakes for what is ahead",
    figures=("places", "touch", "towed"),
    n_steps=1_500_000,
    ppo=PpoConfig(learning_rate=1e-3),
)

CAR = Recipe(
    summary="one car drives to places, among cars that a script drives",
    make=_car,
    scripted=_pursuit,
    script="pure pursuit that brakes for what is ahead",
    figures=("places", "touch", "towed"),
    n_steps=1_000_000,
    ppo=PpoConfig(envs_n=16, horizon_n=256),
)
