"""The plan command: one-shot path finding on a published map and scenario."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import Progress, ProgressColumn, Task, TextColumn
from rich.progress_bar import ProgressBar

from fleet.cli.arguments import require_with
from fleet.cli.run_output import figure_table, plain_console
from fleet.config import require
from fleet.config.member_settings import member_settings
from fleet.outputs import require_file, require_other
from fleet.whole_file import draft_of
from planners.mapf import ONE_SHOT_PLANNERS, planner_named

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from maps.grid import GridMap
    from maps.lane_graph import LaneGraph
    from planners.mapf.distance_table import DistanceTable
    from planners.mapf.planner import MapfPlanner
    from planners.mapf.problem import Instance, Plan

SOLVED, NOT_SOLVED = 0, 1
LONGEST = 1_000_000
"""Timesteps that nobody's plan has."""


@dataclass(frozen=True, kw_only=True)
class PlanCommand:
    """Plan the paths of many robots at once, from a MovingAI map and scenario to a SMART path file."""

    map: Path
    """The .map file."""
    scen: Path
    """The .scen file: starts and goals."""
    agents: int | None = None
    """Number of robots, the first entries of the scenario; default all."""
    planner: Annotated[
        str,
        tyro.conf.arg(
            help=f"Planner: {ONE_SHOT_PLANNERS.valid}. lacam is complete and improves its plan until the budget ends, "
            "sipp is quick but not complete, cbs is optimal, for few robots."
        ),
    ] = "lacam"
    planner_setting: tuple[str, ...] = ()
    """A setting of the planner, as name=value; once for each setting. A name that does not exist is answered with
    those that do."""
    settings: Path | None = None
    """TOML file with settings: tables [planner.NAME]; --planner-setting goes first."""
    motion: Literal["pebble", "rotating"] = "pebble"
    """What a robot does in a timestep: pebble steps to a neighbouring cell, rotating steps ahead or turns, and faces
    east at its start and goal."""
    no_rings: bool = False
    """Refuse closed rings of robots that follow each other, as a plan needs that is executed with delays."""
    budget_s: float = 10.0
    """Time to plan [s]; files are read and kernels loaded before it begins."""
    seed: int = 0
    """Seed of everything random."""
    begin_with: Path | None = None
    """A path file of any planner that is checked, and improved until the budget ends; --planner is not asked then. For
    --motion pebble."""
    output: Path = Path("paths.txt")
    """The path file to write."""

    def run(self) -> int:
        """Plan, write and print; returns the exit status."""
        # The kernels take a second to load: only for plans, not for --help.
        import numpy as np

        from maps.formats.movingai import read_map, starts_and_goals
        from maps.formats.smart import write_paths
        from maps.lane_graph import grid_lane_graph
        from planners.deadline import Deadline
        from planners.mapf.distance_table import DistanceTable
        from planners.mapf.lacam.lns import improve
        from planners.mapf.validate import breaches

        require(self.agents is None or self.agents >= 1, "--agents", self.agents, "an integer >= 1")
        require(math.isfinite(self.budget_s) and self.budget_s > 0, "--budget-s", self.budget_s, "a number > 0")
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        require(self.begin_with is None or self.motion == "pebble", "--motion", self.motion, "pebble with --begin-with")
        require_with("--planner-setting", bool(self.planner_setting), self.begin_with is None, "without --begin-with")
        require_with("--settings", self.settings is not None, self.begin_with is None, "without --begin-with")
        planner = self._planner()
        # LaCAM has the kernels of the search that improves plans.
        warm = (
            self._planner()
            if self.begin_with is None
            else planner_named("lacam", {}, seed=self.seed, family=ONE_SHOT_PLANNERS, what="--planner")
        )
        grid = read_map(self.map)
        starts, goals = starts_and_goals(self.scen, grid, agents=self.agents)
        self._check_output()
        graph = grid_lane_graph(grid, self.motion)
        instance = _instance(graph, starts, goals, allow_rotation=not self.no_rings)
        console = plain_console()
        what = f"{len(starts)} robots on {self.map.name}, {grid.free.sum()} free cells"
        how = self.planner if self.begin_with is None else f"{self.begin_with} improved"
        first = None if self.begin_with is None else _plan_of(self.begin_with, grid, instance)
        console.print(f"{what}: {how}, {self.budget_s:g} s", soft_wrap=True)
        warm.plan(_crossing(self.motion), None, Deadline(64))  # loads the kernels
        with _progress(console, self.budget_s):
            begin = time.perf_counter()
            tables = DistanceTable(graph, instance.blocked)
            deadline = Deadline(wall_s=self.budget_s)
            if first is None:
                decision = planner.plan(instance, tables, deadline)
            else:
                decision = improve(instance, first, tables, deadline, np.random.default_rng(self.seed))
            elapsed_s = time.perf_counter() - begin
        wrong = breaches(instance, decision)
        cells = np.stack(grid.row_col(graph.state_cell[decision.states]), axis=-1)
        with draft_of(self.output) as draft:
            write_paths(draft, cells)
        verdict = f"{wrong[0].kind} conflict at timestep {wrong[0].timestep}" if wrong else "legal"
        console.print(figure_table(_figures(instance, decision, tables, elapsed_s, verdict)))
        solved = bool((decision.states[-1] == instance.goals).all())
        held = "the paths" if solved else f"a legal beginning of {len(decision.states) - 1} timesteps"
        console.print(f"{self.output}: {held}", soft_wrap=True)
        return SOLVED if solved and not wrong else NOT_SOLVED

    def _planner(self) -> MapfPlanner:
        settings = member_settings(self.settings, "planner", self.planner, self.planner_setting)
        return planner_named(self.planner, settings, seed=self.seed, family=ONE_SHOT_PLANNERS, what="--planner")

    def _check_output(self) -> None:
        """Refuse an output that cannot be written, before the time is spent."""
        for name in ("map", "scen"):
            require_other("--output", self.output, getattr(self, name), than=f"--{name}")
        require_file("--output", self.output)


