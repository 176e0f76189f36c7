"""The example for torchrl trains, and environments that kernels step pass its checks."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from fleet.envs import make_vec
from tests.stacks.conftest import require_package

require_package("torchrl", "torchrl")

import torch  # noqa: E402
from torchrl.envs import check_env_specs  # noqa: E402

from fleet.training.stacks.torchrl import VectorEnvBase  # noqa: E402


@pytest.mark.parametrize("env", ["navigate", "dispatch"])
def test_the_example_trains(run_example: Callable[..., str], env: str) -> None:
    said = run_example("torchrl_cars.py", "--env", env, "--frames", "400", "--batch", "200")
    told = [line.split(":") for line in said.splitlines() if line.startswith("mean reward")]
    assert len(told) == 2
    for _, reward, illegal in told:
        assert math.isfinite(float(reward.split()[0]))
        assert int(illegal) == 0


@pytest.mark.parametrize("layer", ["dispatch", "navigate"])
def test_arrays_pass_its_checks(layer: str) -> None:
    env = VectorEnvBase(make_vec(layer, 2, site="small", n_cars=3, max_cycles=4))
    check_env_specs(env, seed=0)
    told = env.rollout(10, break_when_any_done=False)
    assert told.batch_size == torch.Size([2, 10])
    assert told["next", "truncated"].squeeze(-1).nonzero()[:, 1].tolist() == [3, 7, 3, 7]
    rows = told["car", "observation"]
    last = told["next", "car", "observation"]
    assert (rows[:, 1:4] == last[:, :3]).all(), "within an episode"
    assert (rows[:, 4] != last[:, 3]).any(), "the next one begins anew"
    env.close()
