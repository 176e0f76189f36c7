"""Hindrances: cars are held, slow, or hear of their commands late."""

from __future__ import annotations

import numpy as np

from fleet.traffic.hindrances import Hindrances


def test_what_hinders_nobody_changes_nothing() -> None:
    caps = np.array([1.0, 0.5])
    assert Hindrances(2).caps(caps) is caps


def test_a_car_is_held_until_all_have_let_it_go() -> None:
    hindrances, caps = Hindrances(2), np.ones(2)
    hindrances.hold(1)
    hindrances.hold(1)
    hindrances.let_go(1)
    assert (hindrances.caps(caps).tolist(), hindrances.held) == ([1.0, 0.0], [1])
    hindrances.let_go(1)
    assert (hindrances.caps(caps).tolist(), hindrances.held) == ([1.0, 1.0], [])


def test_a_slow_car_drives_at_a_fraction_of_what_it_may() -> None:
    hindrances = Hindrances(2)
    hindrances.slow(0, 0.25)
    assert hindrances.caps(np.array([0.8, 0.8])).tolist() == [0.2, 0.8]
    hindrances.slow(0, 1.0)
    assert not hindrances.any


def test_a_late_car_hears_what_it_was_told_some_ticks_ago() -> None:
    hindrances = Hindrances(2)
    hindrances.delay(0, 2, 0.05)
    told = [np.full((2, 2), float(tick)) for tick in range(5)]
    heard = [hindrances.late(commands)[:, 0].tolist() for commands in told]
    assert heard == [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [1.0, 3.0], [2.0, 4.0]]
    hindrances.delay(0, 0, 0.05)
    assert hindrances.late(np.full((2, 2), 9.0))[0, 0] == 9.0


def test_a_late_car_drives_a_few_centimetres_at_most_before_it_hears() -> None:
    hindrances = Hindrances(3)
    hindrances.delay(0, 4, 0.05)
    hindrances.slow(2, 0.1)
    assert hindrances.any
    assert hindrances.caps(np.full(3, 1.0)).tolist() == [0.25, 1.0, 0.1]
    hindrances.slow(0, 0.1)
    assert hindrances.caps(np.full(3, 1.0))[0] == 0.1
    hindrances.delay(0, 0, 0.05)
    hindrances.slow(0, 1.0)
    assert hindrances.caps(np.full(3, 1.0)).tolist() == [1.0, 1.0, 0.1]
