"""Navigation graphs of Open-RMF: a vertex for each cell, a lane for each lane.

The format has no headings, so a site that comes back has its lanes and the moves that follow from them, and default
stations: where an arm stands, how high its slots are, and a second station at the same dock are lost, with walls and
racks. Each lane has the cell that it leads to as its mutex group.

Source: Open-RMF, rmf_traffic_editor and rmf_fleet_adapter (agv/parse_graph), https://github.com/open-rmf.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Field

from maps.layouts.fields import FormatFields, read_fields
from maps.layouts.from_site import layout_of_cells
from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutError, LayoutNode, LayoutStation, Use, checked_layout
from maps.layouts.rmf.yaml_file import dump_yaml, parse_yaml
from maps.reading.shown import shown
from maps.site import Site

_VALID = "a navigation graph of Open-RMF, YAML with levels, each with vertices and lanes"
_PLANE_M = 2.1e7
"""Greatest coordinate: those of maps of the earth are in its planes, which count from far away [m]."""
_PlaneCoordinate = Annotated[float, Field(allow_inf_nan=False, ge=-_PLANE_M, le=_PLANE_M)]
_BACKWARD, _FORWARD = "backward", "forward"
_STATIONS: dict[str, Use] = {"pickup_dispenser": "pick", "dropoff_ingestor": "drop"}


@dataclass(frozen=True, kw_only=True)
class NavVertex:
    """A vertex of a navigation graph."""

    x: float
    y: float
    facts: Mapping[str, Any]
    """Its properties: name, is_charger, is_parking_spot, ..."""


@dataclass(frozen=True, kw_only=True)
class NavLane:
    """A lane between two vertices of a level."""

    start: int
    end: int
    facts: Mapping[str, Any]
    """Its properties: orientation_constraint, speed_limit, door_name, mutex, ..."""


@dataclass(frozen=True, kw_only=True)
class NavLevel:
    """A storey."""

    vertices: tuple[NavVertex, ...] = ()
    lanes: tuple[NavLane, ...] = ()


@dataclass(frozen=True, kw_only=True)
class NavGraph:
    """A navigation graph: where the robots of one fleet may drive."""

    building: str
    levels: Mapping[str, NavLevel] = field(default_factory=dict)


class _Facts(FormatFields):
    name: str = ""
    is_charger: bool = False
    is_parking_spot: bool = False
    pickup_dispenser: str = ""
    dropoff_ingestor: str = ""


class _Point(FormatFields):
    x: _PlaneCoordinate
    y: _PlaneCoordinate


class _Lane(FormatFields):
    start: int
    end: int
    orientation_constraint: str = ""


def write_rmf(site: Site) -> str:
    """A site as a navigation graph, the same text whenever it is the same site.

    Raises:
        LayoutError: PyYAML is not installed.
    """
    layout = layout_of_cells(site)
    return dump_yaml(graph_content(graph_of_layout(layout)))


def read_rmf(text: str, where: str) -> FloorLayout:
    """Read a navigation graph; levels without lanes are left out.

    Args:
        text: Content of the file.
        where: Opens every message.

    Raises:
        LayoutError: It is no YAML, or malformed.
    """
    return layout_of_graph(read_graph(text, where), where)


def read_graph(text: str, where: str) -> NavGraph:
    """Read a navigation graph as it is, see `read_rmf`."""
    content = parse_yaml(text, where, valid=_VALID)
    levels = content.get("levels")
    if not isinstance(levels, dict) or not levels:
        raise LayoutError(f"{where}: levels is {shown(levels)}; valid: {_VALID}")
    return NavGraph(
        building=str(content.get("building_name", "building")),
        levels={str(name): _level(level, f"{where}: levels.{name}") for name, level in levels.items()},
    )


def _level(content: Any, where: str) -> NavLevel:
    if not isinstance(content, dict):
        raise LayoutError(f"{where} is {shown(content)}; valid: vertices and lanes")
    vertices = []
    for k, row in enumerate(_rows(content, "vertices", where)):
        x, y, facts = _three(row, f"{where}.vertices[{k}]", "[x, y, {name: ...}]")
        point = read_fields(_Point, {"x": x, "y": y}, f"{where}.vertices[{k}]")
        vertices.append(NavVertex(x=point.x, y=point.y, facts=facts))
    lanes = []
    for k, row in enumerate(_rows(content, "lanes", where)):
        start, end, facts = _three(row, f"{where}.lanes[{k}]", "[from, to, {...}]")
        lane = read_fields(_Lane, {"start": start, "end": end, **facts}, f"{where}.lanes[{k}]")
        for what, number in (("from", lane.start), ("to", lane.end)):
            if not 0 <= number < len(vertices):
                raise LayoutError(f"{where}.lanes[{k}]: {what} is {number}; valid: a vertex, 0 to {len(vertices) - 1}")
        lanes.append(NavLane(start=lane.start, end=lane.end, facts=facts))
    return NavLevel(vertices=tuple(vertices), lanes=tuple(lanes))


def _rows(content: dict[str, Any], key: str, where: str) -> list[Any]:
    rows = content.get(key) or []
    if not isinstance(rows, list):
        raise LayoutError(f"{where}.{key} is {shown(rows)}; valid: a list")
    return rows


def _three(row: Any, where: str, valid: str) -> tuple[Any, Any, dict[str, Any]]:
    """Two values and properties, which may be left out."""
    if not isinstance(row, list) or len(row) not in (2, 3) or not isinstance(row[2] if len(row) > 2 else {}, dict):
        raise LayoutError(f"{where} is {shown(row)}; valid: {valid}")
    return row[0], row[1], row[2] if len(row) > 2 else {}


def layout_of_graph(graph: NavGraph, where: str) -> FloorLayout:
    """A navigation graph as a layout.

    Args:
        graph: The graph.
        where: Opens every message.

    Raises:
        LayoutError: There is no lane, or a property of a vertex is of another kind.
    """
    nodes, edges, stations = [], [], []
    used: set[str] = set()
    several = sum(bool(level.lanes) for level in graph.levels.values()) > 1
    for level, content in graph.levels.items():
        if not content.lanes:
            continue
        names = []
        for k, vertex in enumerate(content.vertices):
            facts = read_fields(_Facts, dict(vertex.facts), f"{where}: levels.{level}.vertices[{k}]")
            name = facts.name or (f"{level}_vertex_{k}" if several else f"vertex_{k}")
            name = f"{name}_{level}_{k}" if name in used else name
            used.add(name)
            names.append(name)
            node = LayoutNode(
                name=name,
                x=vertex.x,
                y=vertex.y,
                parking=facts.is_parking_spot and not facts.is_charger,
                charger=facts.is_charger,
                level=level,
            )
            nodes.append(node)
            for key, use in _STATIONS.items():
                station = getattr(facts, key)
                if station:
                    stations.append(LayoutStation(name=station, use="pick" if use == "pick" else "drop", node=name))
        for k, lane in enumerate(content.lanes):
            start, end = names[lane.start], names[lane.end]
            back = lane.facts.get("orientation_constraint") == _BACKWARD
            edges.append(LayoutEdge(name=f"{level}.lanes[{k}]", start=start, end=end, backwards=back))
    made = FloorLayout(name=graph.building, nodes=tuple(nodes), edges=tuple(edges), stations=tuple(stations))
    return checked_layout(made, where)


def graph_of_layout(layout: FloorLayout) -> NavGraph:
    """A layout of cells as a navigation graph with one level.

    Args:
        layout: As `maps.layouts.from_site.layout_of_cells` makes it.
    """
    number = {node.name: k for k, node in enumerate(layout.nodes)}
    named: dict[str, dict[str, str]] = {}
    for station in reversed(layout.stations):
        key = next(key for key, use in _STATIONS.items() if use == station.use)
        named.setdefault(station.node, {})[key] = station.name
    vertices = tuple(
        NavVertex(
            x=node.x,
            y=node.y,
            facts={"name": node.name}
            | ({"is_parking_spot": True} if node.parking else {})
            | ({"is_charger": True} if node.charger else {})
            | named.get(node.name, {}),
        )
        for node in layout.nodes
    )
    lanes = tuple(
        NavLane(
            start=number[edge.start],
            end=number[edge.end],
            facts={"orientation_constraint": _BACKWARD if edge.backwards else _FORWARD, "mutex": edge.end},
        )
        for edge in layout.edges
    )
    return NavGraph(building=layout.name, levels={"L1": NavLevel(vertices=vertices, lanes=lanes)})


def graph_content(graph: NavGraph) -> dict[str, Any]:
    """What the file of a navigation graph holds."""
    levels = {
        name: {
            "lanes": [[lane.start, lane.end, dict(lane.facts)] for lane in level.lanes],
            "vertices": [[vertex.x, vertex.y, dict(vertex.facts)] for vertex in level.vertices],
        }
        for name, level in graph.levels.items()
    }
    return {"building_name": graph.building, "doors": {}, "levels": levels, "lifts": {}}
