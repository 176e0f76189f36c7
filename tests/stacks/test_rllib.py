"""The example for rllib trains."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from tests.stacks.conftest import require_package

require_package("ray", "rllib")


@pytest.mark.parametrize("env", ["navigate", "dispatch"])
def test_the_example_trains(run_example: Callable[..., str], env: str) -> None:
    said = run_example("rllib_cars.py", "--env", env, "--iterations", "2", "--batch", "100", "--cycles", "50")
    returns = [float(line.split(":")[1]) for line in said.splitlines() if line.startswith("mean return")]
    assert len(returns) == 2
    assert all(map(math.isfinite, returns))
