"""The cells of POGEMA's lifelong scoreboard, and what published methods reach in them, episode by episode."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A kind of map: where it lies, how long an episode is, and which numbers of agents are played.

    Source: the YAML files in ``raw_data_LMAPF`` of https://github.com/CognitiveAISystems/pogema-benchmark.
    """

    name: str
    folder: str
    steps: int
    sizes: tuple[int, ...]
    """Numbers of agents, of those published the ones from 32 on."""
    learning_rounds: int
    """Rounds in which guidance is learnt."""


STAGES = (
    Stage(name="random", folder="01-random", steps=256, sizes=(32, 48, 64), learning_rounds=8),
    Stage(name="mazes", folder="02-mazes", steps=128, sizes=(32, 48, 64), learning_rounds=8),
    Stage(name="warehouse", folder="03-warehouse", steps=256, sizes=(32, 64, 96, 128, 160, 192), learning_rounds=8),
    Stage(name="tiles", folder="04-movingai", steps=256, sizes=(64, 128, 192, 256), learning_rounds=3),
)


Scores = dict[tuple[str, int], float]
"""Goals reached per timestep, by map and seed; the name is empty where there is but one map."""


def read_scores(path: Path, n: int) -> Scores:
    """Published figures of a method.

    Args:
        path: A JSON file of the benchmark's results.
        n: Number of agents.
    """
    scores: Scores = {}
    for result in json.loads(path.read_text(encoding="utf-8")):
        settings = result["env_grid_search"]
        if settings["num_agents"] == n:
            scores[settings.get("map_name", ""), settings.get("seed", 0)] = result["metrics"]["avg_throughput"]
    return scores
