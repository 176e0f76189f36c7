"""Lanes of a layout: the line of each edge, and the turns from one to the next, as far as a car can drive them."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise

import networkx as nx
import numpy as np

from maps.free_lanes.dubins import dubins_legs, dubins_line
from maps.free_lanes.line import LaneLine, line_of_curve
from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutError, LayoutNode

STEP_M = 0.05
"""Distances from a node at which a turn may begin and end are tried in these steps [m]."""
FURTHEST_M = 3.0
"""At most so far from a node [m]."""
_SWING_M_PER_RAD = 1.0
"""Distance from a node that is worth a radian of swinging out before a turn [m/rad]."""
_MOST_COST_M = 5.0
"""A turn that costs more is none: it goes round nearly a whole circle [m]."""
_ROUNDING_M = 1e-9
_SHORTEST_M = 0.05
"""Shorter edges are no ways [m]."""
_OFF_NODE_M = 0.05
"""So far beside its nodes a curve may begin and end [m]."""
_TIGHT = 0.95
"""A bend may have this part of the least radius: lines are made of points."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneTurn:
    """The way from one lane into another."""

    into: str
    """Name of the lane that it leads into."""
    reach_m: float
    """It leaves the one lane so far before its end, and comes so far behind the beginning into the other [m]."""
    line: LaneLine


@dataclass(kw_only=True, eq=False)
class Lane:
    """An edge as a car drives it."""

    edge: LayoutEdge
    line: LaneLine
    turns: dict[str, LaneTurn] = field(default_factory=dict)
    """By the name of the lane that it leads into."""

    @property
    def name(self) -> str:
        """That of the edge."""
        return self.edge.name

    @property
    def out_m(self) -> float:
        """How far before its end the first turn leaves it [m]."""
        return max((turn.reach_m for turn in self.turns.values()), default=0.0)


@dataclass(frozen=True, kw_only=True)
class LaneSet:
    """The lanes between which cars can drive for ever."""

    lanes: dict[str, Lane]
    in_m: dict[str, float]
    """How far behind its beginning the last turn has come into each lane [m]."""
    notes: tuple[str, ...]
    """What is not as in the layout, a line each."""


def lanes_of_layout(layout: FloorLayout, *, radius_m: float, spacing_m: float, where: str) -> LaneSet:
    """Find the lanes of a layout.

    Where edges lead both ways between two nodes, cars keep right: each way is moved to the right by half the spacing. A
    turn is a Dubins curve between two lanes, as near to their node as it can be without swinging out. Cars turn round
    only where no other way leads on. Ways on which vehicles reverse are left out.

    Args:
        layout: On one level.
        radius_m: Least radius of a bend.
        spacing_m: From lane to lane where edges lead both ways.
        where: Opens every message.

    Raises:
        LayoutError: A curve is too tight, or a station, or all, is left out since no way leads on from there or back.
    """
    drawn = _drawn(layout, radius_m, spacing_m, where)
    _add_turns(drawn, radius_m)
    n_turns = sum(len(lane.turns) for lane in drawn.values())
    _drop_crowded(drawn)
    n_crowded = n_turns - sum(len(lane.turns) for lane in drawn.values())
    lanes = _for_ever(drawn)
    served = {lane.edge.end for lane in lanes.values()}
    for station in layout.stations:
        if station.node not in served:
            raise LayoutError(
                f"{where}: station {station.name!r} at node {station.node!r} is on no way that leads on and comes back "
                f"with bends of {radius_m:g} m; valid: nodes that lanes lead to and away from"
            )
    if not lanes:
        raise LayoutError(
            f"{where}: no way comes back to where it began, with bends of {radius_m:g} m; valid: lanes that go round"
        )
    notes = []
    both = sum(_twin(lane.edge, drawn) is not None for lane in drawn.values()) // 2
    if both:
        notes.append(f"{both} edges lead both ways: cars keep right, {spacing_m / 2:g} m beside them")
    if n_crowded:
        notes.append(f"{n_crowded} turns are left out: lanes are too short for bends of {radius_m:g} m")
    left = [node.name for node in layout.nodes if node.name not in served]
    if left:
        notes.append(f"{len(left)} nodes are left out, the first is {left[0]!r}: no way leads there and on")
    n_back = sum(edge.backwards for edge in layout.edges)
    if n_back:
        notes.append(f"{n_back} ways are left out, on which vehicles reverse")
    return LaneSet(lanes=lanes, in_m={name: _in_m(lanes, name) for name in lanes}, notes=tuple(notes))


