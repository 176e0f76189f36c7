"""Recipe of reaching: a Kuka brings its tool to a point."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fleet.training.recipes.recipe import Recipe
from fleet.training.settings import PpoConfig

if TYPE_CHECKING:
    from fleet.envs.policies.policy import Policy


def _reach(**arguments: Any) -> Any:
    from fleet.envs.kuka_reach import KukaReachEnv
    from fleet.training.solo import SoloEnv

    return SoloEnv.of(KukaReachEnv, "arm_0", "kuka_reach_v0", arguments)


def _straight() -> Policy:
    from fleet.envs.kuka_reach import ReachPolicy
    from fleet.training.row_policy import RowPolicy

    return RowPolicy(ReachPolicy().actions)


REACH = Recipe(
    summary="a Kuka brings its tool to a point",
    make=_reach,
    scripted=_straight,
    script="straight to the goal, by damped least squares",
    figures=("is_success",),
    shares=frozenset({"is_success"}),
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
)
