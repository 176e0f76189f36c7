import os
from pathlib import Path

import numpy as np
import pytest

from maps.errors import SiteError
from maps.formats.movingai import MovingAiError, read_map, read_scenario, site_from_map, starts_and_goals
from maps.lane_graph import build_lane_graph
from maps.report import check_site

INSTANCES = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[5] / "shared" / "instances")) / "movingai"


def published(name):
    path = INSTANCES / name
    if not path.is_file():
        pytest.skip(f"published map {name} is not there; set FLEET_INSTANCES to the folder that holds movingai/")
    return path


@pytest.fixture
def tiny(tmp_path):
    """A 6 x 9 floor with one rack in the middle."""
    path = tmp_path / "tiny.map"
    rows = [
        "@@@@@@@@@@@",
        "@.........@",
        "@.........@",
        "@..TTTTT..@",
        "@..TTTTT..@",
        "@.........@",
        "@.........@",
        "@@@@@@@@@@@",
    ]
    path.write_text("\n".join(["type octile", f"height {len(rows)}", f"width {len(rows[0])}", "map", *rows]) + "\n")
    return path


def test_map_is_read_row_by_row(tiny):
    grid = read_map(tiny)
    assert (grid.rows, grid.cols) == (8, 11)
    assert grid.free.sum() == 6 * 9 - 10
    assert not grid.free[3, 3]


def test_scenario_swaps_columns_and_rows(tmp_path):
    path = tmp_path / "a.scen"
    path.write_text("version 1\n7\tm.map\t32\t30\t5\t16\t31\t24\t31.37\n")
    (entry,) = read_scenario(path)
    assert (entry.line, entry.bucket, entry.map_name, entry.map_size) == (2, 7, "m.map", (30, 32))
    assert (entry.start, entry.goal, entry.length) == ((16, 5), (24, 31), 31.37)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("type octile\nheight 1\n", "lines 1-4"),
        ("type octile\nheight x\nwidth 2\nmap\n..\n", "line 2 is 'height x'"),
        ("type octile\nheight 2\nwidth 2\nmap\n..\n", "1 map rows; valid: 2"),
        ("type octile\nheight 1\nwidth 3\nmap\n..\n", "line 5 has 2 cells; valid: 3"),
        ("type octile\nheight 1\nwidth 2\nmap\n.q\n", "line 5: unknown cell 'q'"),
        ("type octile\nheight 1\nheight 2\nmap\n..\n", "valid: height and width"),
    ],
)
def test_malformed_map_names_the_line(tmp_path, text, message):
    path = tmp_path / "bad.map"
    path.write_text(text)
    with pytest.raises(MovingAiError, match=message):
        read_map(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2", "line 1"),
        ("version 1\n1\t2\n", "line 2: 2 fields; valid: 9"),
        ("version 1\n1 m 3 3 a 1 1 1 1\n", "line 2: start column is 'a'; valid: a whole number"),
        ("version 1\n\n1 m 3 3 1 1 1 1.5 1\n", "line 3: goal row is '1.5'; valid: a whole number"),
        ("version 1\n1 m 3 3 1 1 1 1 far\n", "line 2: length is 'far'; valid: a number"),
    ],
)
def test_malformed_scenario_names_the_line(tmp_path, text, message):
    path = tmp_path / "bad.scen"
    path.write_text(text)
    with pytest.raises(MovingAiError, match=message):
        read_scenario(path)


def scenario(tmp_path, *entries):
    """A .scen file of entries (start column, start row, goal column, goal row) on the tiny map."""
    path = tmp_path / "tiny.scen"
    lines = ["\t".join(map(str, [0, "tiny.map", 11, 8, *entry, 1.0])) for entry in entries]
    path.write_text("\n".join(["version 1", *lines]) + "\n")
    return path


def test_starts_and_goals_are_cells(tiny, tmp_path):
    grid = read_map(tiny)
    path = scenario(tmp_path, (1, 2, 9, 6), (2, 2, 1, 2), (0, 0, 0, 0))
    starts, goals = starts_and_goals(path, grid, agents=2)
    assert (starts.tolist(), goals.tolist()) == ([23, 24], [75, 23])
    assert starts.dtype == np.int32


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ([(0, 1, 1, 1)], "line 2: start row 1, column 0 is an obstacle; valid: a free cell"),
        ([(1, 1, 2, 2), (2, 1, 3, 3)], "line 3: goal row 3, column 3 is an obstacle"),
        ([(1, 1, 11, 1)], "line 2: goal row 1, column 11 is outside the map; valid: row 0 to 7, column 0 to 10"),
        ([(1, -1, 1, 1)], "line 2: start row -1, column 1 is outside the map"),
        ([(1, 1, 2, 2), (3, 1, 4, 2), (1, 1, 5, 5)], "line 4: start row 1, column 1 is that of line 2 too"),
        ([(1, 1, 2, 2), (3, 1, 2, 2)], "line 3: goal row 2, column 2 is that of line 2 too"),
        ([(1, 1, 1, 2)] * 45, "45 agents; valid: at most 44, the map's free cells"),
    ],
)
def test_entries_that_do_not_fit_the_map_are_named_by_line(tiny, tmp_path, entries, message):
    with pytest.raises(MovingAiError, match=message):
        starts_and_goals(scenario(tmp_path, *entries), read_map(tiny))


