"""Every standing robot stands quietly in a world of its own step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fleet.robots.standing import STANDING, StandingRobot
from fleet.world.bullet.vehicles.standing import Standing, StandReport

pytestmark = pytest.mark.bullet


def stood(robot: StandingRobot, push_ns: np.ndarray | None = None) -> StandReport:
    standing = Standing(robot)
    try:
        return standing.run(2.0, push_ns)
    finally:
        standing.close()


@pytest.mark.parametrize("name", STANDING)
def test_it_stands_still_and_a_push_does_not_fell_it(name: str) -> None:
    report = stood(STANDING[name], np.array([3.0, 0.0]))
    assert report.stands
    assert report.drift_m < 0.005
    assert report.lean_rad < 0.02


def test_a_robot_whose_motors_are_too_weak_does_not_stand() -> None:
    assert not stood(replace(STANDING["vision60"], torque_nm=2.0)).stands
