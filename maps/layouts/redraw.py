"""Redraw: a layout on no grid becomes one on a grid, with the same nodes and what leads where, but not the same ways.

Nodes move to the nearest cell. Edges are then led through free cells one by one, short ones first. What leads to the
same node may join on its way, and what comes from the same node may part later: neither adds a way that was not there.
Ways that cannot but cross do so at right angles; cars may turn there, too.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutError, LayoutNode, LayoutStation

Cell = tuple[int, int]
"""Column, and row counted upwards."""

SCALES = (1, 2, 3, 5)
"""How many times as large as the layout the floor may get, if there is no room for its ways."""
_ROOM = 4
"""Free cells round all nodes."""
_AWAY = 0.2
"""Cost of a cell for each cell of distance from the straight way, beside 1 for itself."""
_BEND = 0.3
_CROSSING = 6.0
_STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
_MOST_CELLS = 400_000


@dataclass(frozen=True, kw_only=True)
class Redrawn:
    """A layout on a grid."""

    layout: FloorLayout
    scale: int
    """The floor is so many times as large as before."""
    length_ratio: float
    """Mean length of an edge, by that of the straight line between its nodes."""
    n_crossings: int
    """Cells in which ways cross that have no node in common."""

    def notes(self) -> list[str]:
        """What is not as in the layout, a line each."""
        found = [f"ways were drawn anew, {self.length_ratio:.2f} times as long as straight ones"]
        if self.scale > 1:
            found.append(f"the floor is {self.scale} times as large as that of the file")
        if self.n_crossings:
            found.append(f"ways cross in {self.n_crossings} cells, where cars may turn, too")
        return found


def redrawn(layout: FloorLayout, where: str) -> Redrawn:
    """Draw a layout anew on cells of 1 m; ways on which vehicles reverse are left out.

    Where edges lead both ways between two nodes, each way gets cells of its own.

    Args:
        layout: On one level.
        where: Opens every message.

    Raises:
        LayoutError: An edge finds no way.
    """
    onward = replace(layout, edges=tuple(edge for edge in layout.edges if not edge.backwards))
    without_way = ""
    for scale in SCALES:
        drawing = _Drawing(onward, scale, where)
        failed = drawing.lead_all()
        if failed is None:
            return drawing.result()
        without_way = without_way or failed.name
    raise LayoutError(
        f"{where}: no way was found for edge {without_way!r} between those of the others, on a floor of up to "
        f"{SCALES[-1]} times the size; valid: layouts whose ways cross at nodes only"
    )


class _Drawing:
    """Cells and what uses them.

    Args:
        layout: The layout.
        scale: How many times as large the floor is.
        where: Opens every message.
    """

    def __init__(self, layout: FloorLayout, scale: int, where: str) -> None:
        self._layout, self._scale = layout, scale
        left, below = (min(getattr(node, axis) for node in layout.nodes) for axis in "xy")
        self._nodes = {node.name: node for node in layout.nodes}
        self._at: dict[str, Cell] = {}
        self._kept: set[Cell] = set()
        """Where arms will stand."""
        taken: set[Cell] = set()
        for node in layout.nodes:
            wanted = ((node.x - left) * scale + _ROOM, (node.y - below) * scale + _ROOM)
            cell = next(cell for cell in _around(wanted) if cell not in taken)
            self._at[node.name] = cell
            taken.add(cell)
        self.cols, self.rows = (max(cell[axis] for cell in taken) + _ROOM + 1 for axis in (0, 1))
        if self.cols * self.rows > _MOST_CELLS:
            raise LayoutError(f"{where}: {self.cols} x {self.rows} cells; valid: {_MOST_CELLS} in all, metres as units")
        self._sides = {station.node: self._side_of(station) for station in layout.stations}
        for name, (right, up) in self._sides.items():
            col, row = self._at[name]
            # The arm, and its slots to both sides of it.
            self._kept |= {(col + right + k * up, row + up + k * right) for k in (-1, 0, 1)}
        self._kept -= taken
        self._docks = {self._at[name]: side for name, side in self._sides.items()}
        """The side of the arm of each dock."""
        self._sources: dict[Cell, set[str]] = defaultdict(set)
        self._targets: dict[Cell, set[str]] = defaultdict(set)
        self._across: dict[Cell, set[int]] = defaultdict(set)
        """Axes along which ways go straight through a cell; -1 for one that bends there."""
        self._lanes: set[tuple[Cell, Cell]] = set()
        self._ways: dict[str, list[Cell]] = {}

    def _side_of(self, station: LayoutStation) -> Cell:
        """The step to where an arm will stand: on the side on which the layout has the station, away from ways."""
        node = self._nodes[station.node]
        off = (0.0 if station.x is None else station.x - node.x), (0.0 if station.y is None else station.y - node.y)
        ways = []
        for edge in self._layout.edges:
            for end, other in ((edge.start, edge.end), (edge.end, edge.start)):
                if end == station.node:
                    ways.append((self._nodes[other].x - node.x, self._nodes[other].y - node.y))

        def along(step: Cell, way: tuple[float, float]) -> float:
            length = math.hypot(*way)
            return (step[0] * way[0] + step[1] * way[1]) / length if length else 0.0

        return max(
            _STEPS, key=lambda step: along(step, off) - 0.5 * max((along(step, way) for way in ways), default=0.0)
        )

    def lead_all(self) -> LayoutEdge | None:
        """Find a way for each edge; returns the first that has none."""
        led: dict[tuple[str, str], list[Cell]] = {}
        for edge in sorted(self._layout.edges, key=self._length):
            way = led.get((edge.start, edge.end)) or self._way(edge)
            if not way:
                return edge
            led[edge.start, edge.end] = self._ways[edge.name] = way
            for cell in way[1:-1]:
                self._sources[cell].add(edge.start)
                self._targets[cell].add(edge.end)
            self._lanes.update(pairwise(way))
            for before, cell, after in zip(way, way[1:], way[2:], strict=False):
                bends = _step(before, cell) != _step(cell, after)
                self._across[cell].add(-1 if bends else _STEPS.index(_step(before, cell)) % 2)
        return None

    def result(self) -> Redrawn:
        """The layout with a node for each cell of a way."""
        nodes = {
            cell: LayoutNode(
                name=name,
                x=cell[0] + 0.5,
                y=cell[1] + 0.5,
                parking=self._nodes[name].parking,
                charger=self._nodes[name].charger,
            )
            for name, cell in self._at.items()
        }
        edges: dict[tuple[Cell, Cell], LayoutEdge] = {}
        for edge in self._layout.edges:
            for k, (cell, other) in enumerate(pairwise(self._ways[edge.name])):
                if other not in nodes:
                    nodes[other] = LayoutNode(name=f"{edge.name} {k + 1}", x=other[0] + 0.5, y=other[1] + 0.5)
                step = LayoutEdge(name=f"{edge.name} from {k}", start=nodes[cell].name, end=nodes[other].name)
                edges.setdefault((cell, other), step)
        straight = sum(map(self._length, self._layout.edges)) * self._scale
        layout = replace(
            self._layout,
            nodes=tuple(nodes.values()),
            edges=tuple(edges.values()),
            stations=tuple(self._moved_stations()),
        )
        ratio = sum(len(way) - 1 for way in self._ways.values()) / straight if straight else 1.0
        n_crossings = sum(axes == {0, 1} for axes in self._across.values())
        return Redrawn(layout=layout, scale=self._scale, length_ratio=ratio, n_crossings=n_crossings)

    def _moved_stations(self) -> Iterator[LayoutStation]:
        for station in self._layout.stations:
            (col, row), (right, up) = self._at[station.node], self._sides[station.node]
            yield replace(station, x=col + 0.5 + right, y=row + 0.5 + up, yaw=None)

    def _length(self, edge: LayoutEdge) -> float:
        start, end = self._nodes[edge.start], self._nodes[edge.end]
        return math.dist((start.x, start.y), (end.x, end.y))

    def _ends(self, edge: LayoutEdge) -> tuple[dict[Cell, list[Cell]], dict[Cell, list[Cell]]]:
        """Cells at which a way may begin, with what leads there, and those at which it may end, with what follows.

        A way may part from others that come from the same node, and join those that lead to the same node.
        """
        start, end = self._at[edge.start], self._at[edge.end]
        roots, leaves = {start: [start]}, {end: [end]}
        for other in self._layout.edges:
            way = self._ways.get(other.name, [])
            for k, cell in enumerate(way[1:-1], start=1):
                if other.start == edge.start and self._sources[cell] == {edge.start}:
                    roots.setdefault(cell, way[: k + 1])
                if other.end == edge.end and self._targets[cell] == {edge.end}:
                    leaves.setdefault(cell, way[k:])
        if end in self._docks and len(leaves) > 1:
            del leaves[end]  # a dock has one way in
        return roots, leaves

    def _way(self, edge: LayoutEdge) -> list[Cell]:
        """The cheapest way through free cells; empty if there is none."""
        start, end = self._at[edge.start], self._at[edge.end]
        roots, leaves = self._ends(edge)
        blocked = self._kept | set(self._at.values()) | {cell for cell in self._sources if self._sources[cell]}
        queue: list[tuple[float, Cell, int]] = []
        cost: dict[tuple[Cell, int], float] = {}
        came: dict[tuple[Cell, int], tuple[Cell, int]] = {}
        jumped: dict[tuple[Cell, int], tuple[Cell, ...]] = {}
        for cell, prefix in roots.items():
            heading = -1 if len(prefix) < 2 else _STEPS.index(_step(prefix[-2], prefix[-1]))
            cost[cell, heading] = 0.0
            heapq.heappush(queue, (0.0, cell, heading))
        while queue:
            spent, cell, heading = heapq.heappop(queue)
            if spent > cost[cell, heading]:
                continue
            if cell in leaves and (cell, heading) in came:
                found = [cell]
                at = cell, heading
                while at in came:
                    found += jumped[at][::-1]
                    at = came[at]
                    found.append(at[0])
                return roots[found[-1]][:-1] + found[::-1] + leaves[cell][1:]
            for turn, step in enumerate(_STEPS):
                to = cell[0] + step[0], cell[1] + step[1]
                if heading >= 0 and turn == (heading + 2) % 4:
                    continue
                over: tuple[Cell, ...] = ()
                while to in blocked and to not in leaves and self._across.get(to) == {1 - turn % 2}:
                    over, to = (*over, to), (to[0] + step[0], to[1] + step[1])
                if not (0 < to[0] < self.cols - 1 and 0 < to[1] < self.rows - 1) or (
                    to in blocked and to not in leaves
                ):
                    continue
                if to in self._docks and turn % 2 == _STEPS.index(self._docks[to]) % 2:
                    continue  # a car would come in with its nose to the arm, or its tail
                if any(lane[::-1] in self._lanes for lane in pairwise((cell, *over, to))):
                    continue
                bend = _BEND if heading >= 0 and turn != heading else 0.0
                price = spent + 1.0 + _AWAY * _beside(to, start, end) + bend + _CROSSING * len(over)
                if price < cost.get((to, turn), math.inf):
                    cost[to, turn] = price
                    came[to, turn] = cell, heading
                    jumped[to, turn] = over
                    heapq.heappush(queue, (price, to, turn))
        return []


def _around(place: tuple[float, float]) -> Iterator[Cell]:
    """Cells from the one that holds a place outwards."""
    col, row = math.floor(place[0]), math.floor(place[1])
    reach = 0
    while True:
        ring = [(col + i, row + j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)]
        yield from sorted(
            (cell for cell in ring if max(abs(cell[0] - col), abs(cell[1] - row)) == reach),
            key=lambda cell: math.dist((cell[0] + 0.5, cell[1] + 0.5), place),
        )
        reach += 1


def _step(cell: Cell, other: Cell) -> Cell:
    return other[0] - cell[0], other[1] - cell[1]


def _beside(cell: Cell, start: Cell, end: Cell) -> float:
    """Distance of a cell from the line between two others."""
    along = _step(start, end)
    length = math.hypot(*along)
    if not length:
        return 0.0
    off = _step(start, cell)
    part = min(max((off[0] * along[0] + off[1] * along[1]) / length**2, 0.0), 1.0)
    return math.dist(off, (part * along[0], part * along[1]))
