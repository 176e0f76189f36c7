"""Shortcuts: shorter, free, same ends, repeatable."""

from __future__ import annotations

import numpy as np

from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes
from planners.motion.search.shortcut import shorten


def _length(path):  # type: ignore[no-untyped-def]
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def test_detour_in_free_space_becomes_a_line(iiwa):  # type: ignore[no-untyped-def]
    path = np.zeros((4, 7))
    path[:, 3] = -1.0
    path[1, 0], path[2, 1], path[3, 0] = 0.5, 0.4, 0.8
    short = shorten(path, CollisionChecker(iiwa, Boxes()), rounds=1, seed=0)
    np.testing.assert_array_equal(short, path[[0, -1]])


def test_path_around_a_wall_stays_free(iiwa):  # type: ignore[no-untyped-def]
    checker = CollisionChecker(iiwa, Boxes.one((0.6, 0.0, 0.3), (0.3, 0.01, 0.35)))
    low = np.array([-0.8, 0.7, 0, -1.4, 0, 1.0, 0])
    path = np.stack([low, low, low, low])
    path[1:3, 1] = -0.9  # leaning back, over the wall
    path[2:, 0] = 0.8
    assert checker.path_free(path)
    assert not checker.edge(path[0], path[-1])
    short = shorten(path, checker, rounds=20, seed=1)
    assert checker.path_free(short)
    assert _length(short) < 0.95 * _length(path)
    np.testing.assert_array_equal(short[[0, -1]], path[[0, -1]])
    assert short.tobytes() == shorten(path, checker, rounds=20, seed=1).tobytes()
    np.testing.assert_array_equal(shorten(path, checker, rounds=0, seed=1), path)
