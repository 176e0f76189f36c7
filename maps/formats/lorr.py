"""League of Robot Runners: problems of 2023 and 2024 in, results in the format of 2024 out."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from maps.errors import MapsError
from maps.formats.movingai import read_map, read_marks
from maps.grid import EAST, GridMap
from maps.reading.shown import shown
from maps.reading.text_file import FileError, is_file, parse_json, read_lines, read_text

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

_VERSIONS = ("2023 LoRR", "2024 LoRR")
_ROUND_ROBIN = "roundrobin"
_FORM = "a JSON object with teamSize, mapFile, agentFile and taskFile"


class LeagueError(MapsError):
    """A problem of the League is malformed; the message names file, line and field."""


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


def read_problem(path: str | os.PathLike[str]) -> LeagueProblem:
    """Read a problem file and the map, agent and task files it names.

    Args:
        path: The .json file; the others are found relative to it.

    Raises:
        LeagueError: A file cannot be read, a key is missing or has a wrong value, a number is no number, a cell is
            outside or blocked, two robots start in one cell, lines are missing, or no robot can do a task.
        MovingAiError: The map is malformed.

    Source: Input_Output_Format.md of https://github.com/MAPF-Competition/Start-Kit, tags v1.1.5 and v2.1.2.
    """
    problem = _Keys(Path(path))
    round_robin = _is_round_robin(problem)
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

    agents = _Table(agent_path)
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
    tasks = _Table(task_path)
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
    )


def write_result(path: str | os.PathLike[str], result: LeagueResult) -> None:
    """Write a result file of 2024, also for a problem of 2023.

    Args:
        path: The .json file.
        result: What happened.

    Raises:
        OSError: The file cannot be written.

    Source: BaseSystem::saveResults in the Start-Kit, tag v2.1.2. Unlike there, schedule errors carry the timestep in
    which the schedule would have come into force, as events and schedules do.
    """
    problem = result.problem
    row, col = (axis.tolist() for axis in problem.grid.row_col(problem.start_cell))
    entries: dict[str, Any] = {
        "actionModel": "MAPF_T",
        "version": "2024 LoRR",
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


def _is_round_robin(problem: _Keys) -> bool:
    """Which edition's rule of assignment holds."""
    version = problem.text("version", default=None)
    strategy = problem.text("taskAssignmentStrategy", default=None)
    if version is None:
        version = _VERSIONS[0] if strategy is not None else _VERSIONS[1]
    if version not in _VERSIONS:
        raise problem.error("version", f"one of {', '.join(map(repr, _VERSIONS))}")
    if version == _VERSIONS[0] and strategy not in (None, _ROUND_ROBIN):
        raise problem.error("taskAssignmentStrategy", repr(_ROUND_ROBIN))
    return version == _VERSIONS[0]


def _require_doable(grid: GridMap, start_cell: Ints, errand_ptr: Ints, errand_cell: Ints, tasks: _Table) -> None:
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


class _Keys:
    """The keys of a problem file, and where they stand in it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._text = _read(path)
        try:
            keys = parse_json(self._text, str(path), valid=_FORM)
        except FileError as error:
            raise LeagueError(str(error)) from error
        if not isinstance(keys, dict):
            raise LeagueError(f"{path}: line 1: {type(keys).__name__}; valid: {_FORM}")
        self._keys: dict[str, Any] = keys

    def error(self, key: str, valid: str) -> LeagueError:
        """What to raise about the value of a key."""
        if key not in self._keys:
            return LeagueError(f"{self.path}: {key} is missing; valid: {valid}")
        before, _, _ = self._text.partition(f'"{key}"')
        line = 1 + before.count("\n")
        return LeagueError(f"{self.path}: line {line}: {key} = {shown(self._keys[key])}; valid: {valid}")

    def text(self, key: str, *, default: str | None) -> str | None:
        value = self._keys.get(key, default)
        if value is not None and not isinstance(value, str):
            raise self.error(key, "a text")
        return value

    def number(self, key: str, *, default: float, most: int) -> float:
        value = self._keys.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value <= most:
            raise self.error(key, f"a number > 0 and <= {most}")
        return float(value)

    def whole(self, key: str, *, least: int) -> int:
        value = self._keys.get(key)
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.error(key, f"an integer >= {least}")
        return value

    def file(self, key: str) -> Path:
        value = self._keys.get(key)
        if not isinstance(value, str) or not value:
            raise self.error(key, "the path of a file, relative to this one")
        path = self.path.parent / value
        if not is_file(path):
            raise self.error(key, "the path of a file, relative to this one")
        return path


class _Table:
    """An agent or task file: comments, the number of entries, and an entry a line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: list[int] = []
        """Line number of each entry that was read."""
        numbered = enumerate(_lines(path), start=1)
        self._entries = ((number, line) for number, line in numbered if not line.startswith("#"))
        self.count_line, line = next(self._entries, (1, ""))
        try:
            self.count = int(line)
        except ValueError:
            raise LeagueError(
                f"{path}: line {self.count_line}: {shown(line)}; valid: the number of entries that follow"
            ) from None

    def cells(self, n: int, grid: GridMap, *, most: int | None) -> tuple[Ints, Ints]:
        """Read n entries of at most `most` cells each: their CSR, shapes (n + 1,) and (k,)."""
        ptr, cells = [0], []
        for number, line in self._entries:
            if len(self.lines) == n:
                break
            fields = line.strip().removesuffix(",").split(",")
            try:
                cells += [int(field) for field in fields]
            except ValueError:
                what = "a location" if most == 1 else "locations, separated by commas"
                raise LeagueError(f"{self.path}: line {number}: {shown(line)}; valid: {what}") from None
            if most is not None and len(fields) > most:
                raise LeagueError(f"{self.path}: line {number}: {len(fields)} locations; valid: {most}")
            ptr.append(len(cells))
            self.lines.append(number)
        if len(self.lines) < n:
            raise LeagueError(f"{self.path}: ends after {len(self.lines)} entries; valid: {self.count}, as it promises")
        return np.array(ptr, dtype=np.int32), self._checked(ptr, cells, grid)

    def _checked(self, ptr: list[int], cells: list[int], grid: GridMap) -> Ints:
        """Cells on the free floor, shape (k,)."""
        location = np.array([cell if 0 <= cell < grid.n_cells else -1 for cell in cells], dtype=np.int32)
        outside = location < 0
        bad = outside | ~grid.free.ravel()[location]
        if bad.any():
            at = int(np.flatnonzero(bad)[0])
            line = self.lines[int(np.searchsorted(ptr, at, side="right")) - 1]
            why = f"outside 0..{grid.n_cells - 1}" if outside[at] else "an obstacle"
            raise LeagueError(f"{self.path}: line {line}: location {shown(cells[at])} is {why}; valid: a free cell")
        return location


def _lines(path: Path) -> list[str]:
    try:
        return read_lines(path, str(path), valid="a file of the League of Robot Runners")
    except FileError as error:
        raise LeagueError(str(error)) from error


def _read(path: Path) -> str:
    try:
        return read_text(path, str(path), valid="a file of the League of Robot Runners")
    except FileError as error:
        raise LeagueError(str(error)) from error
