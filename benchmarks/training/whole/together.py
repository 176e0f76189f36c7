"""Together: cars and arms that were trained apart play `cell`, in physics, and no classical controller drives them.

Cars brake where their grants end, and stand while they are served, whatever their policy says (`grants_hold`). The
policies are those of `runs/learning/<recipe>/<seed>`. Where no arm was trained the arms' script plays, and the row
has no target.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np

from benchmarks.harness import Row, Trial
from benchmarks.training.learning import FOLDER, N_AT_ONCE
from fleet.charts.statistics import estimate
from fleet.envs.policies.policy import Policy
from fleet.envs.policies.warehouse import PointingArms
from fleet.training.batch import type_of
from fleet.training.evaluation import Score, evaluate
from fleet.training.recipes import RECIPES
from fleet.training.results import CHECKPOINT, EVALUATION

CARS, ARMS = "queue", "serve_physics"
"""Recipes of the policies."""
FIRST_SEED, N_EPISODES, N_QUICK_EPISODES = 820_000, 20, 1
"""Of the episodes of each seed of the training, on which nothing was trained or chosen."""
DELIVERED = ">= 1.6"
"""Of two parcels."""


class TeamByType:
    """Plays agents of each type by a policy of their own.

    Args:
        of_type: Policies by type of agents.
    """

    def __init__(self, of_type: Mapping[str, Policy]) -> None:
        self._of_type = dict(of_type)

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        actions: dict[str, Any] = {}
        for name, policy in self._of_type.items():
            # A car that was lost has left, and what was learned has no answer for nobody.
            if seen := {agent: one for agent, one in observations.items() if type_of(agent) == name}:
                actions |= policy.act(env, seen)
        return actions


def measure_together(trial: Trial) -> Iterator[Row]:
    """What teams deliver and touch, in physics and without."""
    found = [seed for seed in trial.seeds if _is_there(CARS, seed)]
    if importlib.util.find_spec("torch") is None or not found:
        trial.notes.append(f"together: left out, needs PyTorch and runs in {FOLDER / CARS}")
        return
    n_episodes = N_QUICK_EPISODES if trial.quick else N_EPISODES
    with ProcessPoolExecutor(N_AT_ONCE, mp_context=get_context("spawn")) as pool:
        for fidelity in ("physics", "kinematic"):
            for arms in (ARMS, "script"):
                played = [seed for seed in found if arms == "script" or _is_there(ARMS, seed)]
                if not played:
                    trial.notes.append(f"together: {arms} left out, there is no run in {FOLDER / arms}")
                    continue
                play = partial(play_team, arms=arms, fidelity=fidelity, n_episodes=n_episodes)
                by_seed = list(pool.map(play, played))
                promised = not trial.quick and arms == ARMS and fidelity == "physics"
                yield from _rows(by_seed, arms, fidelity, DELIVERED if promised else "")


def _rows(by_seed: Sequence[list[Score]], arms: str, fidelity: str, target: str) -> Iterator[Row]:
    """What the teams of all seeds came to."""
    means = [_mean(scores, "deliveries") for scores in by_seed]
    delivered, n_episodes = estimate(means), len(by_seed[0])
    assert delivered is not None
    several = len(means) > 1
    seeds = ", ".join(f"{mean:.2f}" for mean in means)
    unit = f"of 2, lower end of 95 %; mean {delivered.mean:.2f}; {n_episodes} episodes of each seed: {seeds}"
    yield Row(
        name=f"cell, {fidelity}, cars by {CARS}, arms by {arms}: delivered",
        value=delivered.low if several else delivered.mean,
        unit=unit if several else f"of 2; {n_episodes} episodes of one seed",
        target=target,
    )
    contacts = abs(_mean([score for scores in by_seed for score in scores], "contact"))
    yield Row(name="  contacts", value=contacts, unit="per episode, by robot")


def play_team(seed: int, arms: str, fidelity: str, n_episodes: int) -> list[Score]:
    """Scores of the episodes that one seed of the training plays.

    Args:
        seed: Of the training.
        arms: Recipe of the arms' policy; any other name = the script.
        fidelity: Of the world.
        n_episodes: How many.
    """
    # PyTorch is an extra.
    from fleet.training.ppo.policy import load_policy

    recipe = RECIPES["cell"]
    by_arms = load_policy(FOLDER / ARMS / str(seed)) if arms == ARMS else PointingArms()
    team = TeamByType({"car": load_policy(FOLDER / CARS / str(seed)), "arm": by_arms})
    arguments = {**recipe.arguments, "ramp": True, "grants_hold": True, "fidelity": fidelity}
    seeds = range(FIRST_SEED + seed * n_episodes, FIRST_SEED + (seed + 1) * n_episodes)
    return evaluate(recipe, arguments, {CARS: team}, seeds)[CARS]


def _is_there(recipe: str, seed: int) -> bool:
    """Whether a seed was trained to its end."""
    folder = FOLDER / recipe / str(seed)
    return (folder / CHECKPOINT).is_file() and (folder / EVALUATION).is_file()


def _mean(scores: list[Score], figure: str) -> float:
    return float(np.mean([score[figure] for score in scores]))
