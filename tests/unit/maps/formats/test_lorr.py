"""League files: problems of both editions are read, every defect is named, results say what happened."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maps.errors import MapsError
from maps.formats.lorr import (
    CLOCKWISE,
    COUNTER_CLOCKWISE,
    FORWARD,
    NO_ACTION,
    WAIT,
    LeagueProblem,
    LeagueResult,
    read_problem,
    write_result,
)
from maps.formats.lorr_files import LeagueError

FLOOR = ["....", ".@@.", "....", "@@@@", "...T"]
KEYS = {
    "mapFile": "floor.map",
    "agentFile": "team.agents",
    "teamSize": 2,
    "taskFile": "work.tasks",
    "numTasksReveal": 1.5,
    "version": "2024 LoRR",
}
AGENTS = "# version for LoRR 2024\n3\n0\n3\n8\n"
TASKS = "# version for LoRR 2024\n4\n1,2,11\n8\n10,4,\n3,0\n"


def write_problem(folder: Path, keys: dict[str, Any], agents: str = AGENTS, tasks: str = TASKS) -> Path:
    floor = f"type octile\nheight {len(FLOOR)}\nwidth {len(FLOOR[0])}\nmap\n" + "\n".join(FLOOR) + "\n"
    (folder / "floor.map").write_text(floor)
    (folder / "team.agents").write_text(agents)
    (folder / "work.tasks").write_text(tasks)
    path = folder / "tiny.json"
    path.write_text(json.dumps(keys, indent=4))
    return path


def test_a_problem_of_2024_is_read(tmp_path: Path) -> None:
    problem = read_problem(write_problem(tmp_path, KEYS))
    assert (problem.name, problem.n_robots, problem.n_tasks) == ("tiny", 2, 4)
    assert problem.start_cell.tolist() == [0, 3]
    assert [problem.errands(task).tolist() for task in range(5)] == [[1, 2, 11], [8], [10, 4], [3, 0], [1, 2, 11]]
    assert (problem.pool_size, problem.round_robin) == (3, False)
    assert problem.grid.free.tolist() == [[letter == "." for letter in row] for row in FLOOR]


@pytest.mark.parametrize(
    "edition", [{"version": "2023 LoRR"}, {"taskAssignmentStrategy": "roundrobin", "numTasksReveal": 1}]
)
def test_a_problem_of_2023_gives_tasks_in_turn(tmp_path: Path, edition: dict[str, Any]) -> None:
    keys = {key: value for key, value in KEYS.items() if key != "version"} | edition
    problem = read_problem(write_problem(tmp_path, keys, agents="2\n0\n3\n", tasks="3\n1\n2\n11\n"))
    assert problem.round_robin
    assert problem.errand_ptr.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"teamSize": None}, "teamSize = None; valid: an integer >= 1"),
        ({"teamSize": 0}, "line 4: teamSize = 0; valid: an integer >= 1"),
        ({"teamSize": True}, "teamSize = True; valid: an integer"),
        ({"teamSize": 2.0}, "teamSize = 2.0; valid: an integer"),
        ({"teamSize": 14}, "teamSize = 14; valid: at most 13, the free cells"),
        ({"teamSize": 4}, "team.agents: line 2: 3 agents; valid: at least teamSize = 4"),
        ({"numTasksReveal": 0}, "line 6: numTasksReveal = 0; valid: a number > 0"),
        ({"numTasksReveal": "many"}, "numTasksReveal = 'many'; valid: a number > 0"),
        ({"numTasksReveal": float("nan")}, "numTasksReveal = nan; valid: a number > 0"),
        ({"numTasksReveal": 1e300}, "numTasksReveal = 1e.300; valid: a number > 0 and <= 1000"),
        ({"numTasksReveal": 0.1}, "numTasksReveal = 0.1; valid: at least one task"),
        ({"mapFile": 3}, "line 2: mapFile = 3; valid: the path of a file"),
        ({"agentFile": "nobody.agents"}, "line 3: agentFile = 'nobody.agents'; valid: the path of a file"),
        ({"taskFile": "."}, "taskFile = '.'; valid: the path of a file"),
        ({"mapFile": "team.agents"}, "team.agents: lines 1-4 are .*; valid: 'type octile'"),
        ({"version": "2025 LoRR"}, "version = '2025 LoRR'; valid: one of '2023 LoRR', '2024 LoRR', '2026 LoRR'"),
        ({"version": 2024}, "version = 2024; valid: a text"),
        (
            {"version": "2023 LoRR", "taskAssignmentStrategy": "greedy"},
            "taskAssignmentStrategy = 'greedy'; valid: 'roundrobin'",
        ),
    ],
)
def test_a_wrong_value_is_named_by_line_and_key(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    path = write_problem(tmp_path, KEYS | change)
    with pytest.raises(MapsError, match=said) as refused:
        read_problem(path)
    assert str(tmp_path) in str(refused.value)


@pytest.mark.parametrize("key", ["mapFile", "agentFile", "teamSize", "taskFile"])
def test_a_missing_key_is_named(tmp_path: Path, key: str) -> None:
    path = write_problem(tmp_path, {name: value for name, value in KEYS.items() if name != key})
    with pytest.raises(LeagueError, match=rf"tiny\.json: {key} is missing; valid: "):
        read_problem(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{\n"teamSize": 2,\n}', "line 3, column 1: '}' is no JSON .*; valid: a JSON object"),
        ("", "column 1: '' is no JSON .*; valid: a JSON object"),
        ("[1, 2]", "line 1: list; valid: a JSON object"),
    ],
)
def test_what_is_no_problem_file_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "tiny.json"
    path.write_text(text)
    with pytest.raises(LeagueError, match=said):
        read_problem(path)


def test_a_missing_problem_is_named(tmp_path: Path) -> None:
    with pytest.raises(LeagueError, match=r"nothing\.json: cannot be read"):
        read_problem(tmp_path / "nothing.json")


@pytest.mark.parametrize(
    ("agents", "said"),
    [
        ("", "line 1: ''; valid: the number of entries"),
        ("# only\n# comments\n", "line 1: ''; valid: the number of entries"),
        ("two\n0\n3\n", "line 1: 'two'; valid: the number of entries"),
        ("2\n0\n", "ends after 1 entries; valid: 2, as it promises"),
        ("2\n0\nx\n", "line 3: 'x'; valid: a location"),
        ("2\n0\n\n3\n", "line 3: ''; valid: a location"),
        ("2\n0\n3,1\n", "line 3: 2 locations; valid: 1"),
        ("2\n0\n# here\n5\n", "line 4: location 5 is an obstacle"),
        ("2\n0\n20\n", r"line 3: location 20 is outside 0\.\.19"),
        ("2\n-1\n3\n", r"line 2: location -1 is outside 0\.\.19"),
        ("2\n0\n" + "9" * 30 + "\n", r"line 3: location 9+ is outside 0\.\.19"),
        ("2\n3\n3\n", r"line 3: location 3 is the start of robot 0 \(line 2\) too"),
    ],
)
def test_a_wrong_line_of_the_team_is_named(tmp_path: Path, agents: str, said: str) -> None:
    with pytest.raises(LeagueError, match=r"team\.agents: " + said):
        read_problem(write_problem(tmp_path, KEYS, agents=agents))


@pytest.mark.parametrize(
    ("tasks", "said"),
    [
        ("0\n", "line 1: 0 tasks; valid: at least 1"),
        ("-2\n", "line 1: -2 tasks; valid: at least 1"),
        ("2\n1,2\n", "ends after 1 entries; valid: 2"),
        ("2\n1,2\n3,,4\n", "line 3: '3,,4'; valid: locations, separated by commas"),
        ("2\n1,2\n3,12\n", "line 3: location 12 is an obstacle"),
        ("2\n1,2\n3,99\n", r"line 3: location 99 is outside 0\.\.19"),
        ("3\n1,2\n3\n2,18\n", "line 4: location 18 of task 2 cannot be reached"),
        ("3\n1,2\n3\n18\n", "line 4: location 18 of task 2 cannot be reached"),
    ],
)
def test_a_wrong_line_of_the_tasks_is_named(tmp_path: Path, tasks: str, said: str) -> None:
    with pytest.raises(LeagueError, match=r"work\.tasks: " + said):
        read_problem(write_problem(tmp_path, KEYS, tasks=tasks))


def test_a_task_beyond_a_wall_needs_a_robot_there(tmp_path: Path) -> None:
    problem = read_problem(write_problem(tmp_path, KEYS, agents="2\n0\n16\n", tasks="2\n1,2\n18,17\n"))
    assert problem.n_tasks == 2


def test_tasks_of_2023_have_one_errand(tmp_path: Path) -> None:
    with pytest.raises(LeagueError, match=r"work\.tasks: line 3: 3 locations; valid: 1"):
        read_problem(write_problem(tmp_path, KEYS | {"version": "2023 LoRR"}))


def result_of(problem: LeagueProblem) -> LeagueResult:
    return LeagueResult(
        problem=problem,
        actual=np.array([[FORWARD, WAIT], [CLOCKWISE, COUNTER_CLOCKWISE], [NO_ACTION, NO_ACTION]], dtype=np.int8),
        planned=np.array([[FORWARD, FORWARD], [CLOCKWISE, COUNTER_CLOCKWISE], [NO_ACTION] * 2], dtype=np.int8),
        planner_times_s=np.array([0.25, 0.5]),
        n_finished=1,
        makespan=3,
        n_timeouts=1,
        task_id=np.array([0, 1, 6]),
        task_release=np.array([0, 0, 2], dtype=np.int32),
        events=np.array([[1, 0, 0, 1], [2, 1, 1, 1]], dtype=np.int32),
        schedule=np.array([[1, 0, 0], [1, 1, -1], [2, 1, 1]], dtype=np.int32),
        proposed=np.array([[1, 0, 0], [1, 1, -1], [2, 1, 1], [3, 1, 9]], dtype=np.int32),
        planner_errors=((1, -1, 1, "unallowed move"),),
        schedule_errors=((9, 1, -1, 3, "task already finished"),),
    )


def test_a_result_has_the_keys_and_forms_of_the_league(tmp_path: Path) -> None:
    problem = read_problem(write_problem(tmp_path, KEYS))
    path = tmp_path / "out.json"
    write_result(path, result_of(problem))
    assert json.loads(path.read_text()) == {
        "actionModel": "MAPF_T",
        "version": "2024 LoRR",
        "teamSize": 2,
        "numTaskFinished": 1,
        "makespan": 3,
        "numPlannerErrors": 1,
        "numScheduleErrors": 1,
        "numEntryTimeouts": 1,
        "start": [[0, 0, "E"], [0, 3, "E"]],
        "actualPaths": ["F,R,T", "W,C,T"],
        "plannerPaths": ["F,R,T", "F,C,T"],
        "plannerTimes": [0.25, 0.5],
        "errors": [[1, -1, 1, "unallowed move"]],
        "actualSchedule": ["1:0", "1:-1,2:1"],
        "plannerSchedule": ["1:0", "1:-1,2:1,3:9"],
        "scheduleErrors": [[9, 1, -1, 3, "task already finished"]],
        "events": [[1, 0, 0, 1], [2, 1, 1, 1]],
        "tasks": [[0, 0, [0, 1, 0, 2, 2, 3]], [1, 0, [2, 0]], [6, 2, [2, 2, 1, 0]]],
    }


def test_the_keys_stand_in_the_order_of_the_league(tmp_path: Path) -> None:
    path = tmp_path / "out.json"
    write_result(path, result_of(read_problem(write_problem(tmp_path, KEYS))))
    keys = [key for key, _ in json.loads(path.read_text(), object_pairs_hook=list)]
    assert keys[:6] == ["actionModel", "version", "teamSize", "numTaskFinished", "makespan", "numPlannerErrors"]
    assert keys[-2:] == ["events", "tasks"]
