"""The lifelong run counts what happened, says what it cost and lets the referee look at all of it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from benchmarks.harness import Trial
from benchmarks.mapf import instances
from benchmarks.mapf.lifelong import run_lifelong
from maps.grid import GridMap
from planners.mapf.pibt import Stepper

GRID = GridMap(np.ones((6, 6), dtype=np.bool_))


@pytest.mark.parametrize("motion", ["pebble", "rotating"])
def test_a_run_is_legal_and_the_same_seed_repeats_it(motion: Literal["pebble", "rotating"]) -> None:
    trial = Trial(quick=True, seeds=(0,))
    first, again, other = (run_lifelong(trial, GRID, 12, steps=60, motion=motion, seed=seed) for seed in (3, 3, 4))
    assert trial.failures == []
    assert first.finished.sum() > 0
    assert first.quarters.sum() == first.finished.sum()
    assert first.finished.tolist() == again.finished.tolist()
    assert first.finished.tolist() != other.finished.tolist()
    assert min(first.step_s, first.order_s, first.tables_s) >= 0


def test_a_run_that_breaks_the_rules_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def pile_up(_self: Stepper, _now: np.ndarray, after: np.ndarray, **_: object) -> None:
        after[:] = 0

    monkeypatch.setattr(Stepper, "step", pile_up)
    trial = Trial(quick=True, seeds=(0,))
    run_lifelong(trial, GRID, 3, steps=2)
    assert len(trial.failures) == 1


def test_a_missing_map_is_noted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(instances, "INSTANCES", tmp_path)
    trial = Trial(quick=True, seeds=(0,))
    assert instances.find_map(trial, "nowhere", what="speed") is None
    assert trial.notes == [f"speed: left out, no file lorr2024/maps/nowhere.map in FLEET_INSTANCES={tmp_path}"]
