"""Scripted policies of every layer, the classical stack among them: `make_policy("dispatch", "hungarian")`."""

from collections.abc import Callable
from functools import partial

from fleet.config import require
from fleet.envs.policies.dispatch import Allocated, Nearest, ScoredMatching, apparent_tardiness
from fleet.envs.policies.handover import FirstCome
from fleet.envs.policies.policy import Policy as Policy
from fleet.envs.policies.policy import Random
from fleet.envs.policies.rollout import RolloutPolicy
from fleet.envs.policies.traffic import PibtTraffic, PlannedTraffic, ShortestWay
from fleet.envs.policies.warehouse import Classical, PlannedArms, PointingArms, PursuitCars

POLICIES: dict[str, dict[str, Callable[[int], Policy]]] = {
    "dispatch": {
        "random": Random,
        "nearest": Nearest,
        "greedy": partial(Allocated, "greedy"),
        "hungarian": partial(Allocated, "hungarian"),
        "regret_lns": partial(Allocated, "regret_lns"),
        "rested": partial(Allocated, "hungarian", rest_below=0.8),
        "apparent_tardiness": partial(Allocated, "greedy", cost=apparent_tardiness, classes=False),
        "scored_matching": ScoredMatching,
        "rollout": RolloutPolicy,
    },
    "traffic": {
        "random": Random,
        "shortest_way": ShortestWay,
        "pibt": PibtTraffic,
        "multi_step_pibt": PlannedTraffic,
    },
    "warehouse": {
        "random": Random,
        "pursuit": PursuitCars,
        "planned_arms": PlannedArms,
        "pointing_arms": PointingArms,
        "classical": Classical,
    },
    "handover": {
        "random": Random,
        "first_come": FirstCome,
    },
}
"""Policies by layer and name; each is made with a seed and has `act(env, observations) -> actions`."""


def make_policy(layer: str, name: str, seed: int = 0) -> Policy:
    """Make a policy.

    Args:
        layer: A name in `POLICIES`: which environment it plays.
        name: A name in `POLICIES[layer]`.
        seed: Source of chance, of those that leave anything to it.

    Raises:
        ConfigError: There is no such layer or policy.
    """
    require(layer in POLICIES, "layer", layer, ", ".join(POLICIES))
    require(name in POLICIES[layer], f"policy of layer {layer}", name, ", ".join(POLICIES[layer]))
    return POLICIES[layer][name](seed)
