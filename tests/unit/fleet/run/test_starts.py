"""Starts: parking places first, then lanes, drawn from the seed alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fleet.config import RunConfig
from fleet.errors import ConfigError
from fleet.run.starts import most_cars, start_states
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import Site, load_site
from maps.waiting_cells import waiting_cells

SITE = load_site("medium")
GRAPH = build_lane_graph(SITE)


def starts(robots: int, seed: int = 0, site: Site = SITE, graph: LaneGraph = GRAPH) -> list[int]:
    return start_states(RunConfig(site=site.name, robots=robots, seed=seed), site, graph).tolist()


def test_as_many_cars_as_parking_places_begin_there_whatever_the_seed() -> None:
    parked = GRAPH.first_states(SITE.parking).tolist()
    assert starts(40) == starts(40, seed=5) == parked
    assert starts(80)[:40] == parked


def test_the_rest_begin_apart_from_each_other_in_waiting_cells() -> None:
    cells = GRAPH.state_cell[starts(100)[40:]]
    assert np.isin(cells, waiting_cells(SITE, GRAPH)).all()
    assert len(set(cells.tolist())) == 60
    row, col = SITE.grid.row_col(cells.astype(np.int64))
    gap = np.maximum(abs(row[:, None] - row), abs(col[:, None] - col)) + 9 * np.eye(60, dtype=np.int64)
    beside = (gap <= 1).any(axis=1)
    assert beside.sum() < 6  # most of 60 cars find a cell with nobody around


def test_the_seed_decides_where_on_the_lanes() -> None:
    assert starts(80, seed=3) == starts(80, seed=3)
    assert starts(80, seed=3) != starts(80, seed=4)


@pytest.mark.parametrize("name", ["cell", "small", "twin", "dense", "dense_large", "medium"])
def test_a_site_takes_the_most_cars_it_names_and_no_more(name: str) -> None:
    site = load_site(name)
    graph, most = build_lane_graph(site), most_cars(site)
    assert most > len(site.parking)
    assert len(set(graph.state_cell[starts(most, site=site, graph=graph)].tolist())) == most
    with pytest.raises(ConfigError, match=rf"--robots is {most + 1}; valid: 1 to {most} \({len(site.parking)} parking"):
        starts(most + 1, site=site, graph=graph)


def test_a_site_whose_lanes_have_little_room_to_wait_says_how_many_it_takes(tmp_path: Path) -> None:
    """It ended in an error of numpy."""
    wall, around, bay = "#" * 72, "#..." + "=" * 64 + "...#", "_..." + "=" * 64 + "..._"
    parking, aisle = "_...K" + "=" * 62 + "K..._", "AP.." + "x" * 64 + "..DA"
    lines = [wall, around, parking, aisle, bay, around, wall]
    path = tmp_path / "long.toml"
    plan = "\n".join(lines)
    path.write_text(f"name = 'long'\nallow_reverse = true\nplan = '''\n{plan}\n'''\n", encoding="utf-8")
    site = load_site(path)
    graph = build_lane_graph(site)
    room = len(site.parking) + len(waiting_cells(site, graph))
    assert room < most_cars(site), "else it shows nothing"
    with pytest.raises(ConfigError, match=rf"valid: 1 to {room} \(2 parking cells, and {room - 2} on lanes"):
        start_states(RunConfig(site=str(path), robots=most_cars(site)), site, graph)
    assert len(start_states(RunConfig(site=str(path), robots=room), site, graph)) == room
