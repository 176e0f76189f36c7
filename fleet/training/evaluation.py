"""Evaluation: policies that play the same episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from fleet.envs.policies.policy import Policy
from fleet.training.batch import type_of
from fleet.training.recipes import Recipe

RETURN = "return"
"""Name of the mean return of an agent, summed over the types."""
AGENT_MINUTES = "agent_minutes"
"""Name of the simulated minutes for which agents took part, summed over them."""

Score = dict[str, float]
"""Figures of one episode."""


def play(
    env: Any,
    policy: Policy,
    seed: int,
    figures: Sequence[str],
    at_end: Mapping[str, Callable[[Any], float]] | None = None,
) -> Score:
    """Play one episode to its end.

    Args:
        env: A parallel environment.
        policy: Decides for all agents.
        seed: Of the episode.
        figures: Names in `infos` to add up over the team and the episode.
        at_end: Figures that the environment is asked for at the end.
    """
    observations, _ = env.reset(seed=seed)
    counts: dict[str, int] = {}
    for agent in env.possible_agents:
        counts[type_of(agent)] = counts.get(type_of(agent), 0) + 1
    score = dict.fromkeys((RETURN, AGENT_MINUTES, *figures), 0.0)
    minutes = seconds_per_step(env) / 60.0
    while env.agents:
        playing = {agent: observations[agent] for agent in env.agents}
        observations, rewards, _, _, infos = env.step(policy.act(env, playing))
        score[AGENT_MINUTES] += len(playing) * minutes
        score[RETURN] += sum(reward / counts[type_of(agent)] for agent, reward in rewards.items())
        for name in figures:
            score[name] += sum(float(info.get(name, 0.0)) for info in infos.values())
    return score | {name: float(ask(env)) for name, ask in (at_end or {}).items()}


def seconds_per_step(env: Any) -> float:
    """How long a step lasts [s]: what the settings of the environment say, else its frames per second."""
    config = getattr(env, "config", None)
    length_s = getattr(config, "step_s", None)
    return float(length_s if length_s is not None else 1.0 / env.metadata["render_fps"])


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
                scores[name].append(play(env, policy, seed, recipe.figures, recipe.at_end))
                on_episode(sum(map(len, scores.values())))
    finally:
        env.close()
    return scores
