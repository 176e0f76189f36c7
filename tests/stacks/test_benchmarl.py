"""The example for benchmarl trains."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.stacks.conftest import require_package

require_package("benchmarl", "benchmarl")


@pytest.mark.parametrize("algorithm", ["ippo", "mappo"])
def test_the_example_trains(run_example: Callable[..., str], algorithm: str) -> None:
    said = run_example(
        "benchmarl_cars.py", "--algorithm", algorithm, "--frames", "400", "--batch", "200", "--cycles", "100"
    )
    assert "frames learned from: 400" in said
