"""BenchMARL: MAPPO and IPPO from one task class of our own.

pip install '.[benchmarl]'
python docs/examples/training/benchmarl_cars.py                 # cars drive to places: two numbers each
python docs/examples/training/benchmarl_cars.py --env dispatch  # cars choose their tasks, of which masks tell the legal
"""

import argparse
import tempfile
from collections.abc import Callable
from typing import Any

from benchmarl.algorithms import IppoConfig, MappoConfig
from benchmarl.environments import Task
from benchmarl.environments.pettingzoo.common import PettingZooClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from torchrl.envs import EnvBase
from torchrl.envs.libs.pettingzoo import PettingZooWrapper

from fleet.envs import dispatch_v1, navigate_v1

ENVS = {"navigate": navigate_v1.parallel_env, "dispatch": dispatch_v1.parallel_env}
ALGORITHMS = {"ippo": IppoConfig, "mappo": MappoConfig}


class FleetClass(PettingZooClass):
    """What BenchMARL asks of a task."""

    @property
    def masked(self) -> bool:
        return self.name == "DISPATCH"

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        make = ENVS[self.name.lower()]
        return lambda: PettingZooWrapper(
            make(**self.config), return_state=True, use_mask=self.masked, seed=seed, device=device
        )

    def supports_continuous_actions(self) -> bool:
        return not self.masked

    def supports_discrete_actions(self) -> bool:
        return self.masked

    def has_state(self) -> bool:
        return True

    def has_render(self, env: EnvBase) -> bool:
        return False

    def max_steps(self, env: EnvBase) -> int:
        return int(env.max_cycles)

    @staticmethod
    def env_name() -> str:
        return "fleet"


class FleetTask(Task):
    """Tasks of this project."""

    NAVIGATE = None
    DISPATCH = None

    @staticmethod
    def associated_class() -> type[FleetClass]:
        return FleetClass


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", choices=ENVS, default="navigate")
    parser.add_argument("--algorithm", choices=ALGORITHMS, default="ippo")
    parser.add_argument("--frames", type=int, default=200_000, help="steps of the environment")
    parser.add_argument("--batch", type=int, default=2_000, help="of them, between two updates")
    parser.add_argument("--cycles", type=int, default=600, help="steps of an episode")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory() as folder:
        settings = ExperimentConfig.get_from_yaml()
        settings.max_n_frames = options.frames
        settings.max_n_iters = None
        settings.on_policy_collected_frames_per_batch = options.batch
        settings.on_policy_n_envs_per_worker = 1
        settings.on_policy_minibatch_size = 256
        settings.on_policy_n_minibatch_iters = 6
        settings.evaluation = False
        settings.render = False
        settings.loggers = []
        settings.create_json = False
        settings.prefer_continuous_actions = True
        settings.save_folder = folder
        experiment = Experiment(
            task=FleetTask[options.env.upper()].get_task({"n_cars": 6, "max_cycles": options.cycles}),
            algorithm_config=ALGORITHMS[options.algorithm].get_from_yaml(),
            model_config=MlpConfig.get_from_yaml(),
            critic_model_config=MlpConfig.get_from_yaml(),
            seed=0,
            config=settings,
        )
        experiment.run()
        print("frames learned from:", experiment.total_frames, "mean return:", experiment.mean_return)


if __name__ == "__main__":
    main()
