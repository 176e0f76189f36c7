"""League of Robot Runners: problems of 2023, 2024 and 2026 in, results in the format of 2024 or 2026 out."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from maps.formats import lorr_2026
from maps.formats.lorr_2026 import TickedRun, Ticks
from maps.formats.lorr_files import CellTable, LeagueError, ProblemKeys
from maps.formats.movingai import read_map, read_marks
from maps.grid import EAST, GridMap

Ints = npt.NDArray[np.int32]
Actions = npt.NDArray[np.int8]

WAIT, FORWARD, CLOCKWISE, COUNTER_CLOCKWISE, NO_ACTION = range(5)
"""What a robot does in a timestep; no action = the planner was late or said nothing that can be done."""
LETTERS = "WFRCT"
"""The letter of each action in the League's files."""
START_HEADING = EAST
"""All robots start so."""
MOST_REVEALED = 1000
"""Most tasks per robot that may be known at a time; the League's own problems have 1 and 1.5."""

_VERSIONS = ("2023 LoRR", "2024 LoRR", lorr_2026.VERSION)
_ROUND_ROBIN = "roundrobin"


@dataclass(frozen=True, kw_only=True, eq=False)
class LeagueProblem:
    """A floor, robots on it, and tasks: lists of cells to visit in order. All robots start heading east."""

    name: str
    """The problem file's name without its ending."""
    grid: GridMap
    start_cell: Ints
    """Where the robots start, shape (n,)."""
    errand_ptr: Ints
    errand_cell: Ints
    """Cells of task t of the m in the file: errand_cell[errand_ptr[t]:errand_ptr[t + 1]]; task t >= m is task t % m."""
    pool_size: int
    """Tasks that are known and unfinished at any time."""
    round_robin: bool
    """Rule of 2023: robot k is given tasks k, k + n, k + 2 n, ... one after the other. Otherwise tasks are chosen."""
    marks: npt.NDArray[np.str_] | None = None
    """The map's own character for each cell, shape (n_cells,); the League marks stations and shelves. None = no map."""
    ticks: Ticks | None = None
    """How time passes in a problem of 2026. None = an action takes one timestep, and nobody is delayed."""

    @property
    def n_robots(self) -> int:
        """Number of robots."""
        return len(self.start_cell)

    @property
    def n_tasks(self) -> int:
        """Number of tasks in the file; they start again from the first when all are used."""
        return len(self.errand_ptr) - 1

    def errands(self, task: int) -> Ints:
        """Cells that a task visits, in order."""
        row = task % self.n_tasks
        return self.errand_cell[self.errand_ptr[row] : self.errand_ptr[row + 1]]


@dataclass(frozen=True, kw_only=True, eq=False)
class LeagueResult:
    """What happened in a run, as the League's viewer and validator read it; T timesteps, n robots."""

    problem: LeagueProblem
    actual: Actions
    """Action of each robot in each timestep, shape (T, n)."""
    planned: Actions
    """The same as it was asked for, shape (T, n)."""
    planner_times_s: npt.NDArray[np.float64]
    """Time of each call of the planner [s]."""
    n_finished: int
    makespan: int
    """Most timesteps for which a robot held a task."""
    n_timeouts: int
    """Timesteps in which everybody waited for a late planner."""
    task_id: npt.NDArray[np.int64]
    task_release: Ints
    """Every task that became known, and the timestep when it did, shape (k,) each."""
    events: Ints
    """Errands done: timestep, robot, task, errands of it done by then; shape (k, 4), by timestep."""
    schedule: Ints
    """Changes of the schedule: timestep, robot, task or -1; shape (k, 3), by timestep."""
    proposed: Ints
    """The same as it was asked for, shape (k, 3)."""
    planner_errors: tuple[tuple[int, int, int, str], ...]
    """Robot, other robot or -1, timestep, text."""
    schedule_errors: tuple[tuple[int, int, int, int, str], ...]
    """Task, robot, other robot or -1, timestep, text."""
    ticked: TickedRun | None = None
    """What a run in ticks has besides; there a timestep is a tick."""


