"""The benchmark of the layers measures what it says."""

from __future__ import annotations

import pytest

from benchmarks.harness import Trial
from benchmarks.training import layers
from fleet.envs import traffic_v1
from fleet.envs.policies import POLICIES
from maps.site import load_site


def test_the_table_has_every_policy_and_writes_its_files(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    monkeypatch.chdir(str(tmp_path))
    monkeypatch.delenv(layers.LEARNED, raising=False)
    monkeypatch.setattr(layers, "QUICK_TEAMS", (2, 3))
    monkeypatch.setattr(layers, "_choosy_floors", lambda: (load_site("small"),))
    trial = Trial(quick=True, seeds=(0,))
    rows = list(layers.measure_table(trial))
    n_played = len(layers.QUICK_TEAMS) * len(POLICIES["dispatch"])
    assert len(rows) == 2 * n_played
    assert all(row.value > 0 for row in rows[::2])
    assert "learned" in trial.notes[0]
    lines = (layers.OUT / "dispatch.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + n_played
    assert (layers.OUT / "dispatch_small.svg").read_text(encoding="utf-8").startswith("<svg")


def test_the_check_of_traffic_finds_no_fault() -> None:
    trial = Trial(quick=True, seeds=(0,))
    layers._check_traffic(trial, traffic_v1.parallel_env(site="small", n_cars=6, max_cycles=300))
    assert trial.failures == []
