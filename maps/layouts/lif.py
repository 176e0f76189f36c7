"""LIF, the Layout Interchange Format 1.0.0: a node for each state of the lane graph, an edge for each move.

Its edges lead one way, and its nodes have an orientation for each type of vehicle, as lane graphs do. It has no walls,
no racks, no parking places and no slots: the first three are lost, parking is told in the description of a station.

Source: VDMA, LIF Layout Interchange Format 1.0.0, https://github.com/Intralogistics-2X-LIF/Layout-Interchange-Format.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal

from maps.layouts.fields import Angle, Coordinate, FormatFields, read_fields
from maps.layouts.from_site import layout_of_states
from maps.layouts.layout import (
    FloorLayout,
    LayoutEdge,
    LayoutError,
    LayoutNode,
    LayoutStation,
    Point,
    Use,
    checked_layout,
    some_nodes,
)
from maps.layouts.nurbs import nurbs_lines
from maps.reading.shown import shown
from maps.reading.text_file import FileError, parse_json
from maps.site import Site

_VERSION = "1.0.0"
_VEHICLE = "fleet.carlike"
_VALID = "LIF 1.0.0, a JSON object with metaInformation and layouts"
_EXPORTED = "1970-01-01T00:00:00Z"
"""The format wants a time. The same site is the same file, so it is always this one."""
_ACTIONS: dict[str, Use] = {"pick": "pick", "drop": "drop", "startCharging": "charger"}
"""What a vehicle can do at a node, in the words of VDA 5050."""
_PARKING = "parking"
_SPEED_MPS = 1.0


class _Position(FormatFields):
    x: Coordinate
    y: Coordinate
    theta: Angle | None = None


class _Action(FormatFields):
    actionType: str


class _NodeOfVehicle(FormatFields):
    vehicleTypeId: str
    theta: Angle | None = None
    actions: tuple[_Action, ...] = ()


class _Node(FormatFields):
    nodeId: str
    nodePosition: _Position
    vehicleTypeNodeProperties: tuple[_NodeOfVehicle, ...]


class _ControlPoint(FormatFields):
    x: Coordinate
    y: Coordinate
    weight: Coordinate = 1.0


class _Trajectory(FormatFields):
    degree: int
    knotVector: tuple[Coordinate, ...]
    controlPoints: tuple[_ControlPoint, ...]


class _EdgeOfVehicle(FormatFields):
    vehicleTypeId: str
    vehicleOrientation: Angle = 0.0
    orientationType: Literal["GLOBAL", "TANGENTIAL"] = "TANGENTIAL"
    trajectory: _Trajectory | None = None


class _Edge(FormatFields):
    edgeId: str
    startNodeId: str
    endNodeId: str
    vehicleTypeEdgeProperties: tuple[_EdgeOfVehicle, ...]


class _Station(FormatFields):
    stationId: str
    interactionNodeIds: tuple[str, ...]
    stationDescription: str = ""
    stationHeight: float | None = None
    stationPosition: _Position | None = None


class _Layout(FormatFields):
    layoutId: str
    layoutLevelId: str = ""
    nodes: tuple[_Node, ...]
    edges: tuple[_Edge, ...]
    stations: tuple[_Station, ...]


class _Meta(FormatFields):
    lifVersion: str


class _File(FormatFields):
    metaInformation: _Meta
    layouts: tuple[_Layout, ...]


def write_lif(site: Site) -> str:
    """A site as LIF, one level, the same text whenever it is the same site."""
    layout = layout_of_states(site)
    actions: dict[str, list[str]] = {node.name: ["startCharging"] if node.charger else [] for node in layout.nodes}
    for station in layout.stations:
        if station.use not in actions[station.node]:
            actions[station.node].append(station.use)
    stations = [_station_object(station) for station in layout.stations]
    for node in layout.nodes:
        if node.parking or node.charger:
            use = "charger" if node.charger else _PARKING
            stations.append(
                {
                    "stationId": f"{use}_{node.name}",
                    "interactionNodeIds": [node.name],
                    "stationName": f"{use}_{node.name}",
                    "stationDescription": use,
                }
            )
    content = {
        "metaInformation": {
            "projectIdentification": site.name,
            "creator": "fleet",
            "exportTimestamp": _EXPORTED,
            "lifVersion": _VERSION,
        },
        "layouts": [
            {
                "layoutId": site.name,
                "layoutName": site.name,
                "layoutVersion": "1",
                "layoutLevelId": "0",
                "nodes": [_node_object(node, site.name, actions[node.name]) for node in layout.nodes],
                "edges": [_edge_object(edge) for edge in layout.edges],
                "stations": stations,
            }
        ],
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def read_lif(text: str, where: str) -> FloorLayout:
    """Read LIF 1.0.x; of several types of vehicles the first that is named at an edge counts, and what is open to it.

    Args:
        text: Content of the file.
        where: Opens every message.

    Raises:
        LayoutError: It is malformed, of another version, or has several layouts.
    """
    try:
        content = parse_json(text, where, valid=_VALID)
    except FileError as error:
        raise LayoutError(str(error)) from error
    if not isinstance(content, dict):
        raise LayoutError(f"{where}: is {shown(content)}; valid: {_VALID}")
    file = read_fields(_File, content, where)
    version = file.metaInformation.lifVersion
    if not version.startswith("1."):
        raise LayoutError(f"{where}: metaInformation.lifVersion is {shown(version)}; valid: 1.0.0")
    if len(file.layouts) != 1:
        names = ", ".join(layout.layoutId for layout in file.layouts) or "none"
        raise LayoutError(f"{where}: layouts are {names}; valid: one layout, as a site has one floor")
    layout = file.layouts[0]
    named = [of.vehicleTypeId for edge in layout.edges for of in edge.vehicleTypeEdgeProperties]
    named += [of.vehicleTypeId for node in layout.nodes for of in node.vehicleTypeNodeProperties]
    vehicle = named[0] if named else ""
    uses: dict[str, set[str]] = {}
    closed: set[str] = set()
    nodes = []
    for node in layout.nodes:
        own = next((of for of in node.vehicleTypeNodeProperties if of.vehicleTypeId == vehicle), None)
        if own is None:
            closed.add(node.nodeId)
            continue
        uses[node.nodeId] = {action.actionType for action in own.actions}
        nodes.append(LayoutNode(name=node.nodeId, x=node.nodePosition.x, y=node.nodePosition.y, yaw=own.theta))
    edges = []
    for edge in layout.edges:
        of_vehicle = next((of for of in edge.vehicleTypeEdgeProperties if of.vehicleTypeId == vehicle), None)
        if of_vehicle is None:
            continue
        back = of_vehicle.orientationType == "TANGENTIAL" and math.cos(of_vehicle.vehicleOrientation) < 0.0
        curve = _curve(of_vehicle.trajectory, f"{where}: trajectory of edge {edge.edgeId!r}")
        edges.append(
            LayoutEdge(name=edge.edgeId, start=edge.startNodeId, end=edge.endNodeId, backwards=back, curve=curve)
        )
    marks: dict[str, set[str]] = {"parking": set(), "charger": set()}
    stations = []
    known = {node.nodeId for node in layout.nodes}
    for station in layout.stations:
        for name in station.interactionNodeIds:
            if name not in known:
                raise LayoutError(f"{where}: station {station.stationId!r} is at {name!r}; valid: {some_nodes(known)}")
        for node_id in [name for name in station.interactionNodeIds if name not in closed][:1]:
            use = _use_of(station, uses.get(node_id, set()))
            if use in marks:
                marks[use].add(node_id)
            elif use is not None:
                place = station.stationPosition
                stations.append(
                    LayoutStation(
                        name=station.stationId,
                        use="pick" if use == "pick" else "drop",
                        node=node_id,
                        x=place.x if place else None,
                        y=place.y if place else None,
                        yaw=place.theta if place else None,
                        height_m=station.stationHeight,
                    )
                )
    marked = tuple(
        replace(node, parking=node.name in marks["parking"], charger=node.name in marks["charger"]) for node in nodes
    )
    made = FloorLayout(name=layout.layoutId, nodes=marked, edges=tuple(edges), stations=tuple(stations))
    return checked_layout(made, where)


def _curve(trajectory: _Trajectory | None, where: str) -> tuple[tuple[Point, ...], ...]:
    """The curve of an edge that has one."""
    if trajectory is None:
        return ()
    points = [(point.x, point.y, point.weight) for point in trajectory.controlPoints]
    return nurbs_lines(trajectory.degree, trajectory.knotVector, points, where)


def _use_of(station: _Station, actions: set[str]) -> Use | None:
    """What a station is for: what its description says, or what can be done at its node."""
    for use in ("pick", "drop", "charger", "parking"):
        if station.stationDescription == use:
            return use
    return next((use for action, use in _ACTIONS.items() if action in actions), None)


def _node_object(node: LayoutNode, floor: str, actions: list[str]) -> dict[str, Any]:
    of_vehicle: dict[str, Any] = {"vehicleTypeId": _VEHICLE, "theta": node.yaw}
    if actions:
        of_vehicle["actions"] = [
            {"actionType": action, "requirementType": "OPTIONAL", "blockingType": "HARD", "actionParameters": []}
            for action in actions
        ]
    return {
        "nodeId": node.name,
        "mapId": floor,
        "nodePosition": {"x": node.x, "y": node.y},
        "vehicleTypeNodeProperties": [of_vehicle],
    }


def _edge_object(edge: LayoutEdge) -> dict[str, Any]:
    of_vehicle: dict[str, Any] = {
        "vehicleTypeId": _VEHICLE,
        "vehicleOrientation": math.pi if edge.backwards else 0.0,
        "orientationType": "TANGENTIAL",
        "rotationAllowed": False,
        "rotationAtStartNodeAllowed": "NONE",
        "rotationAtEndNodeAllowed": "NONE",
        "maxSpeed": _SPEED_MPS,
        "loadRestriction": {"unloaded": True, "loaded": True},
        "trajectory": _trajectory(edge.curve),
    }
    return {
        "edgeId": edge.name,
        "startNodeId": edge.start,
        "endNodeId": edge.end,
        "vehicleTypeEdgeProperties": [of_vehicle],
    }


def _station_object(station: LayoutStation) -> dict[str, Any]:
    return {
        "stationId": station.name,
        "interactionNodeIds": [station.node],
        "stationName": station.name,
        "stationDescription": station.use,
        "stationHeight": station.height_m,
        "stationPosition": {"x": station.x, "y": station.y, "theta": station.yaw},
    }


def _trajectory(curve: tuple[tuple[Point, ...], ...]) -> dict[str, Any]:
    """A curve as a NURBS: of degree 1 if it is a line, of degree 2 with a double knot between its pieces otherwise.

    A quarter circle has weights 1, cos 45 deg, 1; the format wants none below 1, and only their ratios count. A line
    stays one with any.

    Source: L. Piegl and W. Tiller, The NURBS Book, 2nd ed. 1997, section 7.3.
    """
    if len(curve) == 1 and len(curve[0]) == 2:
        return {
            "degree": 1,
            "knotVector": [0.0, 0.0, 1.0, 1.0],
            "controlPoints": [{"x": x, "y": y, "weight": 1.0} for x, y in curve[0]],
        }
    points = [{"x": curve[0][0][0], "y": curve[0][0][1], "weight": math.sqrt(2.0)}]
    lengths = []
    for piece in curve:
        (x0, y0), (x1, y1) = piece[0], piece[-1]
        straight = len(piece) == 2
        corner = ((x0 + x1) / 2, (y0 + y1) / 2) if straight else piece[1]
        lengths.append(math.dist(piece[0], piece[-1]) if straight else math.dist(piece[0], piece[1]) * math.pi / 2)
        points.append({"x": corner[0], "y": corner[1], "weight": 1.0})
        points.append({"x": x1, "y": y1, "weight": math.sqrt(2.0)})
    ends = [0.0]
    for length in lengths:
        ends.append(ends[-1] + length)
    inner = [end / ends[-1] for end, _ in pairwise(ends)][1:]
    knots = [0.0, 0.0, 0.0, *(knot for knot in inner for _ in range(2)), 1.0, 1.0, 1.0]
    return {"degree": 2, "knotVector": knots, "controlPoints": points}
