"""TorchRL: an environment is checked, wrapped, and rolled out by a policy that all cars share and PPO improves.

pip install '.[torchrl]'
python docs/examples/training/torchrl_cars.py                   # cars drive to places: two numbers each
python docs/examples/training/torchrl_cars.py --env dispatch    # cars choose their tasks, of which masks tell the legal
"""

import argparse

import torch
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector
from torchrl.envs import check_env_specs
from torchrl.envs.libs.pettingzoo import PettingZooWrapper
from torchrl.modules import MaskedCategorical, MultiAgentMLP, NormalParamExtractor, ProbabilisticActor, TanhNormal
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from fleet.envs import dispatch_v1, navigate_v1

ENVS = {"navigate": navigate_v1.parallel_env, "dispatch": dispatch_v1.parallel_env}
GROUP = "car"
N_CARS = 6


def networks(env: PettingZooWrapper, *, masked: bool) -> tuple[ProbabilisticActor, TensorDictModule]:
    """Policy and value, shared by all cars."""
    row = (GROUP, "observation", "observation") if masked else (GROUP, "observation")
    sizes = {"n_agents": N_CARS, "centralized": False, "share_params": True, "depth": 2, "num_cells": 64}

    def network(n_outputs: int) -> MultiAgentMLP:
        return MultiAgentMLP(n_agent_inputs=env.observation_spec[row].shape[-1], n_agent_outputs=n_outputs, **sizes)

    if masked:
        actor = network(env.full_action_spec_unbatched[GROUP, "action"].space.n)
        out_keys = [(GROUP, "logits")]
        in_keys = {"logits": (GROUP, "logits"), "mask": (GROUP, "action_mask")}
    else:
        actor = torch.nn.Sequential(network(4), NormalParamExtractor())
        in_keys = out_keys = [(GROUP, "loc"), (GROUP, "scale")]
    policy = ProbabilisticActor(
        TensorDictModule(actor, [row], out_keys),
        in_keys=in_keys,
        out_keys=[(GROUP, "action")],
        distribution_class=MaskedCategorical if masked else TanhNormal,
        return_log_prob=True,
    )
    return policy, TensorDictModule(network(1), [row], [(GROUP, "state_value")])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", choices=ENVS, default="navigate")
    parser.add_argument("--frames", type=int, default=200_000, help="steps of the environment")
    parser.add_argument("--batch", type=int, default=2_000, help="of them, between two updates")
    options = parser.parse_args()

    torch.manual_seed(0)
    masked = options.env == "dispatch"
    env = PettingZooWrapper(ENVS[options.env](n_cars=N_CARS), use_mask=masked)
    check_env_specs(env, seed=0)
    policy, critic = networks(env, masked=masked)
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
    collector = Collector(
        env,
        policy,
        frames_per_batch=options.batch,
        total_frames=options.frames,
        auto_register_policy_transforms=False,  # the policy remembers nothing
    )
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
        told = data["next", GROUP]
        print("mean reward of a step:", told["reward"].mean().item(), "illegal:", int(told["info", "illegal"].sum()))
    collector.shutdown()


if __name__ == "__main__":
    main()
