"""Lane graphs as GraphML, the exchange format of graph tools, out and in again without loss."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

import networkx as nx
import numpy as np
import numpy.typing as npt

from maps.errors import MapsError
from maps.lane_graph import LaneGraph, MoveKind


class GraphmlError(MapsError):
    """A GraphML file is malformed or holds no lane graph; the message names file, element and field."""


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


def read_graphml(path: str | os.PathLike[str]) -> LaneGraph:
    """Read a lane graph that `write_graphml` has written, or a tool that keeps its fields.

    Raises:
        GraphmlError: The file cannot be read, a field is missing or of the wrong type, states or moves are not
            numbered from 0 on, or a cell does not exist.
    """
    try:
        found = nx.read_graphml(path)
    except (OSError, ET.ParseError, nx.NetworkXError, KeyError, ValueError) as error:
        raise GraphmlError(f"{path}: cannot be read as GraphML: {error}") from error
    motion = str(_field(f"{path}: graph", found.graph, "motion", str))
    n_cells = int(_field(f"{path}: graph", found.graph, "n_cells", int))
    n_states = found.number_of_nodes()
    cell = np.empty(n_states, dtype=np.int32)
    heading = np.empty(n_states, dtype=np.int8)
    pose = np.empty((n_states, 3))
    for name, data in found.nodes(data=True):
        where = f"{path}: node {name}"
        state = _number(where, name, n_states)
        cell[state] = _cell(where, _field(where, data, "cell", int), n_cells)
        heading[state] = _field(where, data, "heading", int)
        if not 0 <= heading[state] < 4:
            raise GraphmlError(f"{where}: heading is {heading[state]}, must be 0..3")
        pose[state] = [_field(where, data, key, float) for key in ("x", "y", "yaw")]

    n_moves = found.number_of_edges()
    ends = np.full((n_moves, 2), -1, dtype=np.int32)
    kind = np.empty(n_moves, dtype=np.int8)
    length = np.empty(n_moves)
    swept: list[list[int]] = [[] for _ in range(n_moves)]
    points: list[npt.NDArray[np.float64]] = [np.empty((0, 4))] * n_moves
    for a, b, data in found.edges(data=True):
        where = f"{path}: edge {a} -> {b}"
        move = _number(where, _field(where, data, "move", int), n_moves)
        if ends[move, 0] >= 0:
            raise GraphmlError(f"{where}: move {move} is the number of another edge too")
        ends[move] = int(a), int(b)
        name = str(_field(where, data, "kind", str)).upper()
        if name not in MoveKind.__members__:
            valid = ", ".join(member.lower() for member in MoveKind.__members__)
            raise GraphmlError(f"{where}: kind is {name.lower()!r}, must be one of {valid}")
        kind[move] = MoveKind[name]
        length[move] = _field(where, data, "length", float)
        try:
            swept[move] = [int(word) for word in str(_field(where, data, "swept", str)).split()]
            rows = str(_field(where, data, "path", str)).split(",")
            points[move] = np.array([[float(word) for word in row.split()] for row in rows]).reshape(-1, 4)
        except ValueError as error:
            raise GraphmlError(f"{where}: swept or path: {error}") from error
        for crossed in swept[move]:
            _cell(where, crossed, n_cells)
    if (np.diff(ends[:, 0]) < 0).any():
        raise GraphmlError(f"{path}: moves are not numbered by the state they leave")

    index = np.full((n_cells, 4), -1, dtype=np.int32)
    index[cell, heading] = np.arange(n_states, dtype=np.int32)
    out_ptr, out_move = _by_state(ends[:, 0], n_states)
    in_ptr, in_move = _by_state(ends[:, 1], n_states)
    path_points = np.concatenate([*points, np.empty((0, 4))])
    return LaneGraph(
        motion=motion,
        n_states=n_states,
        n_cells=n_cells,
        state_cell=cell,
        state_heading=heading,
        state_pose=pose,
        state_index=index,
        move_from=np.ascontiguousarray(ends[:, 0]),
        move_to=np.ascontiguousarray(ends[:, 1]),
        move_kind=kind,
        move_length=length,
        out_ptr=out_ptr,
        out_move=out_move,
        in_ptr=in_ptr,
        in_move=in_move,
        swept_ptr=np.cumsum([0, *map(len, swept)]).astype(np.int32),
        swept_cell=np.array([c for cells in swept for c in cells], dtype=np.int32),
        path_ptr=np.cumsum([0, *map(len, points)]).astype(np.int32),
        path_points=np.ascontiguousarray(path_points[:, :3]),
        path_s=np.ascontiguousarray(path_points[:, 3]),
    )


def _field(where: str, data: Mapping[str, Any], name: str, kind: type[Any]) -> Any:
    if name not in data:
        raise GraphmlError(f"{where}: {name} is missing")
    value = data[name]
    if kind is float and isinstance(value, int):
        value = float(value)
    if kind is str:
        value = str(value)
    if not isinstance(value, kind) or isinstance(value, bool):
        raise GraphmlError(f"{where}: {name} is {value!r}, must be of type {kind.__name__}")
    return value


def _number(where: str, value: object, count: int) -> int:
    text = str(value)
    if not text.isdigit() or int(text) >= count:
        raise GraphmlError(f"{where}: number {text!r}, must be 0..{count - 1}, each once")
    return int(text)


def _cell(where: str, value: int, n_cells: int) -> int:
    if not 0 <= value < n_cells:
        raise GraphmlError(f"{where}: cell {value}, must be 0..{n_cells - 1}")
    return value


def _by_state(key: npt.NDArray[np.int32], n: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    order = np.argsort(key, kind="stable").astype(np.int32)
    return np.concatenate(([0], np.cumsum(np.bincount(key, minlength=n)))).astype(np.int32), order
