"""Lines of edges and Dubins curves between them."""

import math

import numpy as np
import pytest
from ompl import base as ob

from maps.free_lanes.dubins import dubins_line
from maps.free_lanes.line import line_of_curve


def test_a_quarter_circle_has_its_radius_and_length() -> None:
    line = line_of_curve([((0.0, 0.0), (2.0, 0.0), (2.0, 2.0))])
    assert line.length_m == pytest.approx(math.pi, abs=1e-3)
    assert line.radius_m == pytest.approx(2.0, rel=0.01)
    np.testing.assert_allclose(np.hypot(line.points[:, 0], line.points[:, 1] - 2.0), 2.0, atol=1e-9)
    assert line.beside(0.5).length_m == pytest.approx(2.5 * math.pi / 2, abs=1e-2)


def test_a_cubic_leaves_and_comes_along_its_handles() -> None:
    line = line_of_curve([((0.0, 0.0), (1.0, 0.0), (2.0, 1.0), (2.0, 2.0))])
    assert line.pose(0.0) == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    assert line.pose(line.length_m) == pytest.approx((2.0, 2.0, math.pi / 2), abs=0.02)


def test_a_corner_is_tighter_than_any_car_turns() -> None:
    assert line_of_curve([((0.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (1.0, 1.0))]).radius_m < 0.15


def test_dubins_curves_are_as_long_as_those_of_ompl_and_end_where_they_should() -> None:
    rng, space = np.random.default_rng(0), ob.DubinsStateSpace(0.4)
    states = space.allocState(), space.allocState()
    for _ in range(300):
        ends = rng.uniform(-1.2, 1.2, (2, 3)) * (1.0, 1.0, math.pi)
        for state, (x, y, yaw) in zip(states, ends.tolist(), strict=True):
            state.setX(x), state.setY(y), state.setYaw(yaw)
        line = dubins_line(*(tuple(end) for end in ends.tolist()), 0.4)
        assert line.length_m == pytest.approx(space.distance(*states), abs=1e-9)
        off = line.points[-1] - ends[1]
        assert math.hypot(off[0], off[1]) < 1e-9
        assert math.remainder(off[2], math.tau) == pytest.approx(0.0, abs=1e-9)
