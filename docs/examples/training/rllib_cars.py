"""RLlib: PPO, one policy shared by all cars.

pip install '.[rllib]'
python docs/examples/training/rllib_cars.py                  # cars drive to places: two numbers each
python docs/examples/training/rllib_cars.py --env dispatch   # cars choose their tasks, of which masks tell the legal
"""

import argparse
from typing import Any

import ray
from gymnasium.spaces import Dict
from pettingzoo import ParallelEnv
from pettingzoo.utils.wrappers import BaseParallelWrapper
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.rllib.examples.rl_modules.classes.action_masking_rlm import ActionMaskingTorchRLModule
from ray.tune.registry import register_env

from fleet.envs import dispatch_v1, navigate_v1


class Renamed(BaseParallelWrapper):
    """Observations with masks under the names that RLlib's module for masks has for them."""

    def __init__(self, env: ParallelEnv) -> None:
        super().__init__(env)
        self._spaces = {agent: Dict(_renamed(env.observation_space(agent))) for agent in env.possible_agents}

    def observation_space(self, agent: str) -> Dict:
        return self._spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Any], ...]:
        seen, infos = self.env.reset(seed=seed, options=options)
        return {agent: _renamed(one) for agent, one in seen.items()}, infos

    def step(self, actions: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        seen, *told = self.env.step(actions)
        return {agent: _renamed(one) for agent, one in seen.items()}, *told


def _renamed(one: Any) -> dict[str, Any]:
    return {"observations": one["observation"], "action_mask": one["action_mask"]}


ENVS = {
    "navigate": navigate_v1.parallel_env,
    "dispatch": lambda **arguments: Renamed(dispatch_v1.parallel_env(**arguments)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", choices=ENVS, default="navigate")
    parser.add_argument("--iterations", type=int, default=100)
    parser.add_argument("--batch", type=int, default=4_000, help="steps of the environment in an iteration")
    parser.add_argument("--cycles", type=int, default=600, help="steps of an episode")
    options = parser.parse_args()

    ray.init(num_cpus=1, include_dashboard=False)  # all happens in this process: nothing else needs to start
    register_env("fleet", lambda arguments: ParallelPettingZooEnv(ENVS[options.env](**arguments)))
    module = RLModuleSpec(ActionMaskingTorchRLModule if options.env == "dispatch" else None)
    config = (
        PPOConfig()
        .environment("fleet", env_config={"n_cars": 6, "max_cycles": options.cycles})
        .env_runners(num_env_runners=0)
        .multi_agent(policies={"car"}, policy_mapping_fn=lambda agent, *_, **__: agent.rpartition("_")[0])
        .rl_module(rl_module_spec=MultiRLModuleSpec(rl_module_specs={"car": module}))
        .training(
            train_batch_size_per_learner=options.batch,
            minibatch_size=min(options.batch, 1024),
            num_epochs=6,
            gamma=0.98,
            lr=7e-4,
        )
    )
    algorithm = config.build_algo()
    for _ in range(options.iterations):
        result = algorithm.train()
        print("mean return of the team:", result["env_runners"].get("episode_return_mean"))
    algorithm.stop()


if __name__ == "__main__":
    main()
