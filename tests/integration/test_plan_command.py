"""`fleet plan`, from a map and a scenario to a path file, and whatever a user gets wrong."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from fleet.cli.main import main
from maps.formats.movingai import read_map, starts_and_goals
from maps.formats.smart import read_paths
from planners.mapf import ONE_SHOT_PLANNERS

FLOOR = ["......", ".@@.@.", "......", ".@.@@.", "......"]
ENTRIES = [(0, 0, 5, 4), (5, 4, 0, 0), (0, 4, 5, 0), (3, 2, 2, 2)]


@pytest.fixture
def floor(tmp_path: Path) -> Path:
    """A 5 x 6 floor with a few obstacles; more files go into the same folder."""
    return map_of(tmp_path, FLOOR)


def map_of(folder: Path, rows: Sequence[str]) -> Path:
    path = folder / "floor.map"
    path.write_text("\n".join(["type octile", f"height {len(rows)}", f"width {len(rows[0])}", "map", *rows, ""]))
    return path


def scenario_of(
    folder: Path, entries: Sequence[tuple[int, int, int, int]] = ENTRIES, *, width: int = 6, height: int = 5
) -> Path:
    """Entries are start column, start row, goal column, goal row."""
    path = folder / "floor.scen"
    lines = ["\t".join(map(str, (0, "floor.map", width, height, *entry, 1.0))) for entry in entries]
    path.write_text("\n".join(["version 1", *lines, ""]))
    return path


def plan(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main(["plan", *words])
    said = capsys.readouterr()
    assert isinstance(stop.value.code, int)
    return stop.value.code, said.out, said.err


@pytest.mark.parametrize("planner", ONE_SHOT_PLANNERS)
@pytest.mark.parametrize("motion", ["pebble", "rotating"])
def test_robots_get_from_their_starts_to_their_goals(
    planner: str, motion: str, floor: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scen, out = scenario_of(tmp_path), tmp_path / "paths.txt"
    before = floor.read_bytes(), scen.read_bytes()
    words = ["--map", str(floor), "--scen", str(scen), "--agents", "3", "--planner", planner, "--motion", motion]
    code, said, complaint = plan([*words, "--no-rings", "--budget-s", "1", "--output", str(out)], capsys)
    assert (code, complaint) == (0, "")
    figures = [[cell.strip() for cell in line.split("│")[1:3]] for line in said.splitlines() if "│" in line]
    table = {name: value for name, value in figures}
    assert table["status"] == ("optimal" if planner == "cbs" else table["status"])
    assert (table["robots at their goals"], table["referee"]) == ("3 of 3", "legal")
    paths = read_paths(out)
    assert len(paths) - 1 <= int(table["makespan"].split()[0])  # a turn at the goal is not seen in cells
    grid = read_map(floor)
    starts, goals = starts_and_goals(scen, grid, agents=3)
    for cells, row in ((starts, paths[0]), (goals, paths[-1])):
        np.testing.assert_array_equal(grid.index(row[:, 0], row[:, 1]), cells)
    assert (floor.read_bytes(), scen.read_bytes()) == before


@pytest.mark.parametrize("planner", ONE_SHOT_PLANNERS)
def test_a_problem_without_a_solution_leaves_a_legal_beginning(
    planner: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two robots face each other in a corridor."""
    corridor, out = map_of(tmp_path, ["...."]), tmp_path / "paths.txt"
    scen = scenario_of(tmp_path, [(0, 0, 3, 0), (3, 0, 0, 0)], width=4, height=1)
    words = ["--map", str(corridor), "--scen", str(scen), "--planner", planner, "--budget-s", "0.3"]
    code, said, complaint = plan([*words, "--output", str(out)], capsys)
    assert (code, complaint) == (1, "")
    assert "timeout" in said or "infeasible" in said
    assert "legal beginning" in said
    assert read_paths(out)[0].tolist() == [[0, 0], [0, 3]]


