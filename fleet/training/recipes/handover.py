"""Recipe of the hand-over: cars and arms arrange by themselves who takes a parcel from whom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fleet.training.recipes.recipe import Recipe, TrainingStage, weights_of
from fleet.training.recipes.warehouse import SERVE_PHYSICS

if TYPE_CHECKING:
    from fleet.envs.policies.policy import Policy


def _handover(*, weights: Mapping[str, float] | None = None, **arguments: Any) -> Any:
    from fleet.envs.handover.config import HandoverWeights
    from fleet.envs.handover.env import parallel_env

    return parallel_env(weights=weights_of(HandoverWeights, weights), **arguments)


def _first_come(seed: int = 0) -> Policy:
    from fleet.envs.policies.handover import FirstCome

    del seed  # it leaves nothing to chance
    return FirstCome()


def n_loaded(env: Any) -> int:
    """Parcels that were set in trays in an episode."""
    from fleet.envs.handover.parcels import Happened

    return int(env.happened[Happened.LOADED])


def n_delivered(env: Any) -> int:
    """Parcels that were delivered in an episode: arm and car are both paid for each."""
    from fleet.envs.handover.parcels import Happened

    return int(env.happened[Happened.DELIVERED])


HANDOVER = Recipe(
    summary="cars and arms hand parcels over, and nobody tells them when and to whom",
    make=_handover,
    scripted=_first_come,
    script="first come, first served",
    teacher=_first_come,
    # What is loaded and delivered is counted for the arm and for the car.
    figures=("n_delivered", "n_loaded", "n_gripped", "n_lost", "n_contacts"),
    at_end={"parcels_loaded": n_loaded, "parcels_delivered": n_delivered},
    # All of it clones: who explores sets nothing down. A drop arm with a parcel in its grip is seen only once cars that
    # do what they have learned come to it: after 400,000 steps next to nothing is delivered.
    n_steps=1_200_000,
    ppo=replace(SERVE_PHYSICS.ppo, clone_n=1_200_000, anchor=0.0),
    arguments={"site": "cell", "n_cars": 2},
    stages=(
        # With one car there is no line at an arm, and a lost parcel is its own or its arm's.
        TrainingStage(name="one and two", mix=({"n_cars": 1}, {}), longest=0.3),
        # Who is late is waited for, or overtaken.
        TrainingStage(name="late", mix=({}, {"late_s": 15.0}), longest=0.6),
        TrainingStage(name="late and halting", mix=({}, {"late_s": 15.0}, {}, {"late_s": 15.0, "stops_per_min": 2.0})),
    ),
)
