"""GraphML of lane graphs: out and in again without loss, for every motion model; damaged files are refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pytest

from maps.graphml import GraphmlError, read_graphml, write_graphml
from maps.grid import GridMap
from maps.lane_graph import LaneGraph, build_lane_graph, grid_lane_graph
from maps.site import Site


def graphs(site: Site) -> dict[str, LaneGraph]:
    free = np.ones((3, 4), dtype=np.bool_)
    free[1, 1] = False
    grid = GridMap(free)
    return {
        "carlike": build_lane_graph(site),
        "pebble": grid_lane_graph(grid, "pebble"),
        "rotating": grid_lane_graph(grid, "rotating"),
    }


@pytest.mark.parametrize("motion", ["carlike", "pebble", "rotating"])
def test_what_is_written_is_read_again(tmp_path: Path, cell_site: Site, motion: str) -> None:
    graph = graphs(cell_site)[motion]
    write_graphml(graph, tmp_path / "graph.graphml")
    again = read_graphml(tmp_path / "graph.graphml")
    for name, value in vars(graph).items():
        np.testing.assert_array_equal(getattr(again, name), value, err_msg=name)
        if isinstance(value, np.ndarray):
            assert getattr(again, name).dtype == value.dtype, name


def test_other_tools_can_read_it(tmp_path: Path, cell_site: Site) -> None:
    graph = build_lane_graph(cell_site)
    write_graphml(graph, tmp_path / "graph.graphml")
    found = nx.read_graphml(tmp_path / "graph.graphml")
    assert (found.number_of_nodes(), found.number_of_edges()) == (graph.n_states, graph.n_moves)
    assert nx.is_strongly_connected(found)


def drop(part: str) -> Callable[[Any], None]:
    def change(graph: Any) -> None:
        for *_, data in [*graph.nodes(data=True), *graph.edges(data=True), (graph.graph,)]:
            data.pop(part, None)

    return change


def put(part: str, value: object) -> Callable[[Any], None]:
    def change(graph: Any) -> None:
        for *_, data in [*graph.nodes(data=True), *graph.edges(data=True), (graph.graph,)]:
            if part in data:
                data[part] = value

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (drop("motion"), "graph: motion is missing"),
        (drop("heading"), "node 0: heading is missing"),
        (drop("swept"), "edge .*: swept is missing"),
        (put("cell", 10**6), "node 0: cell 1000000, must be 0"),
        (put("heading", 7), "node 0: heading is 7"),
        (put("x", "west"), "node 0: x is 'west', must be of type float"),
        (put("kind", "hop"), "edge .*: kind is 'hop'"),
        (put("move", 0), "edge .*: move 0 is the number of another edge too"),
        (put("path", "1 2 3"), "edge .*: swept or path"),
    ],
)
def test_a_damaged_file_is_named_by_element_and_field(
    tmp_path: Path, cell_site: Site, change: Callable[[Any], None], said: str
) -> None:
    file = tmp_path / "graph.graphml"
    write_graphml(build_lane_graph(cell_site), file)
    graph = nx.read_graphml(file)
    change(graph)
    nx.write_graphml(graph, file)
    with pytest.raises(GraphmlError, match=said):
        read_graphml(file)


def test_no_graphml_at_all_is_named(tmp_path: Path) -> None:
    (tmp_path / "graph.graphml").write_text("not xml")
    with pytest.raises(GraphmlError, match=r"graph\.graphml: cannot be read as GraphML"):
        read_graphml(tmp_path / "graph.graphml")
