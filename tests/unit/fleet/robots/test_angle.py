"""Angles and quaternions against scipy."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from fleet.robots.angle import rotation, wrapped, wrapped_all, yaw_of


def test_one_angle_is_wrapped_as_many_are():
    angles = np.random.default_rng(0).uniform(-20.0, 20.0, 200)
    turned = wrapped_all(angles)
    np.testing.assert_array_equal(turned, [wrapped(angle) for angle in angles])
    assert ((turned >= -math.pi) & (turned < math.pi)).all()
    np.testing.assert_allclose(np.exp(1j * turned), np.exp(1j * angles), atol=1e-12)


def test_yaw_is_the_direction_of_the_x_axis_however_a_body_leans():
    turn = Rotation.from_euler("ZYX", (0.7, 0.4, -1.1))
    assert math.isclose(yaw_of(np.array([1.0, 2.0, 3.0, *turn.as_quat()])), 0.7)


def test_quaternions_of_any_shape_become_matrices():
    turns = Rotation.random(6, random_state=0)
    quats = turns.as_quat().reshape(2, 3, 4)
    matrices = rotation(quats)
    np.testing.assert_allclose(matrices, turns.as_matrix().reshape(2, 3, 3, 3), atol=1e-12)
    np.testing.assert_array_equal(rotation(quats[1, 2]), matrices[1, 2])
