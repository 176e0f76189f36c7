"""The fleet of three kinds: its thirty orders ask for each of them, and rows tell the worst of the shifts."""

from __future__ import annotations

from collections import Counter

import pytest

from benchmarks.harness import Trial
from benchmarks.robots import walking
from benchmarks.robots.walking import MODELS, Shift, measure_shifts, shift
from fleet.config import Fidelity


def test_every_order_is_done_without_physics_and_by_all_kinds() -> None:
    played = shift(1, Fidelity.KINEMATIC)
    assert (played.n_done, played.n_contacts) == (30, 0)
    assert min(played.done_by[model] for model in MODELS) >= 3


def test_rows_tell_the_worst_of_the_shifts(monkeypatch: pytest.MonkeyPatch) -> None:
    shifts = {
        0: Shift(n_done=30, done_by=Counter(racecar=20, husky=7, a1=3), n_contacts=0, time_s=300.0),
        1: Shift(n_done=29, done_by=Counter(racecar=27, husky=2), n_contacts=1, time_s=300.0),
    }
    monkeypatch.setattr(walking, "shift", lambda seed: shifts[seed])
    assert [row.value for row in measure_shifts(Trial(quick=False, seeds=(0, 1)))] == [29, 1, 0]
    assert [row.met for row in measure_shifts(Trial(quick=False, seeds=(0,)))] == [True, True, True]
