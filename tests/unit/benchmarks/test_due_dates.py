"""The benchmark of due dates counts what is late, and plays nothing twice."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.harness import Trial
from benchmarks.training import due_dates
from fleet.envs import dispatch_v1
from fleet.envs.dispatch.scenarios import SCENARIOS
from fleet.envs.policies import make_policy


def test_tardiness_counts_what_was_never_delivered() -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=1, load=9.0, max_cycles=120, stream={"slack_s": [0.0, 0.0]})
    delivered, tardiness_min, on_time, _ = due_dates.played(env, make_policy("dispatch", "nearest"), 0)
    assert 0 < delivered < 20
    assert on_time == 0.0
    assert tardiness_min > 2 * env.late_s / 60.0 > 0.0
    env.close()


def test_episodes_that_are_there_are_not_played_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs/learning").mkdir(parents=True)
    monkeypatch.setattr(due_dates, "N_SEEDS", 2)
    monkeypatch.setattr(due_dates, "_cases", lambda: {"due_rush": SCENARIOS["due_rush"].arguments})
    monkeypatch.setattr(due_dates, "POLICIES", {"dispatch": {"nearest": None}})
    first = list(due_dates.measure_due_dates(Trial(quick=False, seeds=(0,))))
    monkeypatch.setattr(due_dates, "played", lambda *_: pytest.fail("played again"))
    assert list(due_dates.measure_due_dates(Trial(quick=False, seeds=(0,)))) == first
    assert len(due_dates.EPISODES.read_text(encoding="utf-8").splitlines()) == 3
    head, *lines = due_dates.TABLE.read_text(encoding="utf-8").splitlines()
    assert head.startswith("scenario,policy,episodes,delivered,delivered_half_width,tardiness_min")
    assert len(lines) == 1
