"""Every vehicle drives its course alone, in physics and in its kinematic model, as exactly as it promises."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from fleet.proving.course import LANES, Course
from fleet.proving.show import BACK_TO, arrivals_apart
from fleet.proving.trial import TrialReport, drive, yaw_rate_error
from fleet.proving.vehicles import VEHICLES

pytestmark = pytest.mark.bullet

TURNING = [name for name, vehicle in VEHICLES.items() if vehicle.turns]


@functools.cache
def driven(name: str, world: str, load_kg: float = 0.0) -> TrialReport:
    vehicle = VEHICLES[name]
    if world == "kinematic":
        body = vehicle.kinematic()
    else:
        body = vehicle.physics(load_kg, 1.0, np.random.default_rng(1))
    return drive(body, vehicle.control(np.random.default_rng(0)), vehicle.course)


@pytest.mark.parametrize("world", ["kinematic", "physics"])
@pytest.mark.parametrize("name", VEHICLES)
def test_a_vehicle_follows_its_course_within_its_limits_up_to_the_dock(name: str, world: str) -> None:
    report = driven(name, world)
    assert report.arrived
    assert max(report.straight_m, report.curve_m, report.turn_m) <= VEHICLES[name].cross_track_m
    assert report.dock_m <= 0.03
    assert report.excess <= 1e-6


@pytest.mark.parametrize("name", VEHICLES)
def test_both_worlds_arrive_at_the_same_times(name: str) -> None:
    assert arrivals_apart(driven(name, "physics"), driven(name, "kinematic")) <= 0.03


@pytest.mark.parametrize("name", VEHICLES)
def test_a_course_has_straights_both_turns_and_a_dock(name: str) -> None:
    legs = VEHICLES[name].course.legs
    assert {(leg.kind, leg.size > 0) for leg in legs} >= {("straight", True), ("curve", True), ("curve", False)}
    assert legs[-1].kind == "straight"


def test_a_husky_turns_as_it_is_told() -> None:
    assert yaw_rate_error(VEHICLES["husky"]) <= 0.02
    assert yaw_rate_error(VEHICLES["husky"], load_kg=20.0) <= 0.02


@pytest.mark.parametrize("name", TURNING)
def test_a_vehicle_comes_back_to_its_lane(name: str) -> None:
    vehicle = VEHICLES[name]
    body = vehicle.physics(0.0, 1.0, np.random.default_rng(1))
    report = drive(body, vehicle.control(np.random.default_rng(0)), Course.back_to(BACK_TO))
    assert report.arrived
    assert report.dock_m <= vehicle.cross_track_m


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_an_a1_carries_two_kilograms_over_fifty_metres_of_lanes(seed: int) -> None:
    rng = np.random.default_rng([7, seed])
    report = drive(VEHICLES["a1"].physics(2.0, rng.uniform(0.8, 1.0), rng), VEHICLES["a1"].control(rng), LANES)
    assert report.arrived
    assert not report.fell
    assert LANES.way_m / report.time_s >= 0.3
    assert report.lean_rad <= 0.1


@pytest.mark.slow
def test_an_a1_that_is_pushed_stays_up() -> None:
    vehicle, fallen = VEHICLES["a1"], 0
    for seed in range(10):
        rng = np.random.default_rng([8, seed])
        angle = rng.uniform(-np.pi, np.pi)
        pushed = (6.0, 0.8 * np.cos(angle), 0.8 * np.sin(angle))
        body = vehicle.physics(2.0, 1.0, rng)
        fallen += drive(body, vehicle.control(rng), vehicle.course, pushed=pushed).fell
    assert fallen <= 1
