"""Recipe of traffic: cars choose their lane moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from fleet.training.recipes.recipe import Recipe, TrainingStage, on_floor, weights_of
from fleet.training.settings import PpoConfig

if TYPE_CHECKING:
    from fleet.envs.policies.policy import Policy
    from fleet.training.batch import Batch

FLOOR = {"rows": 18, "cols": 30, "pick": 4, "drop": 4, "parking": 60}
"""A floor that no site has, so that what is learned is not one floor by heart."""


def _traffic(
    *, weights: Mapping[str, float] | None = None, floor: Mapping[str, Any] | None = None, **arguments: Any
) -> Any:
    from fleet.envs.traffic.env import TrafficWeights, parallel_env

    return parallel_env(weights=weights_of(TrafficWeights, weights), **on_floor(arguments, floor))


def _side_by_side(dealt: Sequence[Mapping[str, Any]], **told: Any) -> Batch:
    from fleet.training.vector_batch import VectorBatch

    return VectorBatch(_traffic, dealt, **told)


def _pibt() -> Policy:
    from fleet.envs.policies.traffic import PibtTraffic

    return PibtTraffic()


TRAFFIC = Recipe(
    summary="cars choose their lane moves, and push each other out of the way",
    make=_traffic,
    batch=_side_by_side,
    scripted=_pibt,
    script="priority inheritance with backtracking",
    figures=("delivered", "progress", "waiting", "lost", "blocking"),
    at_end={"jams": lambda env: env.jammed, "waits": lambda env: env.n_waits},
    shares=frozenset({"jams"}),
    n_steps=5_000_000,
    ppo=PpoConfig(horizon_n=125, epochs_n=4, minibatch_n=4096, entropy=0.005, discount=0.98, learning_rate=1e-3),
    arguments={"site": "dense", "n_cars": 30},
    stages=(
        TrainingStage(
            name="teams",
            mix=(
                *({"n_cars": n_cars} for n_cars in (10, 20, 20, 30, 30, 40)),
                *({"floor": FLOOR, "n_cars": n_cars} for n_cars in (30, 45)),
            ),
        ),
    ),
    plays=("likeliest", "drawn"),
)