def read_problem(path: str | os.PathLike[str]) -> LeagueProblem:
    """Read a problem file and the map, agent and task files it names.

    Args:
        path: The .json file; the others are found relative to it.

    Raises:
        LeagueError: A file cannot be read, a key is missing or has a wrong value, a number is no number, a cell is
            outside or blocked, two robots start in one cell, lines are missing, or no robot can do a task.
        MovingAiError: The map is malformed.

    Source: Input_Output_Format.md of https://github.com/MAPF-Competition/Start-Kit, tags v1.1.5, v2.1.2 and v3.1.0.
    """
    problem = ProblemKeys(Path(path))
    version = _version(problem)
    round_robin = version == _VERSIONS[0]
    ticks = lorr_2026.read_ticks(problem) if version == lorr_2026.VERSION else None
    n_robots = problem.whole("teamSize", least=1)
    reveal = problem.number("numTasksReveal", default=1.0, most=MOST_REVEALED)
    # They multiply in single precision and cut off.
    pool_size = int(np.float32(reveal) * np.float32(n_robots))
    if pool_size < 1:
        raise problem.error("numTasksReveal", "at least one task for the whole team")
    map_path, agent_path, task_path = (problem.file(key) for key in ("mapFile", "agentFile", "taskFile"))
    grid = read_map(map_path)
    room = int(np.count_nonzero(grid.free))
    if n_robots > room:
        raise problem.error("teamSize", f"at most {room}, the free cells of {map_path}")

    agents = CellTable(agent_path)
    if agents.count < n_robots:
        raise LeagueError(
            f"{agent_path}: line {agents.count_line}: {agents.count} agents; valid: at least teamSize = {n_robots}"
        )
    _, start_cell = agents.cells(n_robots, grid, most=1)
    order = np.argsort(start_cell, kind="stable")
    twice = np.flatnonzero(np.diff(start_cell[order]) == 0)
    if twice.size:
        first, second = order[twice[0]], order[twice[0] + 1]
        raise LeagueError(
            f"{agent_path}: line {agents.lines[second]}: location {start_cell[second]} is the start of robot {first} "
            f"(line {agents.lines[first]}) too; valid: one robot a cell"
        )
    tasks = CellTable(task_path)
    if tasks.count < 1:
        raise LeagueError(f"{task_path}: line {tasks.count_line}: {tasks.count} tasks; valid: at least 1")
    errand_ptr, errand_cell = tasks.cells(tasks.count, grid, most=1 if round_robin else None)
    _require_doable(grid, start_cell, errand_ptr, errand_cell, tasks)
    return LeagueProblem(
        name=Path(path).stem,
        grid=grid,
        marks=read_marks(map_path).ravel(),
        start_cell=start_cell,
        errand_ptr=errand_ptr,
        errand_cell=errand_cell,
        pool_size=n_robots if round_robin else pool_size,
        round_robin=round_robin,
        ticks=ticks,
    )


def write_result(path: str | os.PathLike[str], result: LeagueResult) -> None:
    """Write a result file of 2024, also for a problem of 2023; for a run in ticks one of 2026.

    Args:
        path: The .json file.
        result: What happened.

    Raises:
        OSError: The file cannot be written.

    Source: BaseSystem::saveResults in the Start-Kit, tags v2.1.2 and v3.1.0. Unlike there, schedule errors carry the
    timestep in which the schedule would have come into force, as events and schedules do, and each segment of a path
    of 2026 says where it begins, as their description of the format has it; their program writes the start in all.
    """
    problem = result.problem
    row, col = (axis.tolist() for axis in problem.grid.row_col(problem.start_cell))
    entries: dict[str, Any] = {
        "actionModel": "MAPF_T",
        "version": _VERSIONS[1],
        "teamSize": problem.n_robots,
        "numTaskFinished": result.n_finished,
        "makespan": result.makespan,
        "numPlannerErrors": len(result.planner_errors),
        "numScheduleErrors": len(result.schedule_errors),
        "numEntryTimeouts": result.n_timeouts,
        "start": ([r, c, "E"] for r, c in zip(row, col, strict=True)),
        "actualPaths": _paths(result.actual),
        "plannerPaths": _paths(result.planned),
        "plannerTimes": result.planner_times_s.tolist(),
        "errors": result.planner_errors,
        "actualSchedule": _schedules(result.schedule, problem.n_robots),
        "plannerSchedule": _schedules(result.proposed, problem.n_robots),
        "scheduleErrors": result.schedule_errors,
        "events": result.events.tolist(),
        "tasks": _tasks(result),
    }
    if (ticked := result.ticked) is not None and problem.ticks is not None:
        entries |= {
            "version": lorr_2026.VERSION,
            "makespan": len(result.actual),
            "agentMaxCounter": problem.ticks.per_action,
            "outputSegmentSize": lorr_2026.SEGMENT,
            "delayIntervals": lorr_2026.delay_lists(ticked.delays, problem.n_robots),
            "actualPaths": lorr_2026.segment_paths(result.actual, ticked.poses, LETTERS),
            "plannerPaths": lorr_2026.segment_paths(result.planned, ticked.poses, LETTERS),
        }
    with Path(path).open("w", encoding="ascii") as file:
        file.write("{")
        for number, (key, value) in enumerate(entries.items()):
            file.write(f"{',' if number else ''}\n    {json.dumps(key)}: ")
            if isinstance(value, (str, int)):
                file.write(json.dumps(value))
            else:
                _write_list(file, value)
        file.write("\n}\n")


