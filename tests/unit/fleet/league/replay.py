"""The League's rules once more, in plain Python on the files alone: the judge of what we write.

Shares no code with the package: reads a result file, and for its floor and team only the problem's own files.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

STEPS = {"E": (0, 1), "S": (1, 0), "W": (0, -1), "N": (-1, 0)}
CLOCK = "ESWN"


def lines_of(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]


def floor_of(problem: Path) -> list[str]:
    """Rows of the problem's map."""
    return lines_of(problem.parent / json.loads(problem.read_text())["mapFile"])[4:]


def drive(pose: tuple[int, int, str], letter: str) -> tuple[int, int, str]:
    """Pose after an action."""
    row, col, heading = pose
    if letter == "F":
        return row + STEPS[heading][0], col + STEPS[heading][1], heading
    turned = {"R": 1, "C": -1, "W": 0, "T": 0}[letter]
    return row, col, CLOCK[(CLOCK.index(heading) + turned) % 4]


def first_conflict(floor: Sequence[str], before: list[tuple[int, int, str]], after: list[tuple[int, int, str]]) -> str:
    """What is wrong with a timestep; empty = nothing."""
    places = [pose[:2] for pose in after]
    for row, col in places:
        if not (0 <= row < len(floor) and 0 <= col < len(floor[0])) or floor[row][col] in "@T":
            return f"({row}, {col}) is no floor"
    if len(set(places)) < len(places):
        return "two robots in one cell"
    went = {(a[:2], b[:2]) for a, b in zip(before, after, strict=True) if a[:2] != b[:2]}
    return "two robots swap cells" if any((there, here) in went for here, there in went) else ""


class Replay:
    """What the paths and schedules of a result file amount to.

    Attributes:
        complaints: Everything that contradicts the rules or the file itself.
        n_finished: Tasks finished.
        events: Errands done.
    """

    def __init__(self, problem: Path, output: Path) -> None:
        result: dict[str, Any] = json.loads(output.read_text())
        keys = json.loads(problem.read_text())
        floor = floor_of(problem)
        team = [int(line) for line in lines_of(problem.parent / keys["agentFile"])[1:]][: keys["teamSize"]]
        self.complaints: list[str] = []
        self.n_finished = 0
        self.events: list[list[int]] = []
        start = [[cell // len(floor[0]), cell % len(floor[0]), "E"] for cell in team]
        if result["start"] != start:
            self.complaints.append("the robots start elsewhere")
        self._tasks = {task: [(s[k], s[k + 1]) for k in range(0, len(s), 2)] for task, _, s in result["tasks"]}
        self._release = {task: release for task, release, _ in result["tasks"]}
        self._compare_tasks(problem.parent / keys["taskFile"], len(floor[0]))
        self._schedules = [
            {int(t): int(task) for t, task in (entry.split(":") for entry in text.split(",") if entry)}
            for text in result["actualSchedule"]
        ]
        paths = [text.split(",") if text else [] for text in result["actualPaths"]]
        poses = [(row, col, heading) for row, col, heading in result["start"]]
        self._work = [[-1, 0] for _ in poses]  # task, errands of it done
        for t in range(len(paths[0])):
            letters = [path[t] for path in paths]
            after = [drive(pose, letter) for pose, letter in zip(poses, letters, strict=True)]
            wrong = first_conflict(floor, poses, after)
            if wrong:
                self.complaints.append(f"timestep {t + 1}: {wrong}")
            poses = after
            if "T" not in letters:
                self._errands(t + 1, [pose[:2] for pose in poses])
        self._compare(result)

    def _errands(self, timestep: int, places: list[tuple[int, int]]) -> None:
        for robot, own in enumerate(self._work):
            wanted = self._schedules[robot].get(timestep, own[0])
            if own[1] > 0 and wanted != own[0]:
                self.complaints.append(f"timestep {timestep}: robot {robot} leaves task {own[0]}")
            if wanted >= 0 and self._release[wanted] >= timestep:
                self.complaints.append(f"timestep {timestep}: task {wanted} is not known yet")
            own[0] = wanted
        held = [task for task, _ in self._work if task >= 0]
        if len(set(held)) < len(held):
            self.complaints.append(f"timestep {timestep}: two robots have one task")
        for robot, (own, place) in enumerate(zip(self._work, places, strict=True)):
            if own[0] >= 0 and self._tasks[own[0]][own[1]] == place:
                own[1] += 1
                self.events.append([timestep, robot, *own])
                if own[1] == len(self._tasks[own[0]]):
                    self.n_finished += 1
                    own[:] = [-1, 0]

    def _compare_tasks(self, task_file: Path, cols: int) -> None:
        rows = [[int(cell) for cell in line.strip(",").split(",")] for line in lines_of(task_file)[1:]]
        for task, stops in self._tasks.items():
            if stops != [(cell // cols, cell % cols) for cell in rows[task % len(rows)]]:
                self.complaints.append(f"task {task} is another one in the task file")

    def _compare(self, result: dict[str, Any]) -> None:
        if self.events != result["events"]:
            self.complaints.append("the events are others")
        if self.n_finished != result["numTaskFinished"]:
            self.complaints.append(f"{self.n_finished} tasks finished, not {result['numTaskFinished']}")
        for count, errors in (("numPlannerErrors", "errors"), ("numScheduleErrors", "scheduleErrors")):
            if result[count] != len(result[errors]):
                self.complaints.append(f"{count} does not count {errors}")
