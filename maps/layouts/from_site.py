"""FromSite: a site as a layout, with a node for each state of its lane graph or for each of its cells."""

from __future__ import annotations

import math
from collections.abc import Iterable

from maps.grid import HEADING_NAMES
from maps.lane_graph import LaneGraph, MoveKind, build_lane_graph
from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutNode, LayoutStation, Point
from maps.site import Site
from maps.vehicle import TURN_RADIUS_M


def layout_of_states(site: Site) -> FloorLayout:
    """A site with a node for each way to stand in a cell, and an edge for each move with its true curve.

    Args:
        site: The site.
    """
    graph = build_lane_graph(site)
    cells, names = graph.state_cell.tolist(), state_names(site, graph)
    parking, chargers = set(site.parking), set(site.chargers)
    nodes = tuple(
        LayoutNode(
            name=name,
            x=round(x, 9),
            y=round(y, 9),
            yaw=math.remainder(yaw, math.tau),
            parking=cell in parking,
            charger=cell in chargers,
        )
        for name, cell, (x, y, yaw) in zip(names, cells, graph.state_pose.tolist(), strict=True)
    )
    edges = tuple(
        LayoutEdge(
            name=_edge_name(names[start], names[end]),
            start=names[start],
            end=names[end],
            backwards=kind == MoveKind.REVERSE,
            curve=_curve(graph, move),
            length_m=float(graph.move_length[move]),
            cells=tuple(
                _cell_name(site, cell)
                for cell in graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]].tolist()
            ),
        )
        for move, (start, end, kind) in enumerate(
            zip(graph.move_from.tolist(), graph.move_to.tolist(), graph.move_kind.tolist(), strict=True)
        )
    )
    docks = {station.name: names[graph.state_at(station.dock.cell, station.dock.heading)] for station in site.stations}
    return FloorLayout(name=site.name, nodes=nodes, edges=edges, stations=tuple(_stations(site, docks)))


def state_names(site: Site, graph: LaneGraph) -> list[str]:
    """Name of the node of each state."""
    states = zip(graph.state_cell.tolist(), graph.state_heading.tolist(), strict=True)
    return [f"{_cell_name(site, cell)}_{HEADING_NAMES[heading]}" for cell, heading in states]


def layout_of_cells(site: Site) -> FloorLayout:
    """A site with a node in the middle of each cell, and an edge for each lane, for formats without headings.

    Args:
        site: The site.
    """
    used = sorted({int(cell) for cell in site.lanes.ravel()})
    parking, chargers = set(site.parking), set(site.chargers)
    name_of = {cell: _cell_name(site, cell) for cell in used}
    nodes = tuple(
        LayoutNode(name=name_of[cell], x=x, y=y, parking=cell in parking, charger=cell in chargers)
        for cell, (x, y) in zip(used, site.grid.cell_xy(used).tolist(), strict=True)
    )
    lanes = [(name_of[int(a)], name_of[int(b)]) for a, b in site.lanes]
    # Backing up leads along a lane to where the car came from; in a two-way aisle that is another lane, too.
    ways = [(start, end, False) for start, end in lanes]
    if site.allow_reverse:
        graph = build_lane_graph(site)
        back = graph.move_kind == MoveKind.REVERSE
        pairs = zip(graph.state_cell[graph.move_from[back]], graph.state_cell[graph.move_to[back]], strict=True)
        ways += [(start, end, True) for start, end in sorted({(name_of[int(a)], name_of[int(b)]) for a, b in pairs})]
    edges = tuple(
        LayoutEdge(
            name=_edge_name(start, end) + (" (back)" if backwards else ""),
            start=start,
            end=end,
            backwards=backwards,
            length_m=site.grid.cell_m,
            cells=(start, end),
        )
        for start, end, backwards in ways
    )
    docks = {station.name: name_of[station.dock.cell] for station in site.stations}
    return FloorLayout(name=site.name, nodes=nodes, edges=edges, stations=tuple(_stations(site, docks)))


def _stations(site: Site, docks: dict[str, str]) -> Iterable[LayoutStation]:
    for station in site.stations:
        x, y, _, yaw = station.arm.pose
        yield LayoutStation(
            name=site.names.get(station.name, station.name),
            use=station.kind,
            node=docks[station.name],
            x=round(x, 9),
            y=round(y, 9),
            yaw=math.remainder(yaw, math.tau),
            height_m=round(float(station.slots[:, 2].max()), 9),
        )


def _cell_name(site: Site, cell: int) -> str:
    row, col = site.grid.row_col(cell)
    return f"r{row}_c{col}"


def _edge_name(start: str, end: str) -> str:
    return f"{start} --- {end}"


def _curve(graph: LaneGraph, move: int) -> tuple[tuple[Point, ...], ...]:
    """A line, or a line, a quarter circle and a line, without those that have no length."""
    start, end = graph.state_pose[graph.move_from[move]], graph.state_pose[graph.move_to[move]]
    if graph.move_kind[move] not in (MoveKind.LEFT, MoveKind.RIGHT):
        return ((_point(*start[:2]), _point(*end[:2])),)
    ahead = math.cos(start[2]), math.sin(start[2])
    onward = math.cos(end[2]), math.sin(end[2])
    reach = (end[0] - start[0]) * ahead[0] + (end[1] - start[1]) * ahead[1]
    corner = start[0] + reach * ahead[0], start[1] + reach * ahead[1]
    arc_start = _point(corner[0] - TURN_RADIUS_M * ahead[0], corner[1] - TURN_RADIUS_M * ahead[1])
    arc_end = _point(corner[0] + TURN_RADIUS_M * onward[0], corner[1] + TURN_RADIUS_M * onward[1])
    lines = [(_point(*start[:2]), arc_start), (arc_end, _point(*end[:2]))]
    lead_in, lead_out = ((line,) if math.dist(*line) > 1e-6 else () for line in lines)
    return (*lead_in, (arc_start, _point(*corner), arc_end), *lead_out)


def _point(x: float, y: float) -> Point:
    return round(float(x), 9), round(float(y), 9)