def test_a_plan_of_another_planner_is_checked_and_improved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two robots pass each other in the open; the second one has waited for no reason."""
    floor, given, out = map_of(tmp_path, ["...", "..."]), tmp_path / "given.txt", tmp_path / "paths.txt"
    scen = scenario_of(tmp_path, [(0, 0, 2, 0), (2, 1, 0, 1)], width=3, height=2)
    words = ["--map", str(floor), "--scen", str(scen), "--budget-s", "0.3", "--begin-with", str(given)]
    waits = "Agent 1:(2,1,0)->(1,1,5)->(0,1,6)->\n"
    given.write_text("Agent 0:(0,0,0)->(1,0,1)->(2,0,2)->\n" + waits)
    code, said, _ = plan([*words, "--output", str(out)], capsys)
    assert (code, read_paths(out).shape) == (0, (3, 2, 2))
    assert "optimal" in said
    wrong = {
        "Agent 0:(0,0,0)->(1,0,1)->(2,0,2)->\n": "paths of 1 robots",
        "Agent 0:(0,0,0)->(1,0,1)->\nAgent 1:(2,1,0)->(2,0,1)->(1,0,2)->\n": "vertex conflict of robots 0, 1",
        "Agent 0:(1,0,0)->(2,0,1)->\n" + waits: "start conflict of robots 0",
        "Agent 0:(0,0,0)->(0,-1,1)->\n" + waits: "leaves the map",
    }
    for text, expected in wrong.items():
        given.write_text(text)
        code, _, complaint = plan([*words, "--output", str(out)], capsys)
        assert code == 2
        assert expected in complaint
        assert len(complaint.splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--begin-with", "FOLDER/none.txt"], ["none.txt", "cannot be read"]),
        (
            ["--begin-with", "FOLDER/x.txt", "--motion", "rotating"],
            ["--motion is 'rotating'", "pebble with --begin-with"],
        ),
        (["--planner", "pibt"], ["--planner is 'pibt'", "lacam, sipp, cbs"]),
        (["--agents", "0"], ["--agents is 0", "an integer >= 1"]),
        (["--agents", "5"], ["floor.scen", "5 agents asked for", "1 to 4"]),
        (["--agents", "two"], ["--agents is 'two'", "an integer"]),
        (["--budget-s", "0"], ["--budget-s is 0.0", "a number > 0"]),
        (["--budget-s", "-1"], ["--budget-s is -1.0", "a number > 0"]),
        (["--budget-s", "inf"], ["--budget-s is inf", "a number > 0"]),
        (["--seed", "-1"], ["--seed is -1", "an integer >= 0"]),
        (["--motion", "carlike"], ["--motion is 'carlike'", "pebble, rotating"]),
        (["--map", "FOLDER/nope.map"], ["nope.map", "No such file"]),
        (["--scen", "FOLDER/nope.scen"], ["nope.scen", "No such file"]),
        (["--output", "FOLDER/nowhere/paths.txt"], ["nowhere/paths.txt", "No such file"]),
        (["--output", "FOLDER"], ["Is a directory"]),
        (["--output", "FOLDER/floor.map"], ["--output", "floor.map", "another file than --map"]),
        (["--output", "FOLDER/floor.scen"], ["--output", "floor.scen", "another file than --scen"]),
    ],
    ids=lambda value: " ".join(value) if value[0].startswith("--") else "",
)
def test_wrong_options(
    words: list[str], expected: list[str], floor: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scen = scenario_of(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    given = ["--map", str(floor), "--scen", str(scen), "--output", str(tmp_path / "paths.txt")]
    code, said, complaint = plan([*given, *(word.replace("FOLDER", str(tmp_path)) for word in words)], capsys)
    assert (code, said, complaint.count("\n")) == (2, "", 1)
    for word in expected:
        assert word in complaint
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ([(0, 0, 1, 1)], ["line 2", "goal row 1, column 1", "obstacle"]),
        ([(1, 1, 0, 0)], ["line 2", "start row 1, column 1", "obstacle"]),
        ([(0, 0, 1, 0), (0, 0, 2, 0)], ["line 3", "start row 0, column 0", "line 2 too"]),
        ([(0, 0, 2, 0), (1, 0, 2, 0)], ["line 3", "goal row 0, column 2", "line 2 too"]),
        ([(0, 0, 9, 0)], ["line 2", "goal row 0, column 9", "outside"]),
        ([], ["no entries"]),
    ],
    ids=["goal on obstacle", "start on obstacle", "one start for two", "one goal for two", "outside", "empty"],
)
def test_wrong_scenarios_are_named_by_line(
    entries: list[tuple[int, int, int, int]],
    expected: list[str],
    floor: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    scen, out = scenario_of(tmp_path, entries), tmp_path / "paths.txt"
    code, said, complaint = plan(["--map", str(floor), "--scen", str(scen), "--output", str(out)], capsys)
    assert (code, said, complaint.count("\n")) == (2, "", 1)
    for word in ("floor.scen", *expected):
        assert word in complaint
    assert not out.exists()


@pytest.mark.parametrize("missing", ["--map", "--scen"])
def test_what_is_missing_is_named(missing: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = {"--map": "floor.map", "--scen": "floor.scen"}
    del words[missing]
    code, said, complaint = plan([word for pair in words.items() for word in pair], capsys)
    assert (code, said) == (2, "")
    assert f"{missing} is missing; valid: {missing} PATH" in complaint


def test_settings_and_a_planner_of_one_s_own(floor: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--map", str(floor), "--scen", str(scenario_of(tmp_path)), "--agents", "2", "--budget-s", "1"]
    words += ["--output", str(tmp_path / "paths.txt")]
    code, said, _ = plan([*words, "--planner", "sipp", "--planner-setting", "orders=3"], capsys)
    assert (code, "legal" in said) == (0, True)
    code, said, _ = plan([*words, "--planner", "planners.mapf.sipp.sipp.Sipp", "--planner-setting", "orders=3"], capsys)
    assert (code, "legal" in said) == (0, True)
    for planner, wrong in (
        ("sipp", "setting 'nodes' of planner 'sipp' is unknown (did you mean orders?); valid: orders"),
        ("tests.unit.planners.own_members.ListPlanner", "this planner has no settings"),
        ("nope", "--planner is 'nope'; valid: lacam, sipp, cbs or package.module.Class"),
    ):
        code, said, complaint = plan([*words, "--planner", planner, "--planner-setting", "nodes=3"], capsys)
        assert (code, said, complaint.count("\n")) == (2, "", 1)
        assert wrong in complaint
    code, said, complaint = plan([*words, "--planner", "tests.unit.planners.own_members.ListPlanner"], capsys)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "its answer is of type list; valid: a Plan" in complaint
