"""Stable-Baselines3: PPO, one policy shared by all cars; with masks it is sb3-contrib's.

pip install '.[sb3]'
python docs/examples/training/sb3_cars.py                  # cars drive to places: two numbers each
python docs/examples/training/sb3_cars.py --env dispatch   # cars choose their tasks, of which masks tell the legal
"""

import argparse

from sb3_contrib import MaskablePPO
from stable_baselines3 import PPO

from fleet.envs import dispatch_v1, navigate_v1
from fleet.training.stacks.sb3 import TypeVecEnv

ENVS = {"navigate": navigate_v1.parallel_env, "dispatch": dispatch_v1.parallel_env}
ALGORITHMS = {"navigate": PPO, "dispatch": MaskablePPO}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", choices=ENVS, default="navigate")
    parser.add_argument("--steps", type=int, default=1_000_000, help="steps of agents")
    parser.add_argument("--horizon", type=int, default=128, help="steps of each environment between two updates")
    options = parser.parse_args()

    cars = TypeVecEnv([lambda: ENVS[options.env](n_cars=6)] * 8, kind="car")
    model = ALGORITHMS[options.env](
        "MlpPolicy",
        cars,
        n_steps=options.horizon,
        batch_size=1024,
        n_epochs=6,
        gamma=0.98,
        learning_rate=7e-4,
        seed=0,
        device="cpu",
    )
    model.learn(options.steps, progress_bar=False)
    print("mean reward of a step:", model.rollout_buffer.rewards.mean())
    cars.close()


if __name__ == "__main__":
    main()
