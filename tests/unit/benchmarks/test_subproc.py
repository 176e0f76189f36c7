"""The benchmark of processes says why it has no rows."""

from __future__ import annotations

import importlib.util

import pytest

from benchmarks.harness import Trial
from benchmarks.training.subproc import measure_subproc


def test_without_the_library_it_is_left_out_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    trial = Trial(quick=True, seeds=(0,))
    assert list(measure_subproc(trial)) == []
    assert trial.notes == ["subproc: left out, Stable-Baselines3 is not installed: pip install '.[sb3]'"]
