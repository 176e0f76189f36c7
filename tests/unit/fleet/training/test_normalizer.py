"""Normalizer: the mean and variance of all rows, however they come."""

import numpy as np

from fleet.training.normalizer import CLIP, Normalizer


def test_parts_give_what_the_whole_gives() -> None:
    rows = np.random.default_rng(0).normal(3.0, 2.0, (1000, 4))
    parts = Normalizer(4)
    for part in np.split(rows, [1, 10, 400]):
        parts.update(part)
    assert np.allclose(parts.mean, rows.mean(axis=0))
    assert np.allclose(parts.variance, rows.var(axis=0))
    normal = parts.apply(rows.astype(np.float32))
    assert np.allclose(normal.mean(axis=0), 0.0, atol=1e-5)
    assert np.allclose(normal.std(axis=0), 1.0, atol=1e-4)


def test_before_the_first_row_numbers_stay_and_far_ones_are_cut() -> None:
    rows = np.array([[0.5, 1e6]], dtype=np.float32)
    assert Normalizer(2).apply(rows).tolist() == [[0.5, CLIP]]


def test_what_is_remembered_comes_back_exactly() -> None:
    one, other = Normalizer(3), Normalizer(3)
    one.update(np.random.default_rng(1).normal(size=(7, 3)))
    other.recall(one.state())
    rows = np.ones((1, 3), dtype=np.float32)
    assert (one.apply(rows) == other.apply(rows)).all()
    assert one.count == other.count


def test_numbers_that_are_fixed_stay_as_they_are() -> None:
    normal = Normalizer(3, fixed=[1])
    rows = np.random.default_rng(0).normal(3.0, 2.0, (100, 3)).astype(np.float32)
    normal.update(rows)
    normal.update(rows)
    assert np.allclose(normal.apply(rows)[:, 1], rows[:, 1], atol=1e-6)
    assert np.allclose(normal.apply(rows)[:, 0].mean(), 0.0, atol=1e-5)


def test_what_was_always_the_same_says_nothing_later() -> None:
    rows = np.random.default_rng(0).normal(size=(1000, 3)).astype(np.float32)
    rows[:, 1] = 0.1
    normal = Normalizer(3)
    for part in np.split(rows, [1, 30, 500]):
        normal.update(part)
    rows[:, 1] = 1.0
    told = normal.apply(rows)
    assert (told[:, 1] == 0.0).all()
    assert (told[:, [0, 2]] != 0.0).all()


def test_unseen_numbers_are_nothing_whatever_they_are() -> None:
    normal, seen = Normalizer(3, unseen=[1]), Normalizer(3)
    rows = np.random.default_rng(0).normal(3.0, 2.0, (100, 3)).astype(np.float32)
    for one in (normal, seen):
        one.update(rows)
    assert (normal.apply(rows)[:, 1] == 0.0).all()
    assert (normal.apply(rows)[:, [0, 2]] == seen.apply(rows)[:, [0, 2]]).all()
    assert normal.state() == seen.state()
