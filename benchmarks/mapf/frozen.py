"""Never frozen: generated two-way floors, narrow and wide, with dead ends, on which a fleet drives for long."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from benchmarks.harness import Row, Trial
from benchmarks.mapf.drawn import largest_part
from fleet.arrays import BoolArray
from fleet.league.multi_step_controller import MultiStepController
from fleet.league.pace import finished_in_blocks, longest_stand
from fleet.league.play import play
from maps.formats.lorr import LeagueProblem
from maps.grid import GridMap

FLOORS, QUICK_FLOORS = 30, 1
STEPS, QUICK_STEPS = 5000, 400
BUDGET_S = 0.010
FIRST_SEED = 91_000
KEPT = 95.0
"""What the last quarter must keep of the best one [%]."""
TASKS_PER_ROBOT = 20


def measure_frozen(trial: Trial) -> Iterable[Row]:
    """Every floor once; a floor is frozen if the last quarter of the run finishes much less than the best one."""
    steps = QUICK_STEPS if trial.quick else STEPS
    frozen, kept = [], []
    for seed in range(FIRST_SEED, FIRST_SEED + (QUICK_FLOORS if trial.quick else FLOORS)):
        problem = draw_floor(seed)
        played = play(problem, MultiStepController(seed=seed), steps, BUDGET_S)
        wrong = len(played.conflicts) + len(played.result.planner_errors) + len(played.result.schedule_errors)
        trial.check(wrong == 0, f"floor {seed}: {wrong} conflicts and errors")
        quarters = finished_in_blocks(played.result, steps // 4)
        kept.append(100.0 * float(quarters[-1]) / max(int(quarters.max()), 1))
        if kept[-1] < KEPT:
            frozen.append(seed)
            free = int(np.count_nonzero(problem.grid.free))
            trial.notes.append(
                f"floor {seed}: {problem.n_robots} robots on {free} cells, tasks by quarter {quarters.tolist()}, "
                f"longest stand {longest_stand(played.result)} steps"
            )
    target = "" if trial.quick else "<= 0"
    yield Row(name="two-way floors", value=len(kept), unit="floors")
    yield Row(name=f"  last quarter below {KEPT:g} % of the best", value=len(frozen), unit="floors", target=target)
    yield Row(name="  last quarter of the best, least", value=min(kept), unit="%")


def draw_floor(seed: int) -> LeagueProblem:
    """Racks with aisles of one to three cells between them, some closed at one end, and robots all over the floor.

    Args:
        seed: Seed of everything: racks, aisles, dead ends, robots (a tenth to half of the floor), tasks of two errands.
    """
    rng = np.random.default_rng(seed)
    grid = GridMap(largest_part(_racks(rng)))
    cells = np.flatnonzero(grid.free)
    n = int(rng.uniform(0.1, 0.5) * len(cells))
    ends = rng.choice(cells, size=2 * TASKS_PER_ROBOT * n)
    return LeagueProblem(
        name=f"floor_{seed}",
        grid=grid,
        start_cell=rng.choice(cells, n, replace=False).astype(np.int32),
        errand_ptr=np.arange(0, len(ends) + 1, 2, dtype=np.int32),
        errand_cell=ends.astype(np.int32),
        pool_size=int(1.5 * n),
        round_robin=False,
    )


def _racks(rng: np.random.Generator) -> BoolArray:
    """Free cells of a floor."""
    aisle, cross = rng.integers(1, 4, size=2)
    length, depth = rng.integers(3, 9), rng.integers(1, 4)
    rows, columns = rng.integers(20, 41, size=2)
    free = np.ones((rows, columns), dtype=np.bool_)
    for top in range(aisle, rows - aisle, depth + aisle):
        for left in range(cross, columns - cross, length + cross):
            free[top : min(top + depth, rows - aisle), left : min(left + length, columns - cross)] = False
            # A wall across the aisle below makes two dead ends of it.
            if rng.random() < 0.1:
                free[top + depth : min(top + depth + aisle, rows - aisle), left + length // 2] = False
    return free
