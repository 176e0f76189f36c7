"""Problems of the League drawn anew: a published floor and its tasks, with other robots and another order."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.ndimage import label

from maps.formats.lorr import read_problem
from maps.grid import BoolGrid


def largest_part(free: BoolGrid) -> BoolGrid:
    """The largest part of a floor that holds together, shape (rows, cols)."""
    parts, _ = label(free)
    largest: BoolGrid = parts == np.argmax(np.bincount(parts.ravel())[1:]) + 1
    return largest


def draw_problem(published: Path, folder: Path, n_robots: int, seed: int) -> Path:
    """Write a problem on the floor of a published one.

    Robots start in cells drawn from the largest part of the floor, and the tasks come in another order; as many are
    known per robot as in the League's own problems of 2024.

    Args:
        published: Problem file whose floor and tasks are taken.
        folder: Where the new files go; the map stays where it is.
        n_robots: Robots; as many cells must be free.
        seed: Seed of the draw.

    Returns:
        The new problem file.
    """
    problem = read_problem(published)
    rng = np.random.default_rng(seed)
    starts = rng.choice(np.flatnonzero(largest_part(problem.grid.free)), n_robots, replace=False)
    tasks = [",".join(map(str, problem.errands(task).tolist())) for task in rng.permutation(problem.n_tasks).tolist()]
    name = f"{published.stem}_{n_robots}_{seed}"
    (folder / f"{name}.agents").write_text("\n".join(map(str, [n_robots, *starts.tolist()])) + "\n", encoding="utf-8")
    (folder / f"{name}.tasks").write_text("\n".join([str(len(tasks)), *tasks]) + "\n", encoding="utf-8")
    floor = published.parent / json.loads(published.read_text(encoding="utf-8"))["mapFile"]
    keys = {
        "mapFile": str(floor.resolve()),
        "agentFile": f"{name}.agents",
        "teamSize": n_robots,
        "taskFile": f"{name}.tasks",
        "numTasksReveal": 1.5,
        "version": "2024 LoRR",
    }
    path = folder / f"{name}.json"
    path.write_text(json.dumps(keys, indent=4) + "\n", encoding="utf-8")
    return path
