"""FreeLanes: the lane graph of a layout on no grid.

A state is a place on a lane; lanes end before their node, where the first turn leaves them. A move leads along the lane
to the next place, or by a turn to the first one of another lane, past those in which a car would be in the way of
others. Cells are no squares here: each state has one, which a
car that stands there holds, and each pair of moves that touch each other without a state in common has one more. A move
sweeps those of all states at which a body would touch it, and those of its pairs. So planners, grants and referees
keep cars apart by cells, as on any lane graph.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise

import networkx as nx
import numpy as np
import numpy.typing as npt

from maps.free_lanes.bodies import sampled, touching
from maps.free_lanes.clear import ClearWay, clear_ways
from maps.free_lanes.lanes import LaneSet, lanes_of_layout
from maps.free_lanes.line import LaneLine, line_of_curve
from maps.lane_graph import Floats, LaneGraph, csr
from maps.layouts.layout import FloorLayout, LayoutError
from maps.vehicle import Footprint

PIECE_M = 1.0
"""Least distance from place to place on a lane [m]: two cars that stand behind each other have room."""
SPACING_M = 0.8
"""From lane to lane where edges lead both ways [m]: cars turn round at their ends in half a circle."""
BACK_STEP_M = 0.1
"""A lane ends so much earlier, as often as need be, for its cars not to stand in the way of others [m]."""
ROOM_M = 2.0
"""Free floor round all lanes [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeLanes:
    """A layout that cars can be sent over."""

    layout: FloorLayout
    """As it was read."""
    graph: LaneGraph
    """The south-west corner of its floor is at (0, 0)."""
    size_m: tuple[float, float]
    """Of the floor, along x and y."""
    corner_m: tuple[float, float]
    """Where the floor's corner is in the coordinates of the layout."""
    states_at: dict[str, tuple[int, ...]]
    """States in which a car has come to each node, or stands before it; nodes that are left out are not there."""
    path_ratio: float
    """Mean way from node to node, by that along the edges of the layout, driven either way."""
    before_m: float
    """Furthest that a car stands before a node which it has come to [m]."""
    notes: tuple[str, ...]
    """What is not as in the layout, a line each."""


def free_lanes(layout: FloorLayout, body: Footprint, *, where: str, spacing_m: float = SPACING_M) -> FreeLanes:
    """Build the lane graph of a layout.

    Args:
        layout: On one level.
        body: Of the cars.
        where: Opens every message.
        spacing_m: From lane to lane where edges lead both ways.

    Raises:
        LayoutError: See `maps.free_lanes.lanes.lanes_of_layout`; or cars would be in each other's way everywhere.
    """
    lanes = lanes_of_layout(layout, radius_m=body.turn_radius_m, spacing_m=spacing_m, where=where)
    places = _Places(lanes, body)
    places.move_back()
    return places.built(layout, where)


class _Places:
    """The states of each lane, while their number and place is being found.

    Args:
        lanes: The lanes.
        body: Of the cars.
    """

    def __init__(self, lanes: LaneSet, body: Footprint) -> None:
        self._set, self._lanes, self._body = lanes, lanes.lanes, body
        self._out_m = {name: lane.out_m for name, lane in self._lanes.items()}

    def move_back(self) -> None:
        """Let lanes end early enough for cars that wait there to be in nobody's way, as far as there is room."""
        turns = [(name, turn.line) for name, lane in self._lanes.items() for turn in lane.turns.values()]
        paths = [sampled(line.points, line.s) for _, line in turns]
        for name, lane in self._lanes.items():
            others = [path for (of, _), path in zip(turns, paths, strict=True) if of != name]
            ends = [
                (other.line, self._set.in_m[key])
                for key, other in self._lanes.items()
                if key != name and other.edge.start == lane.edge.end
            ]
            others += [
                sampled(line.points[: k + 1], line.s[: k + 1])
                for line, in_m in ends
                for k in [max(1, int(np.searchsorted(line.s, in_m)))]
            ]
            most = lane.line.length_m - self._set.in_m[name]
            out_m = self._out_m[name]
            while others and out_m <= most:
                pose = lane.line.poses(np.array([lane.line.length_m - out_m]))
                if not touching([pose, *others], self._body)[0, 1:].any():
                    self._out_m[name] = out_m
                    break
                out_m += BACK_STEP_M

    def built(self, layout: FloorLayout, where: str) -> FreeLanes:
        """The graph.

        Raises:
            LayoutError: Cars would be in each other's way everywhere.
        """
        at, poses = self._places()
        drawn = self._moves(at)
        n_places = len(poses)
        paths = [pose[None] for pose in poses] + [sampled(line.points, line.s) for _, _, line in drawn]
        touch = touching(paths, self._body)
        node_of = {states[-1]: self._lanes[name].edge.end for name, states in at.items()}
        stations = {station.node for station in layout.stations}
        kept = {place for place, node in node_of.items() if node in stations}
        ways = clear_ways([(begin, end) for begin, end, _ in drawn], touch[n_places:, :n_places], kept)
        if not nx.is_strongly_connected(nx.DiGraph([(way.begin, way.end) for way in ways] or [(0, 1)])):
            raise LayoutError(
                f"{where}: there are too few places in which a car that stands is not in the way of all others; valid: "
                f"lanes of more than {PIECE_M:g} m between their nodes"
            )
        line_of = {
            way.parts: _joined([(drawn[part][2].points, drawn[part][2].s) for part in way.parts]) for way in ways
        }
        # Of two ways from one place to another a planner knows one.
        shortest: dict[tuple[int, int], ClearWay] = {}
        for way in sorted(ways, key=lambda way: (line_of[way.parts].length_m, way.parts)):
            shortest.setdefault((way.begin, way.end), way)
        ways = [shortest[ends] for ends in sorted(shortest)]
        lines = [line_of[way.parts] for way in ways]
        corner = np.min([line.points[:, :2].min(axis=0) for line in lines], axis=0) - ROOM_M
        far = np.max([line.points[:, :2].max(axis=0) for line in lines], axis=0) + ROOM_M
        places = sorted({way.begin for way in ways})
        number = {place: state for state, place in enumerate(places)}
        graph = _graph(poses[places], ways, lines, number, touch[n_places:, n_places:], corner)
        states_at: dict[str, list[int]] = defaultdict(list)
        for place in places:
            if place in node_of:
                states_at[node_of[place]].append(number[place])
        notes = list(self._set.notes)
        passed = [node for node in dict.fromkeys(node_of.values()) if node not in states_at]
        if passed:
            notes.append(
                f"{len(passed)} nodes are only passed, the first is {passed[0]!r}: who stopped there would be in the "
                "way of others"
            )
        return FreeLanes(
            layout=layout,
            graph=graph,
            size_m=(float(far[0] - corner[0]), float(far[1] - corner[1])),
            corner_m=(float(corner[0]), float(corner[1])),
            states_at={node: tuple(states) for node, states in states_at.items()},
            path_ratio=_path_ratio(layout, graph, states_at),
            before_m=max(self._out_m.values()),
            notes=tuple(notes),
        )

    def _places(self) -> tuple[dict[str, list[int]], Floats]:
        """States of each lane, from its beginning on, and the poses of all."""
        at: dict[str, list[int]] = {}
        self._s: list[float] = []
        poses = []
        for name, lane in self._lanes.items():
            last, first = lane.line.length_m - self._out_m[name], self._set.in_m[name]
            n = max(1, int((last - first) / PIECE_M))
            at[name] = list(range(len(self._s), len(self._s) + n))
            s = np.linspace(first, last, n + 1)[1:]
            self._s += s.tolist()
            poses.append(lane.line.poses(s))
        return at, np.concatenate(poses)

    def _moves(self, at: dict[str, list[int]]) -> list[tuple[int, int, LaneLine]]:
        """From and to state of each move, and its line."""
        moves = []
        for name, lane in self._lanes.items():
            states = at[name]
            moves += [(a, b, _joined([_part(lane.line, self._s[a], self._s[b])])) for a, b in pairwise(states)]
            for into, turn in lane.turns.items():
                other, first = self._lanes[into], at[into][0]
                out_m = lane.line.length_m - turn.reach_m
                pieces = [_part(lane.line, self._s[states[-1]], out_m), (turn.line.points, turn.line.s)]
                pieces.append(_part(other.line, turn.reach_m, self._s[first]))
                moves.append((states[-1], first, _joined(pieces)))
        return moves


def _graph(
    poses: Floats,
    ways: list[ClearWay],
    lines: list[LaneLine],
    number: dict[int, int],
    touch: npt.NDArray[np.bool_],
    corner: Floats,
) -> LaneGraph:
    """The arrays of a graph.

    Args:
        poses: Of its states, shape (n_states, 3).
        ways: Its moves, by their begins.
        lines: The line of each.
        number: State of each place.
        touch: Which parts of ways touch each other, shape (n_parts, n_parts).
        corner: South-west corner of the floor.
    """
    n_states, n_cells = len(poses), len(poses)
    swept = [[number[place] for place in (way.begin, way.end, *sorted(way.beside))] for way in ways]
    of_way = np.zeros((len(ways), len(touch)))
    for k, way in enumerate(ways):
        of_way[k, list(way.parts)] = 1.0
    states_of = [set(cells) for cells in swept]
    for i, j in np.argwhere(np.triu(of_way @ touch @ of_way.T > 0, 1)).tolist():
        if states_of[i].isdisjoint(states_of[j]):
            swept[i].append(n_cells)
            swept[j].append(n_cells)
            n_cells += 1
    move_from, move_to = (
        np.array([number[end] for end in ends], dtype=np.int32)
        for ends in zip(*((way.begin, way.end) for way in ways), strict=True)
    )
    out_ptr, out_move = csr(move_from, n_states)
    in_ptr, in_move = csr(move_to, n_states)
    index = np.full((n_cells, 4), -1, dtype=np.int32)
    index[:n_states, 0] = np.arange(n_states)
    shift = np.array([*corner, 0.0])
    return LaneGraph(
        motion="free",
        n_states=n_states,
        n_cells=n_cells,
        state_cell=np.arange(n_states, dtype=np.int32),
        state_heading=np.zeros(n_states, dtype=np.int8),
        state_pose=poses - shift,
        state_index=index,
        move_from=move_from,
        move_to=move_to,
        move_kind=np.zeros(len(ways), dtype=np.int8),
        move_length=np.array([line.length_m for line in lines]),
        out_ptr=out_ptr,
        out_move=out_move,
        in_ptr=in_ptr,
        in_move=in_move,
        swept_ptr=np.cumsum([0, *map(len, swept)]).astype(np.int32),
        swept_cell=np.concatenate(swept).astype(np.int32),
        path_ptr=np.cumsum([0, *(len(line.s) for line in lines)]).astype(np.int32),
        path_points=np.concatenate([line.points for line in lines]) - shift,
        path_s=np.concatenate([line.s for line in lines]),
    )


def _part(line: LaneLine, begin_m: float, end_m: float) -> tuple[Floats, Floats]:
    """Poses of a part of a line, and their arc lengths from its beginning."""
    inside = (line.s > begin_m + 1e-6) & (line.s < end_m - 1e-6)
    s = np.concatenate(([begin_m], line.s[inside], [end_m]))
    return line.poses(s), s - begin_m


def _joined(pieces: list[tuple[Floats, Floats]]) -> LaneLine:
    """Parts of lines that follow each other as one line; empty ones are left out."""
    points: list[Floats] = []
    s: list[Floats] = []
    driven = 0.0
    for piece, along in pieces:
        if along[-1] < 1e-6:
            continue
        turned = 0.0 if not points else round((points[-1][-1, 2] - piece[0, 2]) / (2 * np.pi)) * 2 * np.pi
        first = 1 if points else 0
        points.append(piece[first:] + np.array([0.0, 0.0, turned]))
        s.append(driven + along[first:])
        driven += float(along[-1])
    return LaneLine(points=np.concatenate(points), s=np.concatenate(s))


def _path_ratio(layout: FloorLayout, graph: LaneGraph, states_at: dict[str, list[int]]) -> float:
    """Mean way between nodes by that along edges of the layout, whichever way they lead."""
    driven = nx.DiGraph()
    driven.add_weighted_edges_from(
        zip(graph.move_from.tolist(), graph.move_to.tolist(), graph.move_length.tolist(), strict=True)
    )
    nodes = {node.name: node for node in layout.nodes}
    either = nx.Graph()
    for edge in layout.edges:
        a, b = nodes[edge.start], nodes[edge.end]
        length = line_of_curve(edge.curve or (((a.x, a.y), (b.x, b.y)),)).length_m
        either.add_edge(edge.start, edge.end, weight=length)
    ways, straights = 0.0, 0.0
    for start, states in states_at.items():
        there = nx.single_source_dijkstra_path_length(either, start)
        # From where a car stands that has come by any lane, as it may be.
        lengths = [nx.single_source_dijkstra_path_length(driven, state) for state in states]
        for end, goals in states_at.items():
            if end != start:
                ways += float(np.mean([min(of[goal] for goal in goals) for of in lengths]))
                straights += there[end]
    return ways / straights if straights else 1.0
