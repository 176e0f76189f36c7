"""Batteries: what distance, load and time take, and what a charger gives."""

import numpy as np
import pytest

from fleet.config import BatteryConfig
from fleet.errors import ConfigError
from fleet.robots.battery import Batteries, force_n

TICK_S = 0.05
CAR_KG = 6.3


def after(seconds: float, *, speed: float = 0.0, load_kg: float = 0.0, awake: bool = True, charging: bool = False):
    """Charge of one car after a time."""
    batteries = Batteries(BatteryConfig(start=0.5), np.full(1, CAR_KG), TICK_S)
    for _ in range(round(seconds / TICK_S)):
        batteries.tick(np.array([speed]), np.array([load_kg]), np.array([awake]), np.array([charging]))
    return float(batteries.charge[0])


def test_time_takes_its_power() -> None:
    assert 0.5 - after(600.0) == pytest.approx(15.0 * 600 / (3600 * 55.5))
    assert 0.5 - after(600.0, awake=False) == pytest.approx(2.0 * 600 / (3600 * 55.5))


def test_distance_and_load_take_more() -> None:
    standing, empty, loaded = after(100.0), after(100.0, speed=-1.0), after(100.0, speed=1.0, load_kg=2.0)
    assert standing - empty == pytest.approx(100.0 * force_n(CAR_KG) / (3600 * 55.5))
    assert standing - loaded == pytest.approx(100.0 * force_n(CAR_KG + 2.0) / (3600 * 55.5))
    assert loaded < empty < standing


def test_the_estimate_is_what_the_drive_takes() -> None:
    share = Batteries(BatteryConfig(), np.full(1, CAR_KG), TICK_S).share([0], 100.0, 100.0, 2.0)
    assert float(share[0]) == pytest.approx(0.5 - after(100.0, speed=1.0, load_kg=2.0))


def test_a_charger_fills_at_its_power_and_not_beyond_full() -> None:
    assert after(180.0, charging=True) - 0.5 == pytest.approx(0.1)
    assert after(1800.0, charging=True) == 1.0


def test_a_battery_is_never_less_than_empty_and_the_least_is_kept() -> None:
    batteries = Batteries(BatteryConfig(capacity_wh=0.01), np.full(2, CAR_KG), 1.0)
    for _ in range(10):
        batteries.tick(np.zeros(2), np.zeros(2), np.array([True, False]), np.zeros(2, dtype=np.bool_))
    assert batteries.charge[0] == 0.0
    assert batteries.charge[1] > 0.0
    assert batteries.lowest == 0.0


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"capacity_wh": 0.0}, r"battery.capacity_wh is 0.0; valid: a number > 0"),
        ({"low": 0.1}, r"battery.margin, critical, low, enough, full is .*; valid: shares that do not decrease"),
        ({"start": 0.0}, r"battery.start is 0.0; valid: a share > 0, at most 1"),
        ({"chargers_n": 0}, r"battery.chargers_n is 0; valid: an integer >= 1, or None"),
    ],
)
def test_settings_that_make_no_sense(settings: dict[str, float], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        BatteryConfig(**settings)  # type: ignore[arg-type]
