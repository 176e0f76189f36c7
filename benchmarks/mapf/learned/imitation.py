"""Imitation: a student drives, a teacher says what it should have done, and it learns from all that was said.

Source: Ross, Gordon, Bagnell, "A reduction of imitation learning and structured prediction to no-regret online
learning", AISTATS 2011, https://arxiv.org/abs/1011.0686 (DAgger).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

import numpy as np

from benchmarks.mapf.learned.floors import Lesson, draw_lesson
from benchmarks.mapf.learned.learned_stepper import Moment
from benchmarks.mapf.learned.network import Network, Samples
from benchmarks.mapf.learned.observation import N_MOVES, WAIT
from benchmarks.mapf.learned.players import LearnedPlayer
from benchmarks.mapf.learned.scores import Scores
from benchmarks.mapf.learned.teacher import Teacher
from benchmarks.mapf.pogema.online import WindowPlanner
from benchmarks.mapf.pogema.play import OnlinePlanner, play
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
    notes = _NoteTaker(lesson, scores, config, taught=taught, seed=floor_seed)
    play(lesson.episode, lesson.graph, notes, steps=config.timesteps)
    return Samples.joined(notes.parts)


class _NoteTaker:
    """A planner, student or teacher, beside whom somebody notes what the teacher does or would do."""

    def __init__(self, lesson: Lesson, scores: Scores, config: ImitationConfig, *, taught: bool, seed: int) -> None:
        graph, n = lesson.graph, lesson.episode.n
        self.parts: list[Samples] = []
        self._student = LearnedPlayer(graph, n, lesson.costs, scores, seed=seed)
        self._teacher: OnlinePlanner = (
            WindowPlanner(graph, lesson.move_cost, n, costs=lesson.costs, seed=seed)
            if taught
            else Teacher(lesson, seed=seed)
        )
        self._every, self._taught = config.every, taught
        self._timesteps = count()

    def step(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        """Decide a timestep; see `OnlinePlanner`."""
        student, timestep = self._student, next(self._timesteps)
        moment = student.moment(states, goals)
        if self._taught:
            after = self._teacher.step(states, goals, next_goals)
            self._note(states, after, moment)
            return after
        after = np.empty_like(states)
        student.stepper.step(states, after, moment)
        if timestep >= _WARM_UP and timestep % self._every == 0:
            self._note(states, self._teacher.step(states, goals, next_goals), moment)
        return after

    def _note(self, states: IntArray, told: IntArray, moment: Moment) -> None:
        seen = self._student.stepper.observe_along(states, told, moment).copy()
        self.parts.append(_samples(self._student, seen, states, told))


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
