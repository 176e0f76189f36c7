"""Pieces of path and manoeuvres of robots that turn on the spot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fleet.robots.pursuit import PathBuffer
from fleet.robots.twist.path import TURN_M_PER_RAD, arc, straight, turn
from fleet.robots.twist.rejoin import turn_drive_turn

POSE = np.array([1.0, 2.0, math.pi / 2])


def test_a_straight_goes_where_the_nose_points() -> None:
    points, s = straight(POSE, 1.5)
    np.testing.assert_allclose(points[-1], [1.0, 3.5, math.pi / 2], atol=1e-12)
    assert (s[0], s[-1]) == (0.0, 1.5)


@pytest.mark.parametrize(("angle", "end"), [(math.pi / 2, [0.5, 2.5, math.pi]), (-math.pi / 2, [1.5, 2.5, 0.0])])
def test_a_quarter_circle_ends_beside_and_ahead(angle: float, end: list[float]) -> None:
    points, s = arc(POSE, 0.5, angle)
    np.testing.assert_allclose(points[-1], end, atol=1e-12)
    assert s[-1] == pytest.approx(0.5 * math.pi / 2)
    # All points are on the circle.
    centre = np.array([1.0 - math.copysign(0.5, angle), 2.0])
    np.testing.assert_allclose(np.hypot(*(points[:, :2] - centre).T), 0.5)


def test_a_turn_on_the_spot_has_arc_length_and_fits_into_a_path() -> None:
    points, s = turn(POSE, -1.0)
    np.testing.assert_allclose(points[:, :2], [[1.0, 2.0], [1.0, 2.0]])
    assert s[-1] == pytest.approx(TURN_M_PER_RAD)
    paths = PathBuffer(1)
    paths.reset(0, POSE)
    paths.append(0, points, s)
    paths.append(0, *straight(points[-1], 1.0))
    assert paths.end_s(0) == pytest.approx(TURN_M_PER_RAD + 1.0)


def ends(start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    found = turn_drive_turn(start, goal)
    assert found is not None
    at = start
    for points, s in found.pieces:
        np.testing.assert_allclose(points[0, :2], at[:2], atol=1e-12)
        assert math.cos(points[0, 2] - at[2]) == pytest.approx(1.0, abs=1e-3)
        assert (np.diff(s) > 0).all()
        at = points[-1]
    return at


@pytest.mark.parametrize(
    "goal", [[2.0, 1.0, 0.3], [-2.0, 0.4, 0.1], [0.0, 0.0, 2.0], [0.0, -1.0, 0.0], [1.0, 0.0, 3.1]]
)
def test_a_manoeuvre_joins_both_poses(goal: list[float]) -> None:
    at = ends(np.zeros(3), np.array(goal))
    np.testing.assert_allclose(at[:2], goal[:2], atol=1e-9)
    assert math.cos(at[2] - goal[2]) == pytest.approx(1.0, abs=1e-4)


def test_what_lies_behind_is_reached_in_reverse_unless_that_is_not_free() -> None:
    start, goal = np.zeros(3), np.array([-1.0, 0.0, 0.0])
    found = turn_drive_turn(start, goal)
    assert found is not None
    assert found.directions == (-1,)
    # In reverse the nose points to 0 all the way: where that is not free, the robot turns round and drives forward.
    forward = turn_drive_turn(
        start, goal, lambda poses: (np.abs(poses[:, 0] + 0.5) > 0.4) | (np.cos(poses[:, 2]) < 0.0)
    )
    assert forward is not None
    assert forward.directions == (1, 1, 1)
    assert turn_drive_turn(start, goal, lambda poses: poses[:, 0] > -0.5) is None


def test_a_turn_is_checked_all_the_way_round() -> None:
    goal = np.array([0.0, 0.0, 2.0])
    assert turn_drive_turn(np.zeros(3), goal, lambda poses: np.abs(poses[:, 2] - 1.0) > 0.2) is None
