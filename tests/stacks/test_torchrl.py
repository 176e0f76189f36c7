"""The example for torchrl trains."""

from __future__ import annotations

import math
from collections.abc import Callable

from tests.stacks.conftest import require_package

require_package("torchrl", "torchrl")


def test_the_example_trains(run_example: Callable[..., str]) -> None:
    said = run_example("torchrl_cars.py", "--frames", "400", "--batch", "200")
    rewards = [float(line.split(":")[1]) for line in said.splitlines() if line.startswith("mean reward")]
    assert len(rewards) == 2
    assert all(map(math.isfinite, rewards))