def _write_list(file: IO[str], items: Iterable[Any]) -> None:
    """One item a line, without ever holding the text of all."""
    file.write("[")
    for number, item in enumerate(items):
        file.write(f"{',' if number else ''}\n        {json.dumps(item)}")
    file.write("]")


def _paths(actions: Actions) -> Iterator[str]:
    """Letters of each robot, separated by commas."""
    letters = np.frombuffer(LETTERS.encode("ascii"), dtype=np.uint8)
    steps, n = actions.shape
    text = np.full(max(2 * steps - 1, 0), ord(","), dtype=np.uint8)
    for robot in range(n):
        text[::2] = letters[actions[:, robot]]
        yield text.tobytes().decode("ascii")


def _schedules(changes: Ints, n_robots: int) -> Iterator[str]:
    """`timestep:task` of each robot, separated by commas."""
    by_robot = changes[np.argsort(changes[:, 1], kind="stable")]
    ends = np.searchsorted(by_robot[:, 1], np.arange(n_robots + 1))
    for robot in range(n_robots):
        own = by_robot[ends[robot] : ends[robot + 1]].tolist()
        yield ",".join(f"{timestep}:{task}" for timestep, _, task in own)


def _tasks(result: LeagueResult) -> Iterator[list[Any]]:
    for task, release in zip(result.task_id.tolist(), result.task_release.tolist(), strict=True):
        stops = np.column_stack(result.problem.grid.row_col(result.problem.errands(task)))
        yield [task, release, stops.ravel().tolist()]


def _version(problem: ProblemKeys) -> str:
    """Whose rules hold."""
    version = problem.text("version", default=None)
    strategy = problem.text("taskAssignmentStrategy", default=None)
    if version is None:
        version = _VERSIONS[0] if strategy is not None else _VERSIONS[1]
    if version not in _VERSIONS:
        raise problem.error("version", f"one of {', '.join(map(repr, _VERSIONS))}")
    if version == _VERSIONS[0] and strategy not in (None, _ROUND_ROBIN):
        raise problem.error("taskAssignmentStrategy", repr(_ROUND_ROBIN))
    return version


def _require_doable(grid: GridMap, start_cell: Ints, errand_ptr: Ints, errand_cell: Ints, tasks: CellTable) -> None:
    """Refuse tasks that no robot could ever finish."""
    area = _areas(grid)
    manned = np.zeros(grid.n_cells, dtype=np.bool_)
    manned[area[start_cell]] = True
    of_errand = area[errand_cell]
    first = np.repeat(of_errand[errand_ptr[:-1]], np.diff(errand_ptr))
    bad = np.flatnonzero(~manned[of_errand] | (of_errand != first))
    if bad.size:
        task = int(np.searchsorted(errand_ptr, bad[0], side="right")) - 1
        raise LeagueError(
            f"{tasks.path}: line {tasks.lines[task]}: location {errand_cell[bad[0]]} of task {task} cannot be reached; "
            "valid: cells of one connected area with a robot in it"
        )


def _areas(grid: GridMap) -> npt.NDArray[np.int64]:
    """A label for each cell that all cells connected with it share, shape (n_cells,): the smallest of their indices."""
    label = np.arange(grid.n_cells, dtype=np.int64)
    index, free = label.reshape(grid.free.shape), grid.free
    east, south = free[:, :-1] & free[:, 1:], free[:-1] & free[1:]
    a = np.concatenate((index[:, :-1][east], index[:-1][south]))
    b = np.concatenate((index[:, 1:][east], index[1:][south]))
    # Hook the larger label of each pair below the smaller one, then let all point to their roots.
    while (apart := label[a] != label[b]).any():
        a, b = a[apart], b[apart]
        np.minimum.at(label, np.maximum(label[a], label[b]), np.minimum(label[a], label[b]))
        while (label != label[label]).any():
            label = label[label]
    return label
