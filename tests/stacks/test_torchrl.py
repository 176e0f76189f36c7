"""The example for torchrl trains."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from tests.stacks.conftest import require_package

require_package("torchrl", "torchrl")


@pytest.mark.parametrize("env", ["navigate", "dispatch"])
def test_the_example_trains(run_example: Callable[..., str], env: str) -> None:
    said = run_example("torchrl_cars.py", "--env", env, "--frames", "400", "--batch", "200")
    told = [line.split(":") for line in said.splitlines() if line.startswith("mean reward")]
    assert len(told) == 2
    for _, reward, illegal in told:
        assert math.isfinite(float(reward.split()[0]))
        assert int(illegal) == 0
