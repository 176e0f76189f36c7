"""TorchRL on the navigation environment: checked, wrapped, and rolled out by a shared policy that is improved by PPO.

pip install '.[torchrl]'
python docs/examples/training/torchrl_cars.py
"""

import argparse

import torch
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector
from torchrl.envs import RewardSum, TransformedEnv, check_env_specs
from torchrl.envs.libs.pettingzoo import PettingZooWrapper
from torchrl.modules import MultiAgentMLP, NormalParamExtractor, ProbabilisticActor, TanhNormal
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from fleet.envs.navigation import NavigationEnv

GROUP = "car"
CARS_N = 6


def networks(observation_n: int) -> tuple[ProbabilisticActor, TensorDictModule]:
    """Policy and value, shared by all cars."""
    sizes = {"n_agents": CARS_N, "centralized": False, "share_params": True, "depth": 2, "num_cells": 64}
    actor = torch.nn.Sequential(
        MultiAgentMLP(n_agent_inputs=observation_n, n_agent_outputs=4, **sizes), NormalParamExtractor()
    )
    policy = ProbabilisticActor(
        TensorDictModule(actor, [(GROUP, "observation")], [(GROUP, "loc"), (GROUP, "scale")]),
        in_keys=[(GROUP, "loc"), (GROUP, "scale")],
        out_keys=[(GROUP, "action")],
        distribution_class=TanhNormal,
        return_log_prob=True,
    )
    value = MultiAgentMLP(n_agent_inputs=observation_n, n_agent_outputs=1, **sizes)
    return policy, TensorDictModule(value, [(GROUP, "observation")], [(GROUP, "state_value")])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=200_000, help="steps of the environment")
    parser.add_argument("--batch", type=int, default=2_000, help="of them, between two updates")
    options = parser.parse_args()

    torch.manual_seed(0)
    wrapped = PettingZooWrapper(NavigationEnv(n_cars=CARS_N))
    check_env_specs(wrapped, seed=0)
    env = TransformedEnv(wrapped, RewardSum(in_keys=wrapped.reward_keys))
    observation_n = env.observation_spec[GROUP, "observation"].shape[-1]
    policy, critic = networks(observation_n)
    loss = ClipPPOLoss(policy, critic, clip_epsilon=0.2, entropy_coeff=0.0, normalize_advantage=True)
    loss.set_keys(
        reward=(GROUP, "reward"),
        action=(GROUP, "action"),
        value=(GROUP, "state_value"),
        done=(GROUP, "done"),
        terminated=(GROUP, "terminated"),
        sample_log_prob=(GROUP, "action_log_prob"),
    )
    loss.make_value_estimator(loss.default_value_estimator, gamma=0.98, lmbda=0.95)
    estimator: GAE = loss.value_estimator
    optimizer = torch.optim.Adam(loss.parameters(), lr=7e-4)
    collector = Collector(env, policy, frames_per_batch=options.batch, total_frames=options.frames)
    for data in collector:
        with torch.no_grad():
            estimator(data, params=loss.critic_network_params, target_params=loss.target_critic_network_params)
        samples = data.reshape(-1)
        for _ in range(6):
            for picked in torch.randperm(len(samples)).split(256):
                found = loss(samples[picked])
                optimizer.zero_grad()
                (found["loss_objective"] + found["loss_critic"]).backward()
                torch.nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
        print("mean reward of a step:", data["next", GROUP, "reward"].mean().item())
    collector.shutdown()


if __name__ == "__main__":
    main()
