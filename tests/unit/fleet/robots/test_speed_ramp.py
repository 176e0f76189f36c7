"""Commands approach told speeds within a car's limits: 1.5 m/s^2 faster, 2.5 m/s^2 slower."""

import numpy as np
import pytest

from fleet.robots.cars.models import CarModels, usual_car
from fleet.robots.speed_ramp import SpeedRamp

TICK_S = 0.1


def driven(told: list[float], *, blocked: bool = False) -> list[float]:
    """Commands of a car that does what it is commanded, or cannot move."""
    ramp, speed, commands = SpeedRamp(CarModels.alike(usual_car(), 1), TICK_S), 0.0, []
    for one in told:
        command = float(ramp.tick(np.array([one]), np.array([speed]))[0])
        commands.append(command)
        speed = 0.0 if blocked else command
    return commands


def test_a_car_gains_and_loses_what_its_model_does() -> None:
    assert driven([0.4, 0.4, 0.4, 0.0, 0.0]) == pytest.approx([0.15, 0.3, 0.4, 0.15, 0.0])


def test_a_change_of_direction_brakes_to_a_stand_first() -> None:
    assert driven([0.15, -1.0, -1.0]) == pytest.approx([0.15, 0.0, -0.15])


def test_a_blocked_car_does_not_wind_up() -> None:
    assert max(driven([2.0] * 20, blocked=True)) == pytest.approx(0.45)  # 0.3 m/s ahead of what it drives, and a tick