@pytest.mark.parametrize("agents", [0, 3])
def test_more_agents_than_entries_are_refused(tiny, tmp_path, agents):
    path = scenario(tmp_path, (1, 1, 2, 2), (3, 1, 4, 2))
    with pytest.raises(MovingAiError, match=f"{agents} agents asked for; valid: 1 to 2, one per entry"):
        starts_and_goals(path, read_map(tiny), agents=agents)


def test_a_goal_beyond_a_wall_is_refused(tmp_path):
    (tmp_path / "wall.map").write_text("type octile\nheight 1\nwidth 3\nmap\n.@.\n")
    (tmp_path / "wall.scen").write_text("version 1\n0\twall.map\t3\t1\t0\t0\t2\t0\t2\n")
    with pytest.raises(MovingAiError, match="line 2: goal row 0, column 2 has no way from the start"):
        starts_and_goals(tmp_path / "wall.scen", read_map(tmp_path / "wall.map"))


def test_a_scenario_of_another_map_is_refused(tiny, tmp_path):
    path = tmp_path / "other.scen"
    path.write_text("version 1\n0\tother.map\t32\t32\t1\t1\t2\t2\t2\n")
    with pytest.raises(MovingAiError, match=r"line 2: map height and width are \(32, 32\); valid: \(8, 11\)"):
        starts_and_goals(path, read_map(tiny))


def test_missing_file_is_named(tmp_path):
    with pytest.raises(MovingAiError, match="cannot be read"):
        read_map(tmp_path / "none.map")


def test_small_floor_gets_its_stations(tiny):
    site = site_from_map(tiny, pick=1, drop=1, parking=2)
    free = read_map(tiny).free
    np.testing.assert_array_equal(site.grid.free, free)
    assert [station.name for station in site.stations] == ["pick_1", "drop_1"]
    assert len(site.parking) == 2
    pick, drop = (site.grid.row_col(station.dock.cell)[1] for station in site.stations)
    assert pick < drop
    assert site == site_from_map(tiny, pick=1, drop=1, parking=2)


def test_too_much_for_the_floor_is_refused(tiny):
    with pytest.raises(SiteError, match="valid: at most"):
        site_from_map(tiny, pick=30, drop=1, parking=2)
    with pytest.raises(SiteError, match="valid: at most"):
        site_from_map(tiny, pick=1, drop=1, parking=60)
    with pytest.raises(MovingAiError, match="pick is 0; valid: at least 1"):
        site_from_map(tiny, pick=0, drop=1, parking=2)


def test_published_warehouse():
    path = published("warehouse-10-20-10-2-1.map")
    site = site_from_map(path, pick=4, drop=4, parking=20)
    report = check_site(site)
    assert (report.rows, report.cols, report.cells) == (63, 161, 5699)
    assert (report.picks, report.drops, report.parking) == (4, 4, 20)
    assert report.warnings == ()
    assert report.path_ratio <= 1.2
    np.testing.assert_array_equal(site.grid.free, read_map(path).free)
    graph = build_lane_graph(site)
    assert all(graph.state_at(station.dock.cell, station.dock.heading) >= 0 for station in site.stations)
    assert all(station.dock.stop_offset_m == pytest.approx(0.24) for station in site.stations)


def test_published_random_map_has_dead_ends_that_are_cut():
    path = published("random-32-32-20.map")
    site = site_from_map(path, pick=2, drop=2, parking=6)
    report = check_site(site)
    assert 0 < len(report.cut_cells) < 40
    assert report.cells + len(report.cut_cells) == read_map(path).free.sum()
    assert any("cut off" in line for line in report.warnings)
    assert report.path_ratio <= 1.6


def test_published_scenario_fits_its_map():
    grid = read_map(published("random-32-32-20.map"))
    entries = read_scenario(published("random-32-32-20-random-1.scen"))
    assert len(entries) > 100
    assert all(grid.free[entry.start] and grid.free[entry.goal] for entry in entries)
    starts, goals = starts_and_goals(published("random-32-32-20-random-1.scen"), grid)
    assert len(starts) == len(goals) == len(entries)