class _BudgetColumn(ProgressColumn):
    """How much of the budget is gone."""

    def render(self, task: Task) -> ProgressBar:
        return ProgressBar(total=task.total, completed=min(task.elapsed or 0.0, task.total or 0.0), width=40)


def _progress(console: Console, budget_s: float) -> Progress:
    """A bar that moves by itself on a terminal, and nothing elsewhere."""
    progress = Progress(
        TextColumn("{task.description}"),
        _BudgetColumn(),
        TextColumn("{task.elapsed:.1f} of {task.total:g} s"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    progress.add_task("planning", total=budget_s)
    return progress


def _instance(
    graph: LaneGraph, starts: npt.NDArray[np.integer], goals: npt.NDArray[np.integer], *, allow_rotation: bool
) -> Instance:
    """Everybody from cell to cell, all alike."""
    import numpy as np

    from maps.grid import EAST
    from planners.mapf.problem import Instance

    n = len(starts)
    return Instance(
        graph=graph,
        starts=graph.state_index[starts, EAST],
        goals=graph.state_index[goals, EAST],
        priorities=np.zeros(n),
        stay=np.zeros(n, dtype=np.bool_),
        fixed=np.zeros(n, dtype=np.bool_),
        blocked=np.zeros(graph.n_cells, dtype=np.bool_),
        allow_rotation=allow_rotation,
        horizon=LONGEST,
    )


def _crossing(motion: Literal["pebble", "rotating"]) -> Instance:
    """A problem of the same kind that is solved at once."""
    import numpy as np

    from maps.grid import GridMap
    from maps.lane_graph import grid_lane_graph

    graph = grid_lane_graph(GridMap(np.ones((3, 3), dtype=np.bool_)), motion)
    return _instance(graph, np.array([1, 3]), np.array([7, 5]), allow_rotation=True)


def _plan_of(path: Path, grid: GridMap, instance: Instance) -> Plan:
    """The plan in a path file, which must be a legal one of the instance."""
    import numpy as np

    from maps.formats.smart import read_paths
    from maps.grid import EAST
    from planners.mapf.problem import Plan
    from planners.mapf.validate import breaches
    from planners.status import Status

    what, cells = f"--begin-with {path}", read_paths(path)
    n = instance.n_agents
    require(len(cells) > 0 and cells.shape[1] == n, what, f"paths of {cells.shape[1]} robots", f"paths of {n} robots")
    row, col = cells[..., 0], cells[..., 1]
    inside = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
    require(bool(inside.all()), what, "a path that leaves the map", f"{grid.rows} rows and {grid.cols} columns")
    states = instance.graph.state_index[grid.index(row, col), EAST]
    require(bool((states >= 0).all()), what, "a path through an obstacle", "free cells")
    decision = Plan(states=states.astype(np.int32), status=Status.FEASIBLE, iterations=0)
    for wrong in breaches(instance, decision)[:1]:
        robots = ", ".join(map(str, wrong.agents))
        found = f"{wrong.kind} conflict of robots {robots} at timestep {wrong.timestep}"
        require(False, what, found, "paths without conflicts from the scenario's starts")
    at_goals = bool((decision.states[-1] == instance.goals).all())
    return decision if at_goals else replace(decision, status=Status.TIMEOUT)


def _figures(
    instance: Instance, decision: Plan, tables: DistanceTable, elapsed_s: float, verdict: str
) -> dict[str, str]:
    """The figures of a plan; costs only of one that is whole."""
    from planners.mapf.metrics import lower_bound, sum_of_costs, sum_of_loss

    there = decision.states[-1] == instance.goals
    rows = {"status": decision.status.value, "robots at their goals": f"{there.sum()} of {len(there)}"}
    if there.all():
        least, loss = lower_bound(instance, tables), sum_of_loss(instance, decision)
        rows |= {
            "makespan": f"{len(decision.states) - 1} timesteps",
            "sum of costs": f"{sum_of_costs(instance, decision)}",
            "sum of loss": f"{loss}",
            "lower bound": f"{least}",
            "sum of loss / lower bound": f"{loss / least:.3f}" if least else "-",
        }
    rows |= {"time": f"{elapsed_s:.2f} s", "referee": verdict}
    return rows
