"""Recipe of the hand-over: cars and arms arrange by themselves who takes a parcel from whom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fleet.training.recipes.recipe import Recipe, TrainingStage
from fleet.training.recipes.warehouse import CLONED_FIRST

if TYPE_CHECKING:
    from fleet.envs.policies.policy import Policy


def _handover(*, weights: Mapping[str, float] | None = None, **arguments: Any) -> Any:
    from fleet.envs.handover.config import HandoverWeights
    from fleet.envs.handover.env import parallel_env

    return parallel_env(weights=HandoverWeights(**weights or {}), **arguments)


def _first_come() -> Policy:
    from fleet.envs.policies import make_policy

    return make_policy("handover", "first_come")


def n_deliveries(env: Any) -> int:
    """Parcels that were delivered in an episode: car and arm are both paid for each."""
    from fleet.envs.handover.parcels import Happened

    return int(env.happened[Happened.DELIVERED])


_LATE = {"late_s": 15.0, "stops_per_min": 2.0}
HANDOVER = Recipe(
    summary="cars and arms arrange who takes a parcel from whom, and nobody tells them",
    make=_handover,
    scripted=_first_come,
    script="first come, first served",
    teacher=_first_come,
    figures=("n_delivered", "n_loaded", "n_gripped", "n_lost", "n_contacts"),
    at_end={"deliveries": n_deliveries},
    n_steps=1_500_000,
    ppo=replace(CLONED_FIRST, hidden=(128, 128), clone_n=600_000, anchor=0.1),
    # What is gripped, loaded and delivered counts as one, as in `cell`.
    arguments={"weights": {"gripped": 1.0, "loaded": 1.0, "delivered": 1.0, "lost": -1.0, "time": -0.02}},
    # Cars that come one after the other, and those that stop on their way, have others wait: who only ever met cars
    # on time does not learn to.
    stages=(TrainingStage(name="late", mix=({}, _LATE)),),
)
