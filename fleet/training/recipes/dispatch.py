"""Recipe of dispatch: cars choose their tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from fleet.envs.dispatch.scenarios import SCENARIOS
from fleet.training.layout import Group, RowLayout
from fleet.training.recipes.recipe import Recipe, TrainingStage, on_floor
from fleet.training.settings import PpoConfig

if TYPE_CHECKING:
    from fleet.envs.policies.policy import Policy
    from fleet.training.batch import Batch

LAYOUT = RowLayout(groups=(Group(first=12, n_each=11),), chosen=0)
"""Tasks on offer; numbers as in `fleet.envs.dispatch.view`: N_OWN, N_PER_CANDIDATE."""


def _dispatch(
    *, weights: Mapping[str, float] | None = None, floor: Mapping[str, Any] | None = None, **arguments: Any
) -> Any:
    from fleet.envs.dispatch.env import DispatchWeights, parallel_env

    return parallel_env(weights=DispatchWeights(**weights or {}), **on_floor(arguments, floor))


def _side_by_side(dealt: Sequence[Mapping[str, Any]], **told: Any) -> Batch:
    from fleet.training.vector_batch import VectorBatch

    return VectorBatch(_dispatch, dealt, **told)


def _nearest() -> Policy:
    from fleet.envs.policies.dispatch import Nearest

    return Nearest()


def _apparent_tardiness() -> Policy:
    from fleet.envs.policies import make_policy

    return make_policy("dispatch", "apparent_tardiness")


def _rollout() -> Policy:
    from fleet.envs.policies.rollout import RolloutPolicy

    return RolloutPolicy()


def tardiness_min(env: Any) -> float:
    """Tardiness of all orders that have come in, delivered or not, at the end of an episode on the grid [min]."""
    from fleet.envs.grid.fleet import TIMESTEP_S, late_steps

    grid = env.fleet.grid
    return float(late_steps(grid.tasks, grid.now).sum()) * TIMESTEP_S / 60.0


DISPATCH = Recipe(
    summary="cars choose their tasks",
    make=_dispatch,
    batch=_side_by_side,
    scripted=_nearest,
    script="every free car takes the nearest task",
    figures=("delivered", "late", "waiting"),
    n_steps=2_000_000,
    ppo=PpoConfig(horizon_n=240, minibatch_n=4096, entropy=0.003, discount=0.98, learning_rate=1e-3),
    layouts={"car": LAYOUT},
    # A car that pays for the lateness of what it delivers leaves late tasks to the others, which do the same.
    arguments={"site": "small", "n_cars": 6, "weights": {"late": -0.02, "empty": -0.03}},
)
_FLOORS = (
    {"rows": 24, "cols": 16, "pick": 3, "drop": 3, "parking": 12},
    {"rows": 16, "cols": 26, "pick": 3, "drop": 3, "parking": 12},
    {"rows": 18, "cols": 18, "pick": 4, "drop": 4, "parking": 16},
    {"rows": 20, "cols": 28, "pick": 4, "drop": 4, "parking": 16},
)
"""Other floors than the one that it is evaluated on: what was learned on one floor only helps little on others."""
DISPATCH_DUE = Recipe(
    summary="cars choose their tasks, and due dates count",
    make=_dispatch,
    scripted=_apparent_tardiness,
    script="the apparent tardiness cost rule",
    figures=("delivered", "late", "waiting"),
    at_end={"tardiness_min": tardiness_min},
    # All of them clone: a rollout that half of the environments only ask, while agents do what they have learned.
    n_steps=360_000,
    ppo=PpoConfig(
        horizon_n=240,
        minibatch_n=512,
        learning_rate=1e-3,
        network="attention",
        clone_n=360_000,
        # Of 11,520 steps of an update some 1,100 are choices.
        clone_all=True,
    ),
    layouts={"car": LAYOUT},
    teacher=_rollout,
    stages=(TrainingStage(name="floors", mix=tuple(mixed for floor in _FLOORS for mixed in ({}, {"floor": floor}))),),
    arguments={**SCENARIOS["due_rush"].arguments, "weights": {"late": -0.3, "waiting": -0.2, "empty": 0.0}},
)
