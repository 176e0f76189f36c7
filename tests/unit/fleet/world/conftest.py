"""A small hall for world tests: numbers are round, so that expected values can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.robots import ARMS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec
from fleet.world.scene import Scene, StaticBox


@pytest.fixture(scope="session")
def hall() -> Scene:
    """Return a 10 x 6 m floor with a wall, a pedestal and one arm; two cars face east, 3 m apart in one row."""
    arm = ARMS["iiwa"].spec()
    return Scene(
        size_m=(10.0, 6.0),
        boxes=(
            StaticBox(kind="wall", centre_m=(9.5, 3.0, 0.5), half_m=(0.5, 3.0, 0.5)),
            StaticBox(kind="pedestal", centre_m=(2.0, 5.0, 0.125), half_m=(0.08, 0.08, 0.125)),
            StaticBox(kind="wall", centre_m=(5.5, 0.5, 2.0), half_m=(0.5, 0.5, 0.1)),  # an arch cars pass under
        ),
        car_kinds=(racecar_spec(),),
        car_start=np.array([[1.5, 1.5, 0.0], [4.5, 1.5, 0.0]]),
        arms=ArmTeam.alike(arm, 1),
        arm_base=np.array([[2.0, 4.5, 0.0, -np.pi / 2]]),
        arm_start=arm.home_rad[None].copy(),
    )
