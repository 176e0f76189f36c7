"""Learned PIBT's training: floors hold together, the network learns, a run repeats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness import Trial
from benchmarks.mapf import instances
from benchmarks.mapf.learned import CELLS, QUICK, measure_cell, measure_learned
from benchmarks.mapf.learned.floors import draw_lesson
from benchmarks.mapf.learned.imitation import drive, learn
from benchmarks.mapf.learned.network import Network, Samples
from benchmarks.mapf.learned.observation import N_MOVES, N_SEEN, ONE, WAIT
from benchmarks.mapf.pogema.episode import Floor
from benchmarks.mapf.pogema.scores import Stage
from planners.mapf.distance_table import UNREACHABLE, DistanceTable


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_floors_hold_together_and_have_room(seed: int) -> None:
    lesson = draw_lesson(seed)
    graph = lesson.graph
    assert (DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_)).to(0) < UNREACHABLE).all()
    assert 8 <= lesson.episode.n <= graph.n_states // 2


def test_the_network_learns_what_can_be_seen() -> None:
    rng = np.random.default_rng(0)
    seen = np.zeros((4096, N_SEEN), dtype=np.int8)
    move = rng.integers(N_MOVES, size=4096).astype(np.int8)
    seen[np.arange(4096), move] = ONE
    samples = Samples(seen=seen, move=move, is_open=np.ones((4096, N_MOVES), dtype=np.bool_))
    network = Network((16, 16), rng)
    assert network.agreement(samples) < 0.6
    network.train(samples, epochs=40, rate=1e-2, last_rate=1e-3)
    assert network.agreement(samples) > 0.99


def test_the_network_never_proposes_a_wall() -> None:
    rng = np.random.default_rng(0)
    is_open = np.zeros((8, N_MOVES), dtype=np.bool_)
    is_open[:, WAIT] = True
    wait = np.full(8, WAIT, dtype=np.int8)
    samples = Samples(seen=rng.integers(-9, 9, (8, N_SEEN)).astype(np.int8), move=wait, is_open=is_open)
    assert Network((16, 16), rng).agreement(samples) == 1.0


@pytest.mark.parametrize("taught", [True, False])
def test_samples_hold_open_moves_only(taught: bool) -> None:
    scores = Network((8, 8), np.random.default_rng(0)).scores()
    samples = drive(3, scores, replace(QUICK, timesteps=12), taught=taught)
    assert len(samples) > 0
    assert samples.is_open[np.arange(len(samples)), samples.move].all()


def test_a_run_repeats() -> None:
    first, second = (learn(1, replace(QUICK, timesteps=8)) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize("guided", [True, False])
def test_all_planners_play_a_cell_legally(guided: bool) -> None:
    trial = Trial(quick=True, seeds=(0,))
    stage = Stage(name="square", folder="", steps=30, sizes=(8,), learning_rounds=1)
    scores = Network((8, 8), np.random.default_rng(0)).scores()
    rows = list(measure_cell(trial, stage, 8, [Floor("square", ("." * 8,) * 8)], [scores], guided=guided))
    assert trial.failures == []
    assert all(row.value > 0 for row in rows if "goals per step" in row.name)


def test_without_the_files_cells_are_left_out_with_a_reason(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(instances, "INSTANCES", tmp_path)
    trial = Trial(quick=True, seeds=(0,))
    assert [row.name for row in measure_learned(trial)] == ["learning, one seed"]
    assert sum("left out" in note for note in trial.notes) == len(CELLS)
