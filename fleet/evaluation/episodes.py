"""Episodes: a policy plays an episode; what it came to, and the time of the processor that its decisions took."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from fleet.envs.policies.policy import Policy
from fleet.errors import FleetError
from fleet.evaluation.errors import PolicyError
from fleet.evaluation.measures import EpisodeTally
from fleet.evaluation.players import Player, told

Observations = Mapping[str, Any]
OnStep = Callable[[Observations, Mapping[str, Any], tuple[Any, ...]], None]
"""Called after each step with what agents saw, what they did, and what `step` returned."""


def play_episode(env: Any, player: Player, seed: int, on_step: OnStep | None = None) -> tuple[EpisodeTally, float]:
    """Play one episode to its end.

    Args:
        env: A parallel environment.
        player: Decides for all agents.
        seed: Of the episode, and of the policy's own chance.
        on_step: See `OnStep`.

    Returns:
        What the episode came to, and the time of the processor that the policy took for it [s].

    Raises:
        PolicyError: The policy failed, or gave no dictionary.
    """
    observations, _ = env.reset(seed=seed)
    policy, tally, cpu_s = player.make(seed), EpisodeTally(env=env), 0.0
    while env.agents:
        begin_s = time.process_time()
        actions = _actions(policy, env, observations, player.name)
        cpu_s += time.process_time() - begin_s
        returned = env.step(actions)
        if on_step is not None:
            on_step(observations, actions, returned)
        tally.add(returned[4])
        observations = {agent: returned[0][agent] for agent in env.agents}  # without those that have left
    return tally, cpu_s


def _actions(policy: Policy, env: Any, observations: Observations, name: str) -> dict[str, Any]:
    try:
        actions = policy.act(env, observations)
    except FleetError:
        raise
    except (Exception, SystemExit) as reason:  # whatever a policy of one's own does
        raise PolicyError(f"policy {name} failed on {env.metadata['name']}: {told(reason)}; valid: actions") from reason
    if not isinstance(actions, Mapping):
        raise PolicyError(f"policy {name} gives a {type(actions).__name__}; valid: a dictionary of actions by agent")
    return dict(actions)
