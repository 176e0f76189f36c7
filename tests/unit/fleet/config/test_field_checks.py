"""Kinds of values against what is declared for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import pytest

from fleet.config import AllocationConfig, CarConfig, RunConfig, ScenarioEvent, StreamConfig
from fleet.config.field_checks import is_number, is_whole, misfits
from fleet.errors import ConfigError


class Colour(StrEnum):
    RED = "red"


@dataclass
class Paint:
    colour: Colour = Colour.RED
    litres: float = 1.0
    coats_n: int | None = None
    glossy: bool = False
    walls: tuple[str, ...] = ()
    window_m: tuple[float, float] = (1.0, 2.0)
    prices: Mapping[str, float] = field(default_factory=dict)


@pytest.mark.parametrize(
    ("name", "good"),
    [
        ("colour", "red"),
        ("litres", 2),
        ("litres", np.float32(2.5)),
        ("coats_n", np.int64(3)),
        ("walls", ["north"]),
        ("window_m", [1, 2.5]),
        ("prices", {"red": 3}),
    ],
)
def test_what_is_declared_fits(name: str, good: object) -> None:
    assert misfits(Paint(**{name: good})) == []  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "bad", "valid"),
    [
        ("litres", "x", "a number"),
        ("litres", True, "a number"),
        ("coats_n", 2.5, "an integer or None"),
        ("coats_n", True, "an integer or None"),
        ("glossy", 1, "True or False"),
        ("walls", "north", "a tuple, each a text"),
        ("walls", (3,), "a tuple, each a text"),
        ("window_m", (1.0,), "a tuple of 2, each a number"),
        ("prices", {"red": "much"}, "a mapping of a text to a number"),
        ("prices", None, "a mapping of a text to a number"),
    ],
)
def test_another_kind_is_named_with_what_would_be_valid(name: str, bad: object, valid: str) -> None:
    assert misfits(Paint(**{name: bad})) == [(name, bad, valid)]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "whole", "number"),
    [
        (np.int32(3), True, True),
        (3.0, False, True),
        (np.float32(3.5), False, True),
        (True, False, False),
        (float("nan"), False, False),
        (float("inf"), False, False),
        ("3", False, False),
        (None, False, False),
    ],
)
def test_truth_values_and_what_is_not_finite_are_no_numbers(value: object, whole: bool, number: bool) -> None:
    assert (is_whole(value), is_number(value)) == (whole, number)


@pytest.mark.parametrize(
    ("settings", "bad", "message"),
    [
        (RunConfig, {"site": 3}, "RunConfig.site is 3; valid: a text"),
        (RunConfig, {"duration_s": "x"}, "RunConfig.duration_s is 'x'; valid: a number"),
        (RunConfig, {"robots": 2.5}, "RunConfig.robots is 2.5; valid: an integer"),
        (RunConfig, {"events": ("car_dead",)}, "valid: a tuple, each a ScenarioEvent"),
        (RunConfig, {"traffic": None}, "valid: a TrafficConfig"),
        (CarConfig, {"capabilities": "cold"}, "valid: a tuple, each a text"),
        (StreamConfig, {"slack_s": (1.0,)}, "valid: a tuple of 2, each a number"),
        (AllocationConfig, {"station_cap_n": "2"}, "valid: an integer"),
        (ScenarioEvent, {"time_s": 1.0, "kind": ["car_dead"], "target": "car_0"}, "valid: a text"),
    ],
)
def test_settings_of_a_run_refuse_another_kind(settings: type, bad: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError) as refused:
        settings(**bad)
    assert message in str(refused.value)
