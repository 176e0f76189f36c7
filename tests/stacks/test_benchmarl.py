"""The example for benchmarl trains."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import pytest

from tests.stacks.conftest import require_package

require_package("benchmarl", "benchmarl")


@pytest.mark.parametrize(("env", "algorithm"), [("navigate", "ippo"), ("navigate", "mappo"), ("dispatch", "mappo")])
def test_the_example_trains(run_example: Callable[..., str], env: str, algorithm: str) -> None:
    budget = ("--frames", "400", "--batch", "200", "--cycles", "50")
    said = run_example("benchmarl_cars.py", "--env", env, "--algorithm", algorithm, *budget)
    found = re.search(r"frames learned from: 400 mean return: (.+)", said)
    assert found is not None
    assert math.isfinite(float(found[1]))
