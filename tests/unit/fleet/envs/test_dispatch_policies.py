"""Policies of dispatch that play on, or match what cars want."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.abstract.kernel import NONE, Stage
from fleet.envs import dispatch_v1
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.dispatch.scenarios import SCENARIOS
from fleet.envs.policies import make_policy
from fleet.envs.policies.dispatch import ScoredMatching
from fleet.envs.policies.rollout import RolloutConfig, RolloutPolicy
from fleet.errors import ConfigError

QUICK = RolloutConfig(n_futures=4, n_first=2, n_drawn=8)


def actions_of(policy: Any, env: DispatchEnv, n_steps: int) -> list[dict[str, Any]]:
    """Return what a policy does in the first steps of an episode."""
    observations, _ = env.reset(seed=5)
    said = []
    for _ in range(n_steps):
        said.append(policy.act(env, observations))
        observations, *_ = env.step(said[-1])
    return said


def tardiness(env: DispatchEnv, policy: Any, seed: int) -> float:
    """Return the tardiness of all orders at the end of an episode, in timesteps."""
    observations, _ = env.reset(seed=seed)
    while env.agents:
        observations, *_ = env.step(policy.act(env, observations))
    tasks = env.fleet.grid.tasks  # type: ignore[union-attr, attr-defined]
    end = np.minimum(tasks.done, env.fleet.grid.now).astype(np.int64)  # type: ignore[union-attr, attr-defined]
    return float(np.maximum(0, end - tasks.due).sum())


def test_a_rollout_sees_no_order_before_its_release() -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=4, load=1.5)
    truth = actions_of(RolloutPolicy(1, QUICK), env, 12)

    class Changed(RolloutPolicy):
        """Has the orders to come changed before it decides."""

        def act(self, env: DispatchEnv, observations: Any) -> dict[str, Any]:
            tasks = env.fleet.grid.tasks  # type: ignore[union-attr, attr-defined]
            later = tasks.stage == Stage.ORDERED
            kept = tasks.due[later].copy()
            tasks.due[later] = 0
            actions = super().act(env, observations)
            tasks.due[later] = kept
            return actions

    assert actions_of(Changed(1, QUICK), env, 12) == truth
    assert any(action > 1 for step in truth for action in step.values())
    env.close()


def test_rollouts_are_their_seed_s() -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=4, load=1.5)
    policy = RolloutPolicy(1, QUICK)
    first = actions_of(policy, env, 20)
    assert actions_of(RolloutPolicy(1, QUICK), env, 20) == first
    assert policy.n_rollouts > 100
    env.close()


def test_rollouts_say_what_each_candidate_is_worth() -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=4, load=1.5)
    policy, n_told, n_better = RolloutPolicy(1, QUICK), 0, 0
    observations, _ = env.reset(seed=3)
    for _ in range(30):
        able = env.view.free & (env.candidates[:, 0] != -1)
        actions = policy.act(env, observations)
        assert list(policy.worths) == [agent for agent, one in zip(env.possible_agents, able, strict=True) if one]
        for agent, worths in policy.worths.items():
            assert worths.shape == (9,)
            assert worths[actions[agent]] >= 0.0, "it could have been left to the rule"
            assert worths[0] == 0.0
            assert not worths[1:][observations[agent]["action_mask"][1:] == 0].any()
            n_told += 1
            n_better += worths[actions[agent]] > 0.0
        observations, *_ = env.step(actions)
    assert n_told > 10
    assert 0 < n_better < n_told
    env.close()


def test_rollouts_are_less_late_than_nearest_tasks() -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=6, load=1.5, max_cycles=160)
    both = [
        [tardiness(env, policy, seed) for seed in (1, 2)]
        for policy in (RolloutPolicy(0, QUICK), make_policy("dispatch", "nearest"))
    ]
    assert sum(both[0]) < 0.5 * sum(both[1])
    env.close()


def test_rollouts_decide_for_the_whole_fleet() -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=2, fidelity="kinematic", max_cycles=30)
    observations, _ = env.reset(seed=0)
    policy = RolloutPolicy(0, QUICK)
    while env.agents:
        observations, *_ = env.step(policy.act(env, observations))
    assert env.n_delivered > 0
    env.close()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"horizon_s": 0.0}, "horizon_s"),
        ({"n_futures": 64}, "n_futures is 64; valid: 1 to n_drawn, which is 32"),
        ({"n_first": 0}, "n_first"),
        ({"late": -1.0}, "late"),
        ({"rule": "spt"}, "apparent_tardiness, nearest"),
    ],
)
def test_wrong_settings_of_rollouts_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        RolloutConfig(**wrong)


def test_cars_that_want_the_same_get_what_is_best_for_all() -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=4, load=1.5)
    observations, _ = env.reset(seed=0)
    task = env.candidates[0, 0]
    wants = {}  # car 0 wants this task a little more than any other, car 1 wants nothing else

    def score(rows: Any, mask: Any) -> Any:
        del rows
        scores = np.where(mask == 1, 0.0, -np.inf)
        scores[:, 1:] = np.where(env.candidates == task, 1.0, 0.5)
        scores[1, 1:] = np.where(env.candidates[1] == task, 9.0, -1.0)
        wants["scores"] = scores
        return scores

    actions = ScoredMatching(score=score).act(env, observations)
    chosen = [env.candidates[car, action - 1] if action else NONE for car, action in enumerate(actions.values())]
    assert chosen[1] == task
    assert chosen[0] not in (task, NONE)
    assert len(set(chosen)) == 4
    nothing = ScoredMatching(score=lambda rows, mask: -np.arange(mask.shape[1]) * np.ones(mask.shape))
    assert set(nothing.act(env, observations).values()) == {0}
    env.close()


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_can_be_played(name: str) -> None:
    env = dispatch_v1.parallel_env(**{**SCENARIOS[name].arguments, "max_cycles": 3})
    observations, _ = env.reset(seed=0)
    while env.agents:
        observations, *_ = env.step(dict.fromkeys(observations, 1))
    env.close()
