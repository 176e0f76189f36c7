"""Recipe of dispatch: cars choose their tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fleet.envs.dispatch.scenarios import SCENARIOS
from fleet.training.layout import Group, RowLayout
from fleet.training.recipes.recipe import Recipe, TrainingStage, on_floor, weights_of
from fleet.training.settings import PpoConfig

if TYPE_CHECKING:
    from fleet.envs.policies.policy import Policy
    from fleet.training.batch import Batch

LAYOUT = RowLayout(groups=(Group(first=12, n_each=19),), chosen=0)
"""Tasks on offer; numbers as in `fleet.envs.dispatch.view`: N_OWN, N_PER_CANDIDATE."""


POSE = (0, 1, 2, 3)
"""Where a car is and where it heads: what it learns of these on one floor is wrong on another."""


def _dispatch(
    *, weights: Mapping[str, float] | None = None, floor: Mapping[str, Any] | None = None, **arguments: Any
) -> Any:
    from fleet.envs.dispatch.env import DispatchWeights, parallel_env

    return parallel_env(weights=weights_of(DispatchWeights, weights), **on_floor(arguments, floor))


def _side_by_side(dealt: Sequence[Mapping[str, Any]], **told: Any) -> Batch:
    from fleet.training.vector_batch import VectorBatch

    return VectorBatch(_dispatch, dealt, **told)


def _nearest() -> Policy:
    from fleet.envs.policies.dispatch import Nearest

    return Nearest()


def _apparent_tardiness() -> Policy:
    from fleet.envs.policies import make_policy

    return make_policy("dispatch", "apparent_tardiness")


def _rollout(seed: int) -> Policy:
    from fleet.envs.policies.rollout import RolloutPolicy

    return RolloutPolicy(seed)


def tardiness_min(env: Any) -> float:
    """Tardiness of all orders that have come in, delivered or not, at the end of an episode on the grid [min]."""
    from fleet.abstract.fleet import TIMESTEP_S, late_steps

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


def _floors(*sizes: tuple[int, int, int], parking: int | None = None, **arguments: Any) -> tuple[dict[str, Any], ...]:
    """Arguments of the environment: generated floors of so many rows, columns, and stations of either kind.

    Args:
        sizes: One for each floor.
        parking: Parking cells; None = four for each pick station.
        arguments: Further ones of all of them.
    """
    return tuple(
        {**arguments, "floor": {"rows": rows, "cols": cols, "pick": n, "drop": n, "parking": parking or 4 * n}}
        for rows, cols, n in sizes
    )


_WAVES = SCENARIOS["due_waves"].arguments
"""Many cars, a choice of one of which decides little."""
_FEW = {**_WAVES, "site": "small", "n_cars": 6}
_FLOORS = _floors(
    *((24, 16, 3), (16, 26, 3), (18, 18, 4), (20, 28, 4), (13, 24, 3), (15, 34, 3)),
    *((22, 24, 4), (15, 26, 3), (18, 34, 4), (34, 16, 4), (28, 16, 4), (17, 30, 4)),
)
"""There are many, since what is learned on one helps little on others."""
_CROWDS = _floors((22, 24, 4), (18, 34, 4), (24, 28, 4), (28, 18, 4), (34, 16, 4), (20, 28, 4), parking=24, **_WAVES)
"""Waves on other floors than `medium`, for the same reason."""
_TRIED, _SHOWN = (({}, _WAVES, _FEW, *_CROWDS[k : k + 3], *_FLOORS[2 * k : 2 * k + 6]) for k in (0, 3))
"""Where agents do what they have learned, and the teacher says what it would do; and where the teacher does it."""
DISPATCH_DUE = Recipe(
    summary="cars choose their tasks, and due dates count",
    make=_dispatch,
    scripted=_apparent_tardiness,
    script="the apparent tardiness cost rule",
    figures=("delivered", "late", "waiting"),
    at_end={"tardiness_min": tardiness_min},
    # All of them clone: a rollout that half of the environments only ask, while agents do what they have learned.
    n_steps=800_000,
    ppo=PpoConfig(
        envs_n=len(_TRIED + _SHOWN),
        horizon_n=240,
        # All that was said is learned again in each update: with six each, some 60 times, floors are known by heart.
        epochs_n=2,
        minibatch_n=512,
        learning_rate=1e-3,
        network="attention",
        clone_n=800_000,
        # Of 53,760 steps of an update some 3,500 are choices.
        clone_all=True,
        # In deliveries. Most candidates are nearly alike, and which of them is best is chance; some are worth many.
        clone_temperature=2.0,
    ),
    layouts={"car": replace(LAYOUT, unseen=POSE)},
    teacher=_rollout,
    stages=(TrainingStage(name="floors", mix=_TRIED + _SHOWN),),
    arguments={**SCENARIOS["due_rush"].arguments, "weights": {"late": -0.3, "waiting": -0.2, "empty": 0.0}},
)
