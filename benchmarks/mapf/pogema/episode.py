"""Episodes of POGEMA: the maps, where agents start, and the goals that each of them is given in turn.

Starts and goals are drawn as POGEMA draws them, to the last random number, so that a throughput can be held against a
published one of the same episode. What an agent is given depends on the seed alone, not on when it arrives.

Source: Skrynnik et al., "POGEMA: A Benchmark Platform for Cooperative Multi-Agent Pathfinding", ICLR 2025,
https://arxiv.org/abs/2407.14931; the draws in ``pogema/generator.py`` and ``pogema/envs.py`` of release 1.3.0,
https://github.com/CognitiveAISystems/pogema. That release reads a map with marks as if a plain free cell were both a
start and a goal; the published figures were made with marks as `Floor` says.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label

from maps.grid import GridMap

OBSTACLE, START, GOAL, BOTH = "#", "$", "@", "!"
"""Characters of a map; any other is a free cell."""
_SIGHT = 5
"""Cells that POGEMA adds around a map; it forgets them when it asks whether a goal drawn is the one just reached."""

Cells = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Floor:
    """A map: where agents may be, start, and be sent.

    Raises:
        ValueError: Its lines differ in length.
    """

    name: str
    lines: tuple[str, ...]

    def __post_init__(self) -> None:
        if len({len(line) for line in self.lines}) != 1:
            raise ValueError(f"map {self.name} has lines of different lengths; valid: a rectangle")

    @cached_property
    def grid(self) -> GridMap:
        """Free cells."""
        return GridMap(free=~self._marked(OBSTACLE))

    @property
    def is_marked(self) -> bool:
        """Whether the map says where agents start and are sent; on others they may do so anywhere."""
        return bool(self._marked(START + GOAL + BOTH).any())

    @cached_property
    def starts(self) -> Cells:
        """Cells in which agents start, row by row."""
        return np.flatnonzero(self._marked(START + BOTH)) if self.is_marked else np.flatnonzero(self.grid.free)

    @cached_property
    def goals(self) -> Cells:
        """Cells that agents are sent to, row by row."""
        return np.flatnonzero(self._marked(GOAL + BOTH)) if self.is_marked else np.flatnonzero(self.grid.free)

    @cached_property
    def parts(self) -> Cells:
        """Number of the connected part of the floor that each cell belongs to, -1 for obstacles, shape (n_cells,)."""
        parts, _ = label(self.grid.free)
        part: Cells = parts.ravel().astype(np.int64) - 1
        return part

    def _marked(self, characters: str) -> npt.NDArray[np.bool_]:
        return np.array([[character in characters for character in line] for line in self.lines])


def read_floors(path: Path) -> dict[str, Floor]:
    """Maps of a file of POGEMA's benchmark, by name.

    Args:
        path: A file in which ``"name": |-`` stands above the lines of each map, which are indented.

    Raises:
        ValueError: The file is not of this form.
    """
    drawn: dict[str, list[str]] = {}
    lines: list[str] | None = None
    for number, text in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if text.endswith(": |-"):
            lines = drawn.setdefault(text.removesuffix(": |-").strip('"'), [])
        elif text.startswith(" ") and lines is not None:
            lines.append(text.strip())
        elif text.strip():
            raise ValueError(f'{path}, line {number}: {text!r}; valid: "name": |- above the indented lines of a map')
    return {name: Floor(name, tuple(lines)) for name, lines in drawn.items()}


class Episode:
    """Where agents start, and their goals.

    Args:
        floor: The map.
        n: Number of agents.
        seed: Seed of the episode.

    Raises:
        ValueError: The map has no room for so many agents.
    """

    def __init__(self, floor: Floor, n: int, *, seed: int) -> None:
        self._floor, self._cols = floor, floor.grid.free.shape[1]
        rng = np.random.default_rng(seed)
        if floor.is_marked:
            starts, self._pool = floor.starts.copy(), floor.goals.copy()
            rng.shuffle(starts)
            rng.shuffle(self._pool)
            first = self._pool
        else:
            order = floor.goals.copy()
            rng.shuffle(order)
            starts, first = _paired(order, floor.parts[order])
        if min(len(starts), len(first)) < n:
            raise ValueError(f"map {floor.name} has no room for {n} agents; valid: 1 to {min(len(starts), len(first))}")
        self.starts: Cells = starts[:n]
        """Cell of each agent, shape (n,)."""
        self._first: Cells = first[:n]
        self._seeds = np.random.default_rng(seed).integers(np.iinfo(np.int32).max, size=n)

    @property
    def n(self) -> int:
        """Number of agents."""
        return len(self.starts)

    def goals(self, agent: int) -> Iterator[int]:
        """Goal cells of an agent, one after the other, without end."""
        rng = np.random.default_rng(self._seeds[agent])
        cell = int(self._first[agent])
        if self._floor.is_marked:
            pool = self._pool
        else:
            parts = self._floor.parts
            pool = np.flatnonzero(parts == parts[cell])
        while True:
            yield cell
            row, col = divmod(cell, self._cols)
            cell = _drawn(rng, pool)
            while self._floor.is_marked and divmod(cell, self._cols) == (row + _SIGHT, col + _SIGHT):
                cell = _drawn(rng, pool)


def _drawn(rng: np.random.Generator, pool: Cells) -> int:
    """One of some cells; takes from `rng` what a choice among them takes."""
    return int(pool[rng.integers(len(pool), size=1)[0]])


def _paired(order: Cells, part: Cells) -> tuple[Cells, Cells]:
    """Starts and first goals on a floor without marks.

    Cells are taken in order; in each part of the floor every other cell, from the first one on, is a start, and the
    cell after it in the same part is its goal.

    Args:
        order: Free cells, shuffled.
        part: Part of the floor that each of them is in.

    Returns:
        Start and goal of each pair, in the order of the starts.
    """
    open_start: dict[int, int] = {}
    goal_of: dict[int, int] = {}
    for cell, where in zip(order.tolist(), part.tolist(), strict=True):
        if where in open_start:
            goal_of[open_start.pop(where)] = cell
        else:
            open_start[where] = cell
            goal_of[cell] = -1
    pairs = [(start, goal) for start, goal in goal_of.items() if goal >= 0]
    starts, goals = zip(*pairs, strict=True) if pairs else ((), ())
    return np.array(starts, dtype=np.int64), np.array(goals, dtype=np.int64)
