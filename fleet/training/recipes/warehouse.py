"""Recipes of the warehouse's ladder: a car docks, an arm picks and sets, both together, and what adds to the script."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fleet.training.layout import RowLayout
from fleet.training.recipes.recipe import Recipe, TrainingStage, weights_of
from fleet.training.settings import PpoConfig

if TYPE_CHECKING:
    from fleet.envs.policies.policy import Policy


def _warehouse(*, weights: Mapping[str, float] | None = None, **arguments: Any) -> Any:
    from fleet.envs.warehouse.env import parallel_env
    from fleet.envs.warehouse.rewards import RewardWeights

    return parallel_env(weights=weights_of(RewardWeights, weights), **arguments)


def _classical(seed: int = 0) -> Policy:
    from fleet.envs.policies.warehouse import Classical

    del seed  # it leaves nothing to chance
    return Classical()


def n_parcels(env: Any) -> int:
    """Parcels that there were to move in an episode."""
    return len(env.simulation.board.tasks)


def n_deliveries(env: Any) -> int:
    """Parcels that were delivered in an episode: car and arm are both paid for each."""
    return sum(task.done_s is not None for task in env.simulation.board.tasks)


def handovers_s(env: Any) -> list[float]:
    """How long each hand-over of an episode took that came to an end: from the beginning of the service, a car standing
    at its dock, until the car may leave [s]. Parcels that were in their cars when it began were not handed over."""
    from fleet.tasks.board import TaskState

    pairs = (TaskState.LOADING, TaskState.CARRIED), (TaskState.UNLOADING, TaskState.DELIVERED)
    return [
        took_s
        for task in env.simulation.board.tasks
        for before, after in pairs
        if before in task.since_s
        and after in task.since_s
        and (took_s := task.since_s[after] - task.since_s[before]) > 0.0
    ]


def n_handovers(env: Any) -> int:
    """Hand-overs of an episode that came to an end."""
    return len(handovers_s(env))


def handover_s(env: Any) -> float:
    """How long all of them took [s]."""
    return sum(handovers_s(env))


_PHYSICS = {"fidelity": "physics"}
DOCK = Recipe(
    summary="a car comes to a dock and stops there",
    make=_warehouse,
    scripted=_classical,
    script="pure pursuit, and a stop at its end",
    figures=("docked", "contact"),
    shares=frozenset({"docked"}),
    n_steps=460_000,
    ppo=PpoConfig(envs_n=16, horizon_n=128, learning_rate=1e-3, discount=0.98, entropy=0.001, hidden=(128, 128)),
    # A dock counts as one: the figure is the share of episodes. A car in physics changes its speed as the one does that
    # it learns with: without `ramp`, at four times that, a policy of 280,000 steps docked 16 of 40 times instead of 35.
    arguments={"level": "dock", "ramp": True, "weights": {"docked": 1.0, "time": -0.02}},
    stages=(
        TrainingStage(
            name="wide",
            arguments={"stop_m": 0.3, "stop_rad": 0.4},
            longest=0.3,
            figure="docked",
            reached=0.95,
        ),
        TrainingStage(
            name="half",
            arguments={"stop_m": 0.12, "stop_rad": 0.2},
            longest=0.3,
            figure="docked",
            reached=0.95,
        ),
        TrainingStage(name="true", shortest=0.3, longest=0.4, figure="docked", reached=0.98, n_last=200),
        # In physics, which no stage has, cars come askew to where they never were before: from there they have to find
        # back, too. Held to less than the true tolerance, they stay within that where wheels and steering lag.
        TrainingStage(
            name="askew",
            arguments={"start": {"side_m": 0.15, "turn_rad": 0.4}, "stop_m": 0.035, "stop_rad": 0.07},
        ),
    ),
)

_FLOORS = ({"site": "small"}, {"site": "cell"}, {"site": "small"}, {"site": "medium"})
_EXACT = {"stop_m": 0.03, "stop_rad": 0.06}
APPROACH = replace(
    DOCK,
    summary="a car drives the last metres to a dock of any site, and stops there more exactly than it has to",
    n_steps=900_000,
    arguments={**DOCK.arguments, "site": "small", "start": {"near_m": (0.3, 2.5), "side_m": 0.1, "turn_rad": 0.2}},
    # Where it is on the floor tells nothing about the way to a dock, and what has been learned on one floor does not
    # hold on another.
    stages=(
        *(replace(stage, mix=_FLOORS, longest=0.2) for stage in DOCK.stages[:2]),
        TrainingStage(name="true", mix=_FLOORS, longest=0.3, figure="docked", reached=0.95),
        # An arm reaches better, and what plays in a fleet is held to its lane.
        TrainingStage(name="exact", arguments=_EXACT, mix=_FLOORS),
    ),
)

CLONED_FIRST = PpoConfig(
    envs_n=16,
    horizon_n=128,
    learning_rate=1e-3,
    discount=0.98,
    # What was cloned is not lost in noise.
    log_std=-1.0,
    clone_n=300_000,
)
"""Where arms lead their tips: from scratch they do not find out how to set a parcel."""

_ALONE = {"level": "dock", "n_cars": 1}
_NEAR = {**_ALONE, "start": {"near_m": (0.05, 1.5), "side_m": 0.2, "turn_rad": 0.6}}
_IN_TURN = {"n_cars": 3, "max_cycles": 300}
_NOT_OF_THE_WAY = (*range(4), *range(6, 11), 12, 14, *range(27, 55), *range(58, 61))
"""Of a car's observation, where on the floor it is and where its goal is, what it has aboard, other cars, arms and
times: its route and its stop pose say where to go, and grants when."""
QUEUE = Recipe(
    summary="cars come to docks one after the other, and each waits for its turn",
    make=_warehouse,
    scripted=_classical,
    script="pure pursuit, and a stop at its end",
    teacher=_classical,
    figures=("docked", "contact", "failed"),
    at_end={"deliveries": n_deliveries},
    layouts={"car": RowLayout(unseen=_NOT_OF_THE_WAY)},
    n_steps=240_000,
    ppo=replace(CLONED_FIRST, hidden=(128, 128), clone_n=80_000, anchor=0.03),
    # Arms are the classical fleet's. What is docked counts as one.
    arguments={
        "level": "all",
        "site": "cell",
        "n_cars": 2,
        "n_arms": 0,
        "ramp": True,
        "grants_hold": True,
        "weights": {"docked": 1.0, "contact": -1.0, "time": -0.02},
    },
    stages=(TrainingStage(name="in turn", mix=(_NEAR, _IN_TURN, _ALONE, {"max_cycles": 600})),),
)

TRANSFER = Recipe(
    summary="arms pick parcels and set them, between racks and cars that stand",
    make=_warehouse,
    scripted=_classical,
    script="up, around and down",
    teacher=_classical,
    figures=("loaded", "delivered", "gripped", "failed"),
    at_end={"parcels": n_parcels},
    n_steps=900_000,
    ppo=replace(CLONED_FIRST, hidden=(128, 128)),
    # What is loaded and delivered counts as one.
    arguments={
        "level": "transfer",
        "arm_action": "tip",
        "weights": {"gripped": 1.0, "loaded": 1.0, "delivered": 1.0, "failed": -1.0, "time": -0.02},
    },
    stages=(
        # The clone grips, and seldom lets go: the half second in which it should is too short to be seen often.
        TrainingStage(name="without physics", shortest=0.5, longest=0.7, figure="loaded", reached=0.97),
        # In physics joints lag behind: 98 % of the transfers fail with what was learned without.
        TrainingStage(name="slippery", mix=({}, {"fidelity": "physics"})),
    ),
)

_UNSEEN = (6, 13, *range(32, 37), *range(49, 53), 55, 57, 58, 62)
"""Of an arm's observation, where its wrist is turned to and how fast, the nearest car, yaws of parcel and place, times,
and the last turn: nothing of this says where to, and all of it is other beside cars than alone."""
_ANYHOW = {"start": {"parcel_m": 0.04, "parcel_rad": math.pi, "side_m": 0.035, "turn_rad": 0.09}}
_SHIFT = {"level": "all", "n_cars": 0, "classical_cars": 2, "tasks": 4, "max_cycles": 500}
SERVE = Recipe(
    summary="arms wait for cars and serve them, however a parcel lies in a tray",
    make=_warehouse,
    scripted=_classical,
    script=TRANSFER.script,
    teacher=_classical,
    figures=(*TRANSFER.figures, "contact"),
    at_end={"deliveries": n_deliveries, **TRANSFER.at_end},
    layouts={"arm": RowLayout(unseen=_UNSEEN)},
    n_steps=360_000,
    # How to wait is paid by nothing: what was cloned about it is kept by the anchor. An arm that wanders comes to the
    # other side of its base, from where the way to the next parcel ends at a joint's limit.
    ppo=replace(TRANSFER.ppo, clone_n=80_000, anchor=0.03),
    arguments={**TRANSFER.arguments, "site": "cell", "weights": {**TRANSFER.arguments["weights"], "effort": -0.15}},
    # Waiting is cloned, too: an arm that never had to does something else.
    stages=(TrainingStage(name="beside cars", mix=(_ANYHOW, {}, _SHIFT)),),
)

# Without physics nothing stops an arm, and what PPO learns there goes through parcels. The script decides by what an
# arm sees, so it can be asked wherever arms come to by themselves. Noise is little, as it is none when they play: with
# much of it they never learn what to do where they would stand for ever.
SERVE_PHYSICS = replace(
    SERVE,
    summary="arms serve cars in physics as the script shows them, wherever they have come to",
    n_steps=204_800,
    ppo=replace(
        SERVE.ppo,
        clone_n=204_800,
        clone_all=True,
        clone_own=0.75,
        log_std=-2.5,
        learning_rate_end=1e-4,
    ),
    stages=(TrainingStage(name="shown", mix=({**_SHIFT, **_PHYSICS}, {**_ANYHOW, **_PHYSICS})),),
)

CELL = Recipe(
    summary="cars and arms deliver together on a small site",
    make=_warehouse,
    scripted=_classical,
    script="pure pursuit; up, around and down",
    teacher=_classical,
    figures=("delivered", "loaded", "gripped", "docked", "contact", "failed"),
    at_end={"deliveries": n_deliveries},
    n_steps=1_700_000,
    ppo=CLONED_FIRST,
    # What is docked, loaded and delivered counts as one.
    arguments={
        "level": "all",
        "site": "cell",
        "n_cars": 2,
        "arm_action": "tip",
        "weights": {"docked": 1.0, "gripped": 1.0, "loaded": 1.0, "delivered": 1.0, "failed": -1.0, "time": -0.02},
    },
    stages=(
        # Arms that wait for cars see too few parcels: where only all do everything, PPO loses what was cloned.
        TrainingStage(
            name="apart",
            mix=(
                {"level": "dock", "n_cars": 1, "fidelity": "physics"},
                {"level": "transfer", "n_cars": 0},
                {"level": "transfer", "n_cars": 0, "fidelity": "physics"},
                {},
            ),
            longest=0.6,
        ),
        TrainingStage(
            name="together",
            mix=(
                {},
                _PHYSICS,
                {"level": "transfer", "n_cars": 0, "fidelity": "physics"},
                _PHYSICS,
            ),
        ),
    ),
)

RESIDUAL = Recipe(
    summary="cars and arms do better than their script by what they add to it",
    make=_warehouse,
    scripted=_classical,
    script="pure pursuit; plans at their own pace",
    figures=("delivered", "loaded", "docked", "contact", "failed"),
    at_end={"deliveries": n_deliveries, "handovers": n_handovers, "handover_s": handover_s},
    n_steps=1_500_000,
    ppo=PpoConfig(
        envs_n=8,
        horizon_n=256,
        minibatch_n=2048,
        learning_rate=1e-3,
        discount=0.98,
        # An agent that adds nothing does what the script does: learning begins there.
        log_std=-1.0,
    ),
    arguments={
        "level": "all",
        "site": "small",
        "n_cars": 4,
        "tasks": 24,  # no car is ever out of work
        "car_action": "residual",
        "arm_action": "residual",
        # A grip has a centimetre.
        "residual": 0.1,
        "pace": 3.0,
        # Of five trainings without it one pulled its cars away from below the arms, which wait for ever then.
        "grants_hold": True,
        # An arm that is paid for its way to the parcel is slow to leave it, and the car drives off below it.
        "weights": {"progress": 0.0, "contact": -10.0, "time": -0.2},
    },
    stages=(
        # Where cars stand already, arms work all the time, and an episode is over the sooner the faster they are.
        TrainingStage(
            name="without physics", mix=({}, *({"level": "transfer", "n_cars": 0} for _ in range(3))), longest=0.5
        ),
        TrainingStage(
            name="slippery",
            mix=(
                {},
                {"level": "transfer", "n_cars": 0},
                _PHYSICS,
                {"level": "transfer", "n_cars": 0, "fidelity": "physics"},
            ),
        ),
    ),
)
