"""Tiny problems of the League, drawn by hand."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from maps.formats.lorr import LeagueProblem
from maps.formats.lorr_2026 import Delays, Ticks
from maps.grid import GridMap

CORRIDOR = [".....", "@@@@.", "....."]
"""Cells 0..4 east, 9, and 10..14: a way round with a single turn in it."""
ROOM = ["......"] * 6
"""Room for everybody."""


def problem_of(
    floor: Sequence[str],
    starts: Sequence[int],
    tasks: Sequence[Sequence[int]],
    *,
    pool_size: int | None = None,
    round_robin: bool = False,
) -> LeagueProblem:
    """Problem with a pool that holds all tasks of the list, if nothing else is said."""
    return LeagueProblem(
        name="tiny",
        grid=GridMap(np.array([[letter == "." for letter in row] for row in floor])),
        start_cell=np.array(starts, dtype=np.int32),
        errand_ptr=np.cumsum([0, *map(len, tasks)]).astype(np.int32),
        errand_cell=np.array([cell for errands in tasks for cell in errands], dtype=np.int32),
        pool_size=len(tasks) if pool_size is None else pool_size,
        round_robin=round_robin,
    )


def in_ticks(problem: LeagueProblem, *, per_action: int = 3, size: float = 1.0, **delays: Any) -> LeagueProblem:
    """The same problem under the rules of 2026; nobody is delayed if nothing else is said."""
    laws: dict[str, Any] = {
        "seed": 0,
        "shortest": 2,
        "longest": 6,
        "events": "bernoulli",
        "chance": 0.0,
        "durations": "uniform",
        "mean": 0.5,
        "spread": 0.2,
    }
    return replace(problem, ticks=Ticks(per_action=per_action, size=size, delays=Delays(**laws | delays)))


def write_files(folder: Path, problem: LeagueProblem, *, edition: int = 2024) -> Path:
    """Write a problem as the League does; returns the problem file."""
    grid = problem.grid
    floor = "\n".join("".join(".@"[int(not free)] for free in row) for row in grid.free)
    (folder / "tiny.map").write_text(f"type octile\nheight {grid.rows}\nwidth {grid.cols}\nmap\n{floor}\n")
    (folder / "tiny.agents").write_text("\n".join(map(str, [problem.n_robots, *problem.start_cell.tolist()])) + "\n")
    tasks = [",".join(map(str, problem.errands(task).tolist())) for task in range(problem.n_tasks)]
    (folder / "tiny.tasks").write_text("\n".join([f"# {edition}", str(len(tasks)), *tasks]) + "\n")
    keys: dict[str, Any] = {
        "mapFile": "tiny.map",
        "agentFile": "tiny.agents",
        "teamSize": problem.n_robots,
        "taskFile": "tiny.tasks",
        "numTasksReveal": 1 if edition == 2023 else 1.5,
        "version": f"{edition} LoRR",
    }
    if problem.ticks is not None:
        delays = problem.ticks.delays
        keys |= {
            "version": "2026 LoRR",
            "agentCounter": problem.ticks.per_action,
            "agentSize": problem.ticks.size,
            "delayConfig": {
                "seed": delays.seed,
                "minDelay": delays.shortest,
                "maxDelay": delays.longest,
                "eventModel": delays.events,
                "pDelay": delays.chance,
                "durationModel": delays.durations,
                "gaussMeanRatio": delays.mean,
                "gaussStdRatio": delays.spread,
            },
        }
    path = folder / "tiny.json"
    path.write_text(json.dumps(keys, indent=4))
    return path


def random_problem(seed: int, *, n_robots: int = 12, n_tasks: int = 40, round_robin: bool = False) -> LeagueProblem:
    """Robots anywhere in a room with pillars, tasks of one to four errands (one if they are handed out)."""
    rng = np.random.default_rng(seed)
    floor = [[".@"[row % 3 == 1 and col % 3 == 1] for col in range(8)] for row in range(8)]
    free = np.array([cell for cell in range(64) if floor[cell // 8][cell % 8] == "."])
    return problem_of(
        ["".join(row) for row in floor],
        rng.permutation(free)[:n_robots].tolist(),
        [rng.choice(free, size=1 if round_robin else rng.integers(1, 5)).tolist() for _ in range(n_tasks)],
        pool_size=n_robots if round_robin else n_robots * 3 // 2,
        round_robin=round_robin,
    )
