"""RLlib on the navigation environment: PPO, one policy shared by all cars.

pip install '.[rllib]'
python docs/examples/training/rllib_cars.py
"""

import argparse

from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env

from fleet.envs.navigation import NavigationEnv


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--iterations", type=int, default=100)
    parser.add_argument("--batch", type=int, default=4_000, help="steps of the environment in an iteration")
    parser.add_argument("--cycles", type=int, default=600, help="steps of an episode")
    options = parser.parse_args()

    register_env("navigate", lambda arguments: ParallelPettingZooEnv(NavigationEnv(**arguments)))
    config = (
        PPOConfig()
        .environment("navigate", env_config={"n_cars": 6, "max_cycles": options.cycles})
        .env_runners(num_env_runners=0)
        .multi_agent(policies={"car"}, policy_mapping_fn=lambda agent, *_, **__: agent.rpartition("_")[0])
        .rl_module(rl_module_spec=MultiRLModuleSpec(rl_module_specs={"car": RLModuleSpec()}))
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
