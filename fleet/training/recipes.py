"""Recipes: what can be trained, with which settings, and which script it is measured against."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from fleet.envs.core.env_config import UnknownSetting
from fleet.envs.policies.policy import Policy
from fleet.training.batch import ChoiceLayout
from fleet.training.errors import TrainingError
from fleet.training.row_policy import RowPolicy
from fleet.training.settings import PpoConfig
from fleet.training.solo import SoloEnv


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """An environment and how it is learned."""

    summary: str
    """What agents learn."""
    make: Callable[..., Any]
    """Makes the environment from its arguments."""
    scripted: Callable[[], Policy]
    """Makes the policy to compare with."""
    script: str
    """What that one does, in words."""
    figures: tuple[str, ...]
    """Names in `infos` whose sums over an episode are reported; the first is what it is all about."""
    n_steps: int
    """Steps of agents."""
    ppo: PpoConfig
    choice: ChoiceLayout | None = None
    """How observations with a mask are made up, if actions choose among alike things."""
    arguments: dict[str, Any] = field(default_factory=dict)
    """Arguments of the environment that differ from its own defaults."""

    def check(self, arguments: dict[str, Any]) -> None:
        """Make the environment once, so that a mistake shows before the run begins.

        Raises:
            TrainingError: The environment does not know an argument.
            ConfigError: A value is outside its valid range.
        """
        try:
            self.make(**arguments).close()
        except UnknownSetting as error:
            raise TrainingError(f"[env]: {error}") from error
        except TypeError as error:  # of a single robot's environment
            raise TrainingError(f"[env]: {error}; valid: the arguments of the environment") from error


def _navigate(**arguments: Any) -> Any:
    from fleet.envs.navigate_v1 import parallel_env

    return parallel_env(**arguments)


def _pursuit() -> Policy:
    from fleet.envs.navigate.navigation_policy import PursuitPolicy

    return PursuitPolicy()


def _dispatch(*, weights: Mapping[str, float] | None = None, **arguments: Any) -> Any:
    from fleet.envs.dispatch.env import DispatchWeights, parallel_env

    return parallel_env(weights=DispatchWeights(**weights or {}), **arguments)


def _nearest() -> Policy:
    from fleet.envs.policies.dispatch import Nearest

    return Nearest()


def _car(**arguments: Any) -> Any:
    from fleet.envs.navigate.car_navigate import CarNavigateEnv

    return SoloEnv(CarNavigateEnv(**arguments), "car_0")


def _reach(**arguments: Any) -> Any:
    from fleet.envs.kuka_reach import KukaReachEnv

    return SoloEnv(KukaReachEnv(**arguments), "arm_0")


def _straight() -> Policy:
    from fleet.envs.kuka_reach import ReachPolicy

    return RowPolicy(ReachPolicy().actions)


RECIPES: dict[str, Recipe] = {
    "navigate": Recipe(
        summary="cars drive to places, among each other",
        make=_navigate,
        scripted=_pursuit,
        script="pure pursuit that brakes for what is ahead",
        figures=("places", "touch", "towed"),
        n_steps=1_500_000,
        ppo=PpoConfig(learning_rate=1e-3),
    ),
    "car": Recipe(
        summary="one car drives to places, among cars that a script drives",
        make=_car,
        scripted=_pursuit,
        script="pure pursuit that brakes for what is ahead",
        figures=("places", "touch", "towed"),
        n_steps=1_000_000,
        ppo=PpoConfig(envs_n=16, horizon_n=256),
    ),
    "reach": Recipe(
        summary="a Kuka brings its tool to a point",
        make=_reach,
        scripted=_straight,
        script="straight to the goal, by damped least squares",
        figures=("is_success",),
        n_steps=400_000,
        ppo=PpoConfig(
            envs_n=32,
            horizon_n=64,
            epochs_n=8,
            minibatch_n=512,
            learning_rate=2e-3,
            discount=0.95,
            log_std=-1.0,
        ),
        # A physical arm that is alone follows its targets to millimetres; without physics a step costs a tenth.
        arguments={"fidelity": "kinematic"},
    ),
    "dispatch": Recipe(
        summary="cars choose their tasks",
        make=_dispatch,
        scripted=_nearest,
        script="every free car takes the nearest task",
        figures=("delivered", "late", "waiting"),
        n_steps=2_000_000,
        ppo=PpoConfig(horizon_n=240, minibatch_n=4096, entropy=0.003, discount=0.98, learning_rate=1e-3),
        choice=ChoiceLayout(n_own=12, n_each=11),  # fleet.envs.dispatch.view: N_OWN, N_PER_CANDIDATE
        # A car that pays for the lateness of what it delivers leaves late tasks to the others, which do the same.
        arguments={"site": "small", "n_cars": 6, "weights": {"late": -0.02, "empty": -0.03}},
    ),
}
"""What can be trained, by name."""
