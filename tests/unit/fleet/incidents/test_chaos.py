"""Chaos: the same seed draws the same faults, of every kind, so many an hour."""

from __future__ import annotations

import math

import numpy as np

from fleet.config import EVENT_KINDS
from fleet.incidents.chaos import draw_chaos
from maps.site import load_site

SITE = load_site("small")


def draw(seed: int, per_h: float = 600.0, until_s: float = 36000.0) -> tuple:
    return draw_chaos(SITE, 5, per_h, until_s, np.random.default_rng(seed))


def test_one_seed_draws_one_chaos() -> None:
    assert draw(1) == draw(1)
    assert draw(1) != draw(2)


def test_no_rate_draws_nothing() -> None:
    assert draw(1, per_h=0.0) == ()


def test_there_are_as_many_as_was_asked_for() -> None:
    first = [event for event in draw(3) if not EVENT_KINDS[event.kind].ends and event.kind != "car_towed"]
    assert abs(len(first) - 6000) < 4 * math.sqrt(6000)


def test_every_kind_is_drawn_and_in_the_order_of_times() -> None:
    events = draw(4)
    assert {event.kind for event in events} >= {kind for kind, known in EVENT_KINDS.items() if not known.ends}
    times = [event.time_s for event in events]
    assert times == sorted(times)


def test_most_of_what_lasts_for_good_is_mended() -> None:
    events = draw(5)
    dead = sum(event.kind == "car_dead" for event in events)
    repaired = sum(event.kind == "car_repaired" for event in events)
    assert 0.8 * dead < repaired < dead
