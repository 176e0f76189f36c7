"""Learned PIBT: what scores of moves are worth that were learned by imitating window search.

`python -m benchmarks.mapf.learned --seed 0 --out weights.npz` learns; `python -m benchmarks.mapf --only learned` learns
with every seed and plays episodes of POGEMA on maps that nobody learned on, all planners with the same costs of moves:
those of guidance, and then all alike.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.mapf.instances import find
from benchmarks.mapf.learned.floors import guide_on
from benchmarks.mapf.learned.imitation import ImitationConfig, learn
from benchmarks.mapf.learned.players import LearnedPlayer, MultiStepPlayer, PibtPlayer
from benchmarks.mapf.learned.scores import Scores
from benchmarks.mapf.pogema.episode import Episode, Floor, read_floors
from benchmarks.mapf.pogema.play import OnlinePlanner, Played, play
from benchmarks.mapf.pogema.scores import STAGES, Stage
from fleet.training.intervals import difference
from maps.lane_graph import grid_lane_graph
from planners.mapf.multi_step.goal_costs import GoalCosts
from planners.mapf.multi_step.guidance import UNIT
from planners.mapf.validate import conflicts

CELLS = (
    ("random", 32),
    ("random", 64),
    ("mazes", 32),
    ("mazes", 64),
    ("warehouse", 96),
    ("warehouse", 192),
)
"""Kind of map and number of agents."""
EPISODES, QUICK_EPISODES = 16, 1
SEEDS = (0, 1, 2, 3, 4)
"""Seeds of learning."""
QUICK = ImitationConfig(
    hidden=(16, 16), first_floors=1, rounds=1, floors=1, timesteps=20, first_epochs=1, epochs=1, last_epochs=1
)
RIVALS = ("pibt", "multi_step_pibt")


def measure_learned(trial: Trial) -> Iterable[Row]:
    """Learn once for each seed, then play every cell."""
    begin = time.process_time()
    learnt = [
        learn(seed, QUICK if trial.quick else None, tell=lambda line, _: trial.notes.append(line))
        for seed in (trial.seeds if trial.quick else SEEDS)
    ]
    learning_min = (time.process_time() - begin) / len(learnt) / 60
    yield Row(name="learning, one seed", value=learning_min, unit="min CPU", kind=Kind.TIME)
    for name, n in CELLS:
        stage = next(stage for stage in STAGES if stage.name == name)
        path = find(trial, f"pogema/{stage.folder}/maps.yaml", what=f"POGEMA, {name}")
        if path is not None:
            floors = list(read_floors(path).values())
            for guided in (True, False):
                yield from measure_cell(trial, stage, n, floors, learnt, guided=guided)


def measure_cell(
    trial: Trial, stage: Stage, n: int, floors: Sequence[Floor], learnt: Sequence[Scores], *, guided: bool
) -> Iterable[Row]:
    """Play some episodes on maps that are evenly spread, each planner with the same costs of moves.

    Args:
        trial: Told what the referee finds wrong.
        stage: Kind of map.
        n: Number of agents.
        floors: Its maps.
        learnt: Weights of each seed.
        guided: Whether moves cost what a fleet has learnt, once for each map; else all the same.
    """
    n_episodes = QUICK_EPISODES if trial.quick else EPISODES
    episodes = [
        play_episode(trial, stage, n, floors[seed * len(floors) // n_episodes], seed, learnt, guided=guided)
        for seed in range(n_episodes)
    ]
    title = f"{stage.name}, {n} agents, {'guided' if guided else 'not guided'}"
    throughput = {
        name: [float(np.mean([one.throughput for one in episode[name]])) for episode in episodes]
        for name in ("learned", *RIVALS)
    }
    for name, figures in throughput.items():
        step_ms = float(np.mean([one.step_ms for episode in episodes for one in episode[name]]))
        yield Row(name=f"{title}: {name}, goals per step", value=float(np.mean(figures)), unit="")
        yield Row(name="  step", value=step_ms, unit="ms CPU", kind=Kind.TIME)
    for name in RIVALS:
        gap, base = difference(throughput["learned"], throughput[name]), float(np.mean(throughput[name]))
        yield Row(name=f"{title}: learned, more than {name}, mean", value=100 * gap.mean / base, unit="%")
        yield Row(name="    lower end of 95 %", value=100 * gap.low / base, unit="%")
        yield Row(name="    upper end of 95 %", value=100 * gap.high / base, unit="%")


def play_episode(
    trial: Trial, stage: Stage, n: int, floor: Floor, seed: int, learnt: Sequence[Scores], *, guided: bool
) -> dict[str, list[Played]]:
    """Play an episode with every planner, the learned one with all weights.

    Args:
        trial: Told what the referee finds wrong.
        stage: Kind of map.
        n: Number of agents.
        floor: The map.
        seed: Seed of the episode, of guidance and of tie-breaking.
        learnt: Weights of each seed.
        guided: Whether moves cost what a fleet has learnt; else all the same.
    """
    graph = grid_lane_graph(floor.grid, "pebble")
    rng = np.random.default_rng(seed)
    move_cost = guide_on(floor, graph, n, rng) if guided else np.full(graph.n_moves, UNIT, dtype=np.int32)
    costs = GoalCosts(graph, graph, move_cost=move_cost)
    players: dict[str, list[OnlinePlanner]] = {
        "learned": [LearnedPlayer(graph, n, costs, scores, seed=seed) for scores in learnt],
        "pibt": [PibtPlayer(graph, n, costs, seed=seed)],
        "multi_step_pibt": [MultiStepPlayer(graph, n, costs, seed=seed)],
    }
    played: dict[str, list[Played]] = {}
    for name, some in players.items():
        played[name] = [play(Episode(floor, n, seed=seed), graph, player, steps=stage.steps) for player in some]
        for one in played[name]:
            wrong = conflicts(graph, one.plan, allow_rotation=True)
            trial.check(not wrong, f"{name}, {floor.name}, {n} agents, seed {seed}: {len(wrong)} conflicts")
    return played
