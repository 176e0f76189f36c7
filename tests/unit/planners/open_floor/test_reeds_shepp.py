"""Reeds-Shepp curves are as short as OMPL's, and end where they should."""

import math

import numpy as np
import pytest
from ompl import base as ob

from planners.open_floor.kernels.reeds_shepp import (
    MOST_SEGMENTS,
    TABLE_RADII,
    length_table,
    shortest_length,
    shortest_way,
    tabulated_length,
)

RNG = np.random.default_rng(7)
NEAR = np.column_stack([RNG.uniform(-1, 1, (150, 2)), RNG.uniform(-math.pi, math.pi, 150)])
FAR = np.column_stack([RNG.uniform(-12, 12, (150, 2)), RNG.uniform(-math.pi, math.pi, 150)])
POSES = [*NEAR.tolist(), *FAR.tolist(), [2.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 0.0, math.pi], [0.0, 4.0, math.pi]]


@pytest.fixture(scope="module")
def ompl_length():
    """Return the length that OMPL finds for a pose."""
    space = ob.ReedsSheppStateSpace(1.0)
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(-100)
    bounds.setHigh(100)
    space.setBounds(bounds)
    origin, state = space.allocState(), space.allocState()

    def length(x: float, y: float, yaw: float) -> float:
        for where, pose in ((origin, (0.0, 0.0, 0.0)), (state, (x, y, yaw))):
            where.setX(pose[0])
            where.setY(pose[1])
            where.setYaw(pose[2])
        return float(space.distance(origin, state))

    return length


def test_lengths_are_those_of_ompl(ompl_length) -> None:
    assert max(abs(shortest_length(*pose) - ompl_length(*pose)) for pose in POSES) < 1e-9


def test_the_segments_lead_to_the_pose_and_have_its_length() -> None:
    for pose in POSES:
        segments = np.zeros((MOST_SEGMENTS, 2))
        n = shortest_way(*pose, segments)
        place, yaw = 0j, 0.0
        for length, side in segments[:n]:
            turned = yaw + side * length
            place += length * np.exp(1j * yaw) if side == 0 else (np.exp(1j * turned) - np.exp(1j * yaw)) / (1j * side)
            yaw = turned
        assert abs(place - complex(pose[0], pose[1])) < 1e-9
        assert abs(math.remainder(yaw - pose[2], 2 * math.pi)) < 1e-9
        assert abs(np.abs(segments[:n, 0]).sum() - shortest_length(*pose)) < 1e-9


def test_the_table_is_right_at_its_entries_on_all_sides() -> None:
    table = length_table()
    edge = TABLE_RADII - 0.01
    for x, y, heading in ((1.25, 2.5, 5), (-1.25, 2.5, 5), (1.25, -2.5, 5), (-1.25, -2.5, 5), (edge, -edge, 31)):
        yaw = heading * 2 * math.pi / 32
        x, y = (round(4 * value) / 4 for value in (x, y))  # noqa: PLW2901 - the nearest entry
        assert tabulated_length(table, x, y, yaw) == pytest.approx(shortest_length(x, y, yaw), abs=1e-9)
