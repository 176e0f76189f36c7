"""Learned PIBT's training: floors hold together, the network learns, a run repeats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.mapf.drawn import largest_part
from benchmarks.mapf.learned import QUICK
from benchmarks.mapf.learned.floors import draw_lesson
from benchmarks.mapf.learned.imitation import drive, learn
from benchmarks.mapf.learned.network import Network, Samples
from planners.mapf.learned.observation import N_MOVES, N_SEEN, ONE, WAIT


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_floors_hold_together_and_have_room(seed: int) -> None:
    lesson = draw_lesson(seed)
    n_free = lesson.graph.n_states
    free = np.zeros(lesson.graph.n_cells, dtype=np.bool_)
    free[lesson.graph.state_cell] = True
    cols = int(np.abs(np.diff(lesson.graph.state_cell[[lesson.graph.move_from, lesson.graph.move_to]], axis=0)).max())
    assert largest_part(free.reshape(-1, cols)).sum() == n_free
    assert 8 <= lesson.episode.n <= n_free // 2


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
