"""A lifter carries a pod where it should, and its legs touch nothing on the way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fleet.proving import pods
from fleet.proving.pods import PodReport, carry
from fleet.robots.twist import lifter

pytestmark = pytest.mark.bullet


@pytest.fixture(scope="module")
def carried() -> PodReport:
    return carry(3)


def test_a_pod_is_set_down_within_two_centimetres_and_two_degrees(carried: PodReport) -> None:
    assert carried.arrived
    assert carried.off_m <= 0.02
    assert carried.off_rad <= math.radians(2.0)


def test_a_pod_is_clear_of_the_floor_and_touches_the_plate_alone(carried: PodReport) -> None:
    assert carried.lifted_m >= 0.02
    assert carried.n_touches == 0
    assert carried.lean_rad <= 0.01


def test_a_pod_that_is_not_lifted_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lifter, "_PLATE_MASS_KG", 6.0)  # more than the solver can lift with it
    monkeypatch.setattr(pods, "_MOST_S", 12.0)
    report = carry(3)
    assert report.n_touches > 0
    assert report.lifted_m < 0.005


def test_a_course_leads_under_the_pod_twenty_metres_on_and_away() -> None:
    legs = np.array([leg.size for leg in pods.COURSE.legs if leg.kind == "straight"])
    assert legs[1:3].sum() == 20.0
    assert legs[-1] > 0.5 * (0.9 + 0.75)
