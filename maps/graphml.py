"""Lane graphs as GraphML, the exchange format of graph tools, without loss."""

from __future__ import annotations

import os

import networkx as nx
import numpy as np

from maps.lane_graph import LaneGraph, MoveKind


def write_graphml(graph: LaneGraph, path: str | os.PathLike[str]) -> None:
    """Write a lane graph.

    Graph: motion, n_cells. Nodes are states: cell, heading, x, y [m], yaw [rad]. Edges are moves: move (its number),
    kind, length [m], swept (cells, space between), path (points ``x y yaw s``, comma between).

    Raises:
        OSError: The file cannot be written.
    """
    out: nx.DiGraph[str] = nx.DiGraph(motion=graph.motion, n_cells=graph.n_cells)
    for state in range(graph.n_states):
        x, y, yaw = graph.state_pose[state].tolist()
        out.add_node(
            str(state),
            cell=int(graph.state_cell[state]),
            heading=int(graph.state_heading[state]),
            x=x,
            y=y,
            yaw=yaw,
        )
    for move in range(graph.n_moves):
        swept = graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]].tolist()
        span = slice(int(graph.path_ptr[move]), int(graph.path_ptr[move + 1]))
        points = np.column_stack((graph.path_points[span], graph.path_s[span])).tolist()
        out.add_edge(
            str(graph.move_from[move]),
            str(graph.move_to[move]),
            move=move,
            kind=MoveKind(int(graph.move_kind[move])).name.lower(),
            length=float(graph.move_length[move]),
            swept=" ".join(map(str, swept)),
            path=",".join(" ".join(map(repr, point)) for point in points),
        )
    nx.write_graphml(out, path)
