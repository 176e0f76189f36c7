"""Imitation: a student drives, a teacher says what it should have done, and it learns from all that was said.

Source: Ross, Gordon, Bagnell, "A reduction of imitation learning and structured prediction to no-regret online
learning", AISTATS 2011, https://arxiv.org/abs/1011.0686 (DAgger).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.mapf.learned.floors import draw_lesson
from benchmarks.mapf.learned.network import Network, Samples
from benchmarks.mapf.learned.observation import N_MOVES, WAIT
from benchmarks.mapf.learned.players import LearnedPlayer
from benchmarks.mapf.learned.scores import Scores
from benchmarks.mapf.learned.teacher import Teacher
from benchmarks.mapf.pogema.online import WindowPlanner
from planners.mapf.arrays import IntArray

_SEEDS_PER_RUN = 100_000
"""Seeds of floors that one run may draw; those of different runs are different."""
_FIRST_SEED = 5_000
"""Floors of smaller seeds are left for trials."""
_WARM_UP = 5


@dataclass(frozen=True, kw_only=True)
class ImitationConfig:
    """Settings of `learn`."""

    hidden: tuple[int, int] = (96, 64)
    """Units of the two hidden layers."""
    first_floors: int = 48
    """Floors on which the teacher drives."""
    rounds: int = 8
    """Times the student drives and learns."""
    floors: int = 32
    """Floors on which it drives in each."""
    timesteps: int = 150
    """Timesteps on each floor."""
    every: int = 3
    """Timesteps from one that the teacher is asked about to the next."""
    first_epochs: int = 8
    epochs: int = 3
    last_epochs: int = 8


def learn(
    seed: int, config: ImitationConfig | None = None, *, tell: Callable[[str, Scores], None] | None = None
) -> Scores:
    """Learn scores of moves from window search, first along its own way, then along that of the student.

    Args:
        seed: Seed of floors, weights and batches.
        config: Settings.
        tell: Told how it goes, in a line, and given what has been learned so far, after each round.
    """
    config = ImitationConfig() if config is None else config
    tell = _say_nothing if tell is None else tell
    network = Network(config.hidden, np.random.default_rng([seed, 0]))
    floor_seed = _FIRST_SEED + _SEEDS_PER_RUN * seed
    parts = []
    for _ in range(config.first_floors):
        parts.append(drive(floor_seed, network.scores(), config, taught=True))
        floor_seed += 1
    loss = network.train(Samples.joined(parts), epochs=config.first_epochs, rate=3e-3, last_rate=3e-4)
    tell(f"teacher drives: {sum(map(len, parts))} samples, loss {loss:.3f}", network.scores())
    for done in range(config.rounds):
        new = []
        for _ in range(config.floors):
            new.append(drive(floor_seed, network.scores(), config, taught=False))
            floor_seed += 1
        agreement = network.agreement(Samples.joined(new))
        parts += new
        last = done == config.rounds - 1
        epochs, rate, last_rate = (config.last_epochs, 1e-3, 2e-5) if last else (config.epochs, 2e-3, 2e-4)
        loss = network.train(Samples.joined(parts), epochs=epochs, rate=rate, last_rate=last_rate)
        line = f"round {done + 1}: {sum(map(len, parts))} samples, agreement {100 * agreement:.1f} %, loss {loss:.3f}"
        tell(line, network.scores())
    return network.scores()


def _say_nothing(line: str, scores: Scores) -> None:
    del line, scores


def drive(floor_seed: int, scores: Scores, config: ImitationConfig, *, taught: bool) -> Samples:
    """Let a fleet drive on a floor, and note what the teacher does.

    Args:
        floor_seed: Seed of the floor.
        scores: Those of the student.
        config: Settings.
        taught: The teacher drives, keeping its plan; else the student does, and a teacher that begins anew looks on.
    """
    lesson = draw_lesson(floor_seed)
    graph, episode = lesson.graph, lesson.episode
    student = LearnedPlayer(graph, episode.n, lesson.costs, scores, seed=floor_seed)
    teacher = (
        WindowPlanner(graph, lesson.move_cost, episode.n, costs=lesson.costs, seed=floor_seed)
        if taught
        else Teacher(lesson, seed=floor_seed)
    )
    streams = [episode.goals(agent) for agent in range(episode.n)]
    goals, next_goals = (np.array([next(stream) for stream in streams], dtype=np.int32) for _ in range(2))
    now = graph.state_index[episode.starts, 0]
    parts = []
    for t in range(config.timesteps):
        moment = student.moment(now, goals)
        after = np.empty_like(now)
        if taught:
            told = after = teacher.step(now, goals, next_goals)
        else:
            student.stepper.step(now, after, moment)
            told = after
        if taught or (t >= _WARM_UP and t % config.every == 0):
            if not taught:
                told = teacher.step(now, goals, next_goals)
            seen = student.stepper.observe_along(now, told, moment).copy()
            parts.append(_samples(student, seen, now, told))
        there = np.flatnonzero(graph.state_cell[after] == goals)
        goals[there] = next_goals[there]
        next_goals[there] = [next(streams[agent]) for agent in there.tolist()]
        now = after
    return Samples.joined(parts)


def _samples(student: LearnedPlayer, seen: np.typing.NDArray[np.int8], now: IntArray, told: IntArray) -> Samples:
    """A timestep, every agent in its own frame."""
    beside, frame = student.stepper.around.beside[now], student.stepper.desk.outlook.frame
    turn = np.where(frame & 1, 1, -1)
    agents = np.arange(len(now))
    move = np.full(len(now), WAIT, dtype=np.int8)
    is_open = np.ones((len(now), N_MOVES), dtype=np.bool_)
    for k in range(WAIT):
        state = beside[agents, ((frame >> 1) + turn * k) & 3]
        is_open[:, k] = state >= 0
        move[(state >= 0) & (state == told)] = k
    return Samples(seen=seen, move=move, is_open=is_open)
