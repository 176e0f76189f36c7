"""GraphML of lane graphs: a graph tool reads all of a graph, for every motion model."""

from __future__ import annotations

from pathlib import Path

import networkx as nx
import numpy as np
import pytest

from maps.graphml import write_graphml
from maps.grid import GridMap
from maps.lane_graph import LaneGraph, MoveKind, build_lane_graph, grid_lane_graph
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
def test_nothing_of_a_graph_is_lost(tmp_path: Path, cell_site: Site, motion: str) -> None:
    graph = graphs(cell_site)[motion]
    write_graphml(graph, tmp_path / "graph.graphml")
    found = nx.read_graphml(tmp_path / "graph.graphml")
    assert found.graph["motion"] == graph.motion
    assert found.graph["n_cells"] == graph.n_cells
    assert (found.number_of_nodes(), found.number_of_edges()) == (graph.n_states, graph.n_moves)
    for state in range(graph.n_states):
        node = found.nodes[str(state)]
        assert (node["cell"], node["heading"]) == (graph.state_cell[state], graph.state_heading[state])
        assert [node["x"], node["y"], node["yaw"]] == graph.state_pose[state].tolist()
    for begin, end, edge in found.edges(data=True):
        move = edge["move"]
        assert (int(begin), int(end)) == (graph.move_from[move], graph.move_to[move])
        assert edge["kind"] == MoveKind(int(graph.move_kind[move])).name.lower()
        assert edge["length"] == graph.move_length[move]
        swept = graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]]
        assert edge["swept"] == " ".join(map(str, swept.tolist()))
        points = [[float(word) for word in point.split()] for point in edge["path"].split(",") if point]
        span = slice(graph.path_ptr[move], graph.path_ptr[move + 1])
        assert points == np.column_stack((graph.path_points[span], graph.path_s[span])).tolist()


def test_a_tool_can_ask_it_questions(tmp_path: Path, cell_site: Site) -> None:
    write_graphml(build_lane_graph(cell_site), tmp_path / "graph.graphml")
    assert nx.is_strongly_connected(nx.read_graphml(tmp_path / "graph.graphml"))
