"""Wheels of a car on a curve: each rolls on its own circle, and the front ones tell the bicycle's angle."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.robots.cars.models import CarModels
from fleet.robots.cars.racecar import racecar_spec
from fleet.world.bullet.ackermann import Ackermann

SPEC = racecar_spec()


def test_wheels_roll_on_circles_around_one_point() -> None:
    steering, speed = 0.5, 1.2
    spins, angles = Ackermann(CarModels.alike(SPEC, 1)).motions(np.array([0]), np.array([steering]), np.array([speed]))
    radius = SPEC.wheelbase_m / np.tan(steering)  # of the middle of the rear axle
    half = SPEC.track_m / 2
    inner, outer = radius - half, radius + half
    radii = np.array([inner, outer, np.hypot(inner, SPEC.wheelbase_m), np.hypot(outer, SPEC.wheelbase_m)])
    assert spins[0] == pytest.approx(speed / radius * radii / SPEC.wheel_radius_m)
    assert angles[0] == pytest.approx([np.arctan(SPEC.wheelbase_m / inner), np.arctan(SPEC.wheelbase_m / outer)])


def test_front_wheels_tell_the_bicycle() -> None:
    ackermann, cars = Ackermann(CarModels.alike(SPEC, 9)), np.arange(9)
    steering = np.linspace(-0.8, 0.8, 9)
    assert ackermann.bicycles(cars, ackermann.motions(cars, steering, np.ones(9))[1]) == pytest.approx(steering)
    assert ackermann.bicycles(cars[:0], np.zeros((0, 2))).shape == (0,)
