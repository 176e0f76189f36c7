"""POGEMA's lifelong scoreboard: goals reached per timestep, against published figures of the same episodes.

Every cell of the scoreboard with at least 32 agents is played. What RHCR and Follower reached is the benchmark's own
raw data (branch ICLR of https://github.com/CognitiveAISystems/pogema-benchmark): RHCR plans windows of 10 timesteps and
replans after 5 and knows all future goals; Follower is a learned policy that sees 11 x 11 cells; ours knows the map
beforehand, all goals, and the one after each.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.mapf.instances import find
from benchmarks.mapf.pogema.episode import Episode, Floor, read_floors
from benchmarks.mapf.pogema.online import WindowPlanner, learnt_costs
from benchmarks.mapf.pogema.play import play
from benchmarks.mapf.pogema.scores import STAGES, Scores, Stage, read_scores
from fleet.training.intervals import Interval, difference
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step.goal_costs import GoalCosts
from planners.mapf.validate import conflicts

QUICK_EPISODES = 2
LEADER, LEARNED = "RHCR", "Follower"
STEP_MS = 2.0


@dataclass(frozen=True, kw_only=True)
class Cell:
    """What was measured with one number of agents on one kind of map, episode by episode."""

    throughput: Sequence[float]
    step_ms: Sequence[float]
    learning_s: Sequence[float]
    """CPU time of learning, once per map [s]."""


def measure_pogema(trial: Trial) -> Iterable[Row]:
    """All cells, 128 episodes each; two of each with --quick."""
    for stage in STAGES:
        files = _files(trial, stage)
        if files is None:
            continue
        maps, leader, learned = files
        floors = read_floors(maps)
        for n in stage.sizes:
            theirs = read_scores(leader, n)
            episodes = list(theirs)[:: len(theirs) // QUICK_EPISODES] if trial.quick else list(theirs)
            cell = measure_cell(trial, stage, n, floors, episodes)
            yield from _rows(trial, f"{stage.name}, {n} agents", cell, episodes, theirs, read_scores(learned, n))


def _files(trial: Trial, stage: Stage) -> tuple[Path, Path, Path] | None:
    """Maps of a stage, and the figures of the two others; None, and one note, where they are not all there."""
    found = []
    for name in ("maps.yaml", f"{LEADER}.json", f"{LEARNED}.json"):
        path = find(trial, f"pogema/{stage.folder}/{name}", what=f"POGEMA, {stage.name}")
        if path is None:
            return None
        found.append(path)
    return found[0], found[1], found[2]


def measure_cell(
    trial: Trial, stage: Stage, n: int, floors: dict[str, Floor], episodes: Sequence[tuple[str, int]]
) -> Cell:
    """Play some episodes.

    Args:
        trial: Told what the referee finds wrong.
        stage: Kind of map.
        n: Number of agents.
        floors: Its maps by name.
        episodes: Map and seed of each; a name that is empty stands for the only map.
    """
    step_ms, throughput, learning_s = [], [], []
    known: dict[str, tuple[LaneGraph, IntArray, GoalCosts]] = {}
    for name, seed in episodes:
        floor = floors[name] if name else next(iter(floors.values()))
        if floor.name not in known:
            graph = grid_lane_graph(floor.grid, "pebble")
            begin = time.process_time()
            move_cost = learnt_costs(floor, graph, n, rounds=stage.learning_rounds, seed=trial.seeds[0])
            learning_s.append(time.process_time() - begin)
            known = {floor.name: (graph, move_cost, GoalCosts(graph, graph, move_cost=move_cost))}
        graph, move_cost, costs = known[floor.name]
        planner = WindowPlanner(graph, move_cost, n, costs=costs, seed=trial.seeds[0])
        played = play(Episode(floor, n, seed=seed), graph, planner, steps=stage.steps)
        wrong = conflicts(graph, played.plan, allow_rotation=True)
        trial.check(not wrong, f"{floor.name}, {n} agents, seed {seed}: {len(wrong)} conflicts, first {wrong[:1]}")
        throughput.append(played.throughput)
        step_ms.append(played.step_ms)
    return Cell(throughput=throughput, step_ms=step_ms, learning_s=learning_s)


def _rows(
    trial: Trial, title: str, cell: Cell, episodes: Sequence[tuple[str, int]], leader: Scores, learned: Scores
) -> Iterable[Row]:
    """The figures of a cell; differences in percent of what the other reaches in the same episodes."""

    def targeted(target: str) -> str:
        return "" if trial.quick else target

    yield Row(name=f"{title}: goals per step, {len(episodes)} episodes", value=float(np.mean(cell.throughput)), unit="")
    for name, scores, mean_target, low_target in ((LEADER, leader, ">= 0", ">= -1"), (LEARNED, learned, "", ">= 0")):
        gain = _gain(cell.throughput, [scores[episode] for episode in episodes])
        yield Row(name=f"  more than {name}, mean", value=gain.mean, unit="%", target=targeted(mean_target))
        yield Row(name="    lower end of 95 %", value=gain.low, unit="%", target=targeted(low_target))
    step_ms = float(np.mean(cell.step_ms))
    yield Row(name="  step", value=step_ms, unit="ms CPU", kind=Kind.TIME, target=targeted(f"<= {STEP_MS:g}"))
    learning_s = float(np.mean(cell.learning_s))
    yield Row(name="  learning the map beforehand", value=learning_s, unit="s CPU", kind=Kind.TIME)


def _gain(ours: Sequence[float], theirs: Sequence[float]) -> Interval:
    """Paired difference as a share of their mean [%]."""
    gap, mean = difference(ours, theirs), float(np.mean(theirs))
    return Interval(mean=100 * gap.mean / mean, low=100 * gap.low / mean, high=100 * gap.high / mean)
