import os
from pathlib import Path

import numpy as np
import pytest

from maps.errors import SiteError
from maps.lane_graph import build_lane_graph
from maps.movingai import MovingAiError, read_map, read_scenario, site_from_map
from maps.report import check_site

INSTANCES = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[4] / "shared" / "instances")) / "movingai"


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
    assert (entry.bucket, entry.map_name, entry.start, entry.goal, entry.length) == (
        7,
        "m.map",
        (16, 5),
        (24, 31),
        31.37,
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("type octile\nheight 1\n", "lines 1-4"),
        ("type octile\nheight x\nwidth 2\nmap\n..\n", "line 2 is 'height x'"),
        ("type octile\nheight 2\nwidth 2\nmap\n..\n", "1 map rows, must be 2"),
        ("type octile\nheight 1\nwidth 3\nmap\n..\n", "line 5 has 2 cells, must have 3"),
        ("type octile\nheight 1\nwidth 2\nmap\n.q\n", "line 5: unknown cell 'q'"),
        ("type octile\nheight 1\nheight 2\nmap\n..\n", "both height and width"),
    ],
)
def test_malformed_map_names_the_line(tmp_path, text, message):
    path = tmp_path / "bad.map"
    path.write_text(text)
    with pytest.raises(MovingAiError, match=message):
        read_map(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [("1 2", "line 1"), ("version 1\n1\t2\n", "line 2: 2 fields"), ("version 1\n1 m 3 3 a 1 1 1 1\n", "line 2")],
)
def test_malformed_scenario_names_the_line(tmp_path, text, message):
    path = tmp_path / "bad.scen"
    path.write_text(text)
    with pytest.raises(MovingAiError, match=message):
        read_scenario(path)


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
    with pytest.raises(SiteError, match="only"):
        site_from_map(tiny, pick=30, drop=1, parking=2)
    with pytest.raises(SiteError, match="only"):
        site_from_map(tiny, pick=1, drop=1, parking=60)
    with pytest.raises(MovingAiError, match="pick is 0, must be at least 1"):
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
