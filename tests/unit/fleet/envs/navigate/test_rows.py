"""Rows of the navigation environment: what a car is told, worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fleet.envs.navigate.rows import (
    FIRST_OTHER,
    N_CAR_NUMBERS,
    N_OTHERS,
    N_OWN,
    N_PER_OTHER,
    CarsSeen,
    Seen,
    observe,
    time_to_collision,
)
from fleet.envs.navigate.ways import WayLines, meeting
from fleet.training.recipes.navigate import CAR_LAYOUT

BODY = np.array([0.16, 0.255, 0.145])


def straight(poses: list[tuple[float, float, float]], length_m: float = 10.0) -> WayLines:
    """Return ways that lead straight ahead from each pose."""
    s = np.linspace(0.0, length_m, 101)
    points = np.array([[(x + d * math.cos(yaw), y + d * math.sin(yaw), yaw) for d in s] for x, y, yaw in poses])
    n = len(poses)
    return WayLines(
        points=points,
        s=np.tile(s, (n, 1)),
        counts=np.full(n, len(s), dtype=np.int64),
        cursor=np.zeros(n, dtype=np.int64),
        progress=np.zeros(n),
        aside=np.linspace(-0.1, 0.1, n),
    )


def told(poses: list[tuple[float, float, float]], speeds: list[float]) -> Seen:
    """Return what cars at these poses see, whose places are where their ways end."""
    n, ways = len(poses), straight(poses)
    seen = Seen(rows=np.full((n, N_CAR_NUMBERS), 7.0, dtype=np.float32), touches=np.ones(n, dtype=np.bool_))
    cars = CarsSeen(
        poses=np.array(poses),
        speeds=np.array(speeds) / 2.0,
        steering=np.linspace(0.0, 0.5, n),
        left_m=np.full(n, 5.0),
        places=ways.points[:, -1, :2].copy(),
        in_tow=np.arange(n) == 1,
        body=BODY,
        max_speed_mps=2.0,
        time_left=0.25,
    )
    observe(cars, ways, seen)
    return seen


def test_a_car_is_told_of_itself_and_its_way() -> None:
    row = told([(1.0, 2.0, math.pi / 2)], [1.0]).rows[0]
    np.testing.assert_allclose(row[:N_OWN], [0.5, 0.0, -0.1, 0.5, 0.25, 0.0, 0.0], atol=1e-6)
    ahead = row[N_OWN:FIRST_OTHER].reshape(-1, 2)
    np.testing.assert_allclose(3.0 * ahead[:, 0], [0.3, 0.6, 1.0, 1.5, 2.2, 3.0], atol=1e-5)
    np.testing.assert_allclose(ahead[:, 1], 0.0, atol=1e-5)
    assert not row[FIRST_OTHER:].any()


def test_cars_whose_ways_cross_are_told_where_and_how_soon() -> None:
    # The first drives east, the second north; both would be at (2, 0) in a second.
    rows = told([(0.0, 0.0, 0.0), (2.0, -2.0, math.pi / 2)], [1.9, 1.9]).rows
    other = rows[0, FIRST_OTHER : FIRST_OTHER + N_PER_OTHER]
    np.testing.assert_allclose(other[:5], [1.0, 0.5, -0.5, 0.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(other[5:8], [-1.9 / 4, 1.9 / 4, math.sqrt(2) * 1.9 / 4], atol=1e-6)
    assert 0.7 < other[8] < 0.8
    np.testing.assert_allclose(other[9:13], [0.5, -0.25, 0.2, 0.8], atol=1e-6)
    np.testing.assert_allclose(3.0 * other[13:15], [1.75, 1.75], atol=0.3)
    assert other[15] == 0.0
    back = rows[1, FIRST_OTHER : FIRST_OTHER + N_PER_OTHER]
    np.testing.assert_allclose(back[1:3], [0.5, 0.5], atol=1e-6)
    assert back[15] == 1.0
    assert (rows[0, 6], rows[1, 6]) == (0.0, 1.0)


def test_ways_that_part_do_not_meet() -> None:
    rows = told([(0.0, 0.0, 0.0), (0.0, 1.0, math.pi / 2)], [1.0, 1.0]).rows
    np.testing.assert_allclose(rows[0, FIRST_OTHER + 13 : FIRST_OTHER + 15], 1.0)
    assert rows[0, FIRST_OTHER + 7] < 0.0
    assert rows[0, FIRST_OTHER + 8] == 0.0


def test_a_car_behind_another_meets_it_where_it_stands() -> None:
    rows = told([(0.0, 0.0, 0.0), (1.5, 0.0, 0.0)], [1.0, 0.0]).rows
    own, other = 3.0 * rows[0, FIRST_OTHER + 13 : FIRST_OTHER + 15]
    assert (own, other) == pytest.approx((1.25, 0.0))
    assert rows[0, FIRST_OTHER + 8] == pytest.approx(1.0 - 1.0 / 3.0, abs=1e-6)


def test_the_nearest_are_told_in_turn_and_the_far_ones_are_not() -> None:
    poses = [(0.0, 0.0, 0.0), *((0.8 * k, 0.0, 0.0) for k in (2, 1, 4, 3, 5, 6))]
    others = told(poses, [0.0] * 7).rows[0, FIRST_OTHER:].reshape(N_OTHERS, N_PER_OTHER)
    np.testing.assert_allclose(4.0 * others[:, 1], [0.8, 1.6, 2.4, 3.2], atol=1e-5)
    assert not told([(0.0, 0.0, 0.0), (4.1, 0.0, 0.0)], [0.0, 0.0]).rows[0, FIRST_OTHER:].any()


@pytest.mark.parametrize(
    ("second", "touches"),
    [((0.505, 0.0, 0.0), True), ((0.515, 0.0, 0.0), False), ((0.0, 0.285, 0.0), True), ((0.0, 0.295, 0.0), False)],
)
def test_bodies_within_a_centimetre_touch(second: tuple[float, float, float], touches: bool) -> None:
    seen = told([(0.0, 0.0, 0.0), second], [0.0, 0.0])
    assert seen.touches.tolist() == [touches, touches]
    assert seen.rows[:, 5].tolist() == [float(touches)] * 2


def test_collisions_are_foretold_at_constant_velocities() -> None:
    assert time_to_collision(2.0, 0.0, -1.0, 0.0) == pytest.approx(1.5)
    assert time_to_collision(0.3, 0.3, 1.0, 1.0) == 0.0
    assert time_to_collision(2.0, 0.0, -1e-252, 0.0) == np.inf  # its square is 0
    assert time_to_collision(2.0, 0.0, 1.0, 0.0) == math.inf
    assert time_to_collision(2.0, 0.6, -1.0, 0.0) == math.inf
    assert time_to_collision(2.0, 0.0, 0.0, 0.0) == math.inf


def test_ways_meet_at_the_first_point_of_the_own_way() -> None:
    ahead = np.arange(4) * 1.0
    own = np.column_stack((ahead, np.zeros(4)))
    assert meeting(own, np.column_stack((np.full(4, 2.1), ahead - 2.0)), ahead, 0.4) == (2.0, 2.0)
    assert meeting(own, own + np.array([0.0, 1.0]), ahead, 0.4) == (math.inf, math.inf)


def test_the_recipe_s_layout_is_that_of_the_rows() -> None:
    (others,) = CAR_LAYOUT.groups
    assert (others.first, others.n_each, others.n_things) == (FIRST_OTHER, N_PER_OTHER, N_OTHERS)