def _drawn(layout: FloorLayout, radius_m: float, spacing_m: float, where: str) -> dict[str, Lane]:
    """The line of each edge, to the right of it if another one leads back."""
    nodes = {node.name: node for node in layout.nodes}
    ways = {(edge.start, edge.end) for edge in layout.edges if not edge.backwards}
    lanes = {}
    for edge in layout.edges:
        start, end = nodes[edge.start], nodes[edge.end]
        if edge.backwards:
            continue
        line = _centre(edge, start, end, where)
        line = line.beside(spacing_m / 2 if (edge.end, edge.start) in ways else 0.0)
        if line.radius_m < _TIGHT * radius_m:
            raise LayoutError(
                f"{where}: edge {edge.name!r} bends with a radius of {line.radius_m:.2f} m; valid: at least "
                f"{radius_m:g} m for these cars"
            )
        lanes[edge.name] = Lane(edge=edge, line=line)
    return lanes


def _centre(edge: LayoutEdge, start: LayoutNode, end: LayoutNode, where: str) -> LaneLine:
    ends = (start.x, start.y), (end.x, end.y)
    drawn = edge.curve or (ends,)
    if sum(math.dist(*pair) for piece in drawn for pair in pairwise(piece)) < _SHORTEST_M:
        raise LayoutError(
            f"{where}: edge {edge.name!r} leads from {edge.start!r} to {edge.end!r} at the same place; valid: edges of "
            f"at least {_SHORTEST_M:g} m"
        )
    line = line_of_curve(drawn)
    for what, node, at in (("begins", start, line.points[0]), ("ends", end, line.points[-1])):
        off_m = math.dist((node.x, node.y), at[:2].tolist())
        if off_m > _OFF_NODE_M:
            raise LayoutError(
                f"{where}: the curve of edge {edge.name!r} {what} {off_m:.2f} m beside node {node.name!r}; valid: at "
                f"most {_OFF_NODE_M:g} m"
            )
    return line


def _twin(edge: LayoutEdge, lanes: dict[str, Lane]) -> str | None:
    """The lane that leads back beside an edge."""
    for name, lane in lanes.items():
        if (lane.edge.start, lane.edge.end) == (edge.end, edge.start):
            return name
    return None


def _add_turns(lanes: dict[str, Lane], radius_m: float) -> None:
    """Turns at all nodes."""
    leaving = defaultdict(list)
    for lane in lanes.values():
        leaving[lane.edge.start].append(lane)
    for lane in lanes.values():
        onward = [other for other in leaving[lane.edge.end] if other.edge.end != lane.edge.start]
        for other in onward or leaving[lane.edge.end]:
            turn = _turn(lane, other, radius_m)
            if turn is not None:
                lane.turns[other.name] = turn


def _turn(lane: Lane, other: Lane, radius_m: float) -> LaneTurn | None:
    """The turn that is as near to the node as it can be without swinging out much."""
    most = min(FURTHEST_M, lane.line.length_m, other.line.length_m)
    least, found = math.inf, None
    for reach in np.arange(0.0, most + _ROUNDING_M, STEP_M).tolist():
        if reach > least:
            break  # no swing is less than none
        ends = lane.line.pose(lane.line.length_m - reach), other.line.pose(reach)
        turned = sum(length for side, length in dubins_legs(*ends, radius_m) if side)
        cost = reach + _SWING_M_PER_RAD * (turned - abs(math.remainder(ends[1][2] - ends[0][2], math.tau)))
        if cost < least - _ROUNDING_M:
            least, found = cost, (reach, ends)
    if found is None or least > _MOST_COST_M:
        return None
    reach, ends = found
    return LaneTurn(into=other.name, reach_m=reach, line=dubins_line(*ends, radius_m))


def _in_m(lanes: dict[str, Lane], name: str) -> float:
    return max((lane.turns[name].reach_m for lane in lanes.values() if name in lane.turns), default=0.0)


def _drop_crowded(lanes: dict[str, Lane]) -> None:
    """Leave out turns that a lane has no room for, beginning with those that need most, until all others fit."""
    while True:
        crowded = [name for name, lane in lanes.items() if _in_m(lanes, name) + lane.out_m > lane.line.length_m + 1e-6]
        if not crowded:
            return
        name = crowded[0]
        turns = [
            (turn.reach_m, of.name, into)
            for of in lanes.values()
            for into, turn in of.turns.items()
            if name in (of.name, into)
        ]
        _, of_name, into = max(turns)
        del lanes[of_name].turns[into]


def _for_ever(lanes: dict[str, Lane]) -> dict[str, Lane]:
    """The largest set of lanes of which each leads to each other one, and the turns between them."""
    graph = nx.DiGraph([(name, into) for name, lane in lanes.items() for into in lane.turns])
    parts = [part for part in nx.strongly_connected_components(graph) if graph.subgraph(part).number_of_edges()]
    if not parts:
        return {}
    kept = max(parts, key=lambda part: (len(part), min(part)))
    return {
        name: Lane(
            edge=lane.edge,
            line=lane.line,
            turns={into: turn for into, turn in lane.turns.items() if into in kept},
        )
        for name, lane in lanes.items()
        if name in kept
    }
