"""Cars of several models: numbers of each car, and what all of them share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fleet.errors import ConfigError
from fleet.robots.cars.models import CarModels, usual_car
from tests.hauler import hauler_spec

USUAL, HAULER = usual_car(), hauler_spec()
BOTH = CarModels(kinds=(USUAL, HAULER), kind_of=np.array([0, 1, 0]))


def test_each_car_has_the_numbers_of_its_model() -> None:
    assert BOTH.each("max_payload_kg").tolist() == [2.0, 6.0, 2.0]
    assert [BOTH[car].name for car in range(len(BOTH))] == [USUAL.name, "hauler", USUAL.name]
    assert BOTH.some(np.array([1])).each("max_speed_mps").tolist() == [0.8]
    assert BOTH.most("height_m") == 0.25


def test_a_part_for_one_model_refuses_several_and_names_them() -> None:
    assert CarModels.alike(HAULER, 2).only is HAULER
    with pytest.raises(ConfigError, match=f"models {USUAL.name}, hauler; valid: one model"):
        _ = BOTH.only


def test_an_unknown_model_is_refused_with_its_car() -> None:
    with pytest.raises(ConfigError, match=f"car_1: model is 'hippo'; valid: {USUAL.name}"):
        CarModels.named([USUAL.name, "hippo"])


def test_the_hull_is_as_large_as_the_largest() -> None:
    long = replace(USUAL, front_m=0.6)
    models = CarModels(kinds=(long, HAULER), kind_of=np.array([0, 1]))
    assert (models.hull.front_m, models.hull.half_width_m) == (0.6, 0.22)
    assert CarModels.alike(USUAL, 3).hull is USUAL


def test_a_footprint_is_the_body_and_the_circle_at_the_lock_of_the_steering() -> None:
    footprint = HAULER.footprint
    assert (footprint.front_m, footprint.half_width_m) == (0.55, 0.22)
    assert footprint.rear_m == pytest.approx(0.07)
    assert footprint.turn_radius_m == pytest.approx(0.38 / np.tan(0.8))
