"""Demonstrate: let a policy play, and keep what its agents saw and did for those who learn from it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fleet.envs.policies.policy import Policy
from fleet.training.batch import agent_types, mask_of, type_of, vector
from fleet.training.demonstrations import Demonstration, write_demonstrations


def demonstrate(path: Path, env: Any, policy: Policy, seeds: Sequence[int]) -> int:
    """Play episodes and write what the policy's agents did, the whole file or nothing.

    Agents that have no choice, having one legal action only, teach nothing and are left out.

    Args:
        path: An .npz file with the arrays `<type>_rows`, `<type>_mask` and `<type>_actions`.
        env: A parallel environment.
        policy: Decides for all agents.
        seeds: Of the episodes.

    Returns:
        Samples in the file.
    """
    kinds = {kind.name: kind for kind in agent_types(env)}
    told: dict[str, list[tuple[Any, Any, Any]]] = {name: [] for name in kinds}
    for seed in seeds:
        observations, _ = env.reset(seed=seed)
        while env.agents:
            actions = policy.act(env, observations)
            for agent, seen in observations.items():
                kind = kinds[type_of(agent)]
                mask = mask_of(seen, kind) if kind.masked else None
                if mask is None or np.count_nonzero(mask) > 1:
                    told[kind.name].append((vector(seen), mask, actions[agent]))
            observations, *_ = env.step(actions)
    found = {
        name: Demonstration(
            rows=np.stack([one[0] for one in samples]).astype(np.float32),
            mask=np.stack([one[1] for one in samples]) if kinds[name].masked else None,
            actions=np.stack([np.asarray(one[2]) for one in samples]),
        )
        for name, samples in told.items()
        if samples
    }
    write_demonstrations(path, found)
    return sum(len(one.actions) for one in found.values())
