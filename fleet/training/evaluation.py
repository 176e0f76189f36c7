"""Evaluation: policies that play the same episodes, with intervals by bootstrap."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fleet.envs.policies.policy import Policy
from fleet.training.batch import type_of
from fleet.training.recipes import Recipe

CONFIDENCE = 0.95
N_RESAMPLES = 10_000
RETURN = "return"
"""Name of the mean return of an agent, summed over the types."""

Score = dict[str, float]
"""Figures of one episode."""


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A mean and where the true one lies with 95 % confidence."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:.3g} [{self.low:.3g}, {self.high:.3g}]"


def play(env: Any, policy: Policy, seed: int, figures: Sequence[str]) -> Score:
    """Play one episode to its end.

    Args:
        env: A parallel environment.
        policy: Decides for all agents.
        seed: Of the episode.
        figures: Names in `infos` to add up over the team and the episode.
    """
    observations, _ = env.reset(seed=seed)
    counts: dict[str, int] = {}
    for agent in env.possible_agents:
        counts[type_of(agent)] = counts.get(type_of(agent), 0) + 1
    score = dict.fromkeys((RETURN, *figures), 0.0)
    while env.agents:
        observations, rewards, _, _, infos = env.step(policy.act(env, observations))
        score[RETURN] += sum(reward / counts[type_of(agent)] for agent, reward in rewards.items())
        for name in figures:
            score[name] += sum(float(info.get(name, 0.0)) for info in infos.values())
    return score


def evaluate(
    recipe: Recipe,
    arguments: Mapping[str, Any],
    policies: Mapping[str, Policy],
    seeds: Sequence[int],
    on_episode: Callable[[int], None] = lambda done: None,
) -> dict[str, list[Score]]:
    """Let every policy play every seed.

    Args:
        recipe: What is played.
        arguments: Of the environment.
        policies: By name.
        seeds: Of the episodes.
        on_episode: Called with the number of episodes played so far.

    Returns:
        Scores by policy, in the order of the seeds.
    """
    env = recipe.make(**arguments)
    scores: dict[str, list[Score]] = {}
    try:
        for name, policy in policies.items():
            scores[name] = []
            for seed in seeds:
                scores[name].append(play(env, policy, seed, recipe.figures))
                on_episode(sum(map(len, scores.values())))
    finally:
        env.close()
    return scores


def interval(values: Sequence[float]) -> Interval:
    """Mean of independent values with its percentile bootstrap interval.

    The resamples are the same for equal numbers of values, so that an interval can be computed again.

    Source: B. Efron, R. J. Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13.
    """
    array = np.asarray(values, dtype=np.float64)
    picks = np.random.default_rng(0).integers(len(array), size=(N_RESAMPLES, len(array)))
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(array[picks].mean(axis=1), (tail, 1.0 - tail))
    return Interval(mean=float(array.mean()), low=float(low), high=float(high))


def gain(scores: Sequence[Score], reference: Sequence[Score], name: str) -> Interval:
    """Mean difference of a figure from a reference on the same seeds: what a seed brings to both cancels out."""
    return interval([one[name] - other[name] for one, other in zip(scores, reference, strict=True)])
