"""Settings of a run refuse another kind of value; what callers hand over is told from numbers."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.config import AllocationConfig, CarConfig, RunConfig, ScenarioEvent, StreamConfig, TrafficConfig
from fleet.config.field_checks import is_number, is_whole
from fleet.errors import ConfigError


@pytest.mark.parametrize(
    ("value", "whole", "number"),
    [
        (np.int32(3), True, True),
        (3.0, False, True),
        (np.float32(3.5), False, True),
        (True, False, False),
        (10**400, True, False),
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
        (TrafficConfig, {"planner_settings": {"rounds": [2]}}, "valid: a mapping of a text to True or False or"),
        (AllocationConfig, {"allocator_settings": {3: 2}}, "valid: a mapping of a text to True or False or"),
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


@pytest.mark.parametrize("name", ["car_3", "car_-1", "car_01", "car_", "truck_0", ""])
def test_a_car_that_the_fleet_has_not_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=f"cars is '{name}'; valid: car_0 to car_2"):
        RunConfig(robots=3, cars={name: CarConfig()})
    assert RunConfig(robots=10**9, cars={"car_999999999": CarConfig()}).cars
