"""Observations mean what they meant: numbers of short episodes are those that were kept."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.envs import ENVIRONMENTS
from tests.contract.golden import CASES, FILE, VARIANTS, GoldenCase, differences, read, seen

ADVICE = "if that is meant: a new version of the environment, and python -m tests.contract.golden"


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name, marks=[pytest.mark.bullet] * (case.arguments["fidelity"] == "physics"))
        for case in CASES
    ],
)
def test_observations_mean_what_they_meant(case: GoldenCase) -> None:
    kept = read()
    assert case.name in kept, f"nothing is kept of it: {ADVICE}"
    assert differences(kept[case.name], seen(case)) == [], ADVICE


def test_every_environment_has_its_numbers() -> None:
    assert set(ENVIRONMENTS) <= set(VARIANTS)
    assert list(read()) == [case.name for case in CASES]
    assert FILE.stat().st_size < 200_000


def test_a_changed_meaning_is_told_and_a_last_bit_is_not() -> None:
    was = {"car_0, step 0": [0.1234, -0.5, 0.0]}
    assert differences(was, {"car_0, step 0": [0.1235, -0.5, 0.0]}) == []
    assert differences(was, {"car_0, step 0": [0.1234, 0.5, 0.0]}) == ["car_0, step 0: entry 1 was -0.5 and is 0.5"]
    assert differences(was, {"car_0, step 0": [0.1234, -0.5]}) == ["car_0, step 0: 3 numbers have become 2"]
    assert "agents were" in differences(was, {"car_1, step 0": [0.0]})[0]
    many = differences({"a": np.zeros(9).tolist()}, {"a": np.ones(9).tolist()})
    assert many[-1] == "a: 4 entries more"
