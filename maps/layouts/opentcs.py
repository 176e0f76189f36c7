"""openTCS plant models, version 7: a point for each state of the lane graph, a path for each move.

Its paths lead one way, and a block for each cell says what the executor's grants say: one car at a time where states or
moves touch. Positions are whole millimetres. Walls, racks and slots are lost; the arm's direction and the height of its
slots are properties of a location.

Source: openTCS, plant model schema 7.0.0 (model-7.0.0.xsd), https://github.com/openTCS/opentcs.
"""

from __future__ import annotations

import math
from itertools import pairwise
from xml.etree import ElementTree

from pydantic import Field

from maps.layouts.fields import MOST_M, Coordinate, FormatFields, read_fields
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
)
from maps.reading.shown import shown
from maps.site import Site
from maps.vehicle import BODY_FRONT_M

_VERSION = "7.0.0"
_READ = ("6.", "7.")
_VALID = "a plant model of openTCS, XML with the root <model>"
_REAR_M = 0.09
"""Reach of the car's body behind the rear axle [m], see `maps.vehicle`."""
_WIDTH_MM, _HEIGHT_MM = 300, 250
_SPEED_MM_S = 1000
_MM_PER_UNIT = 10.0
"""Scale of the drawing, in which control points are given."""
_CUBIC = 4.0 * (math.sqrt(2.0) - 1.0) / 3.0
"""Length of a cubic's handles that makes a quarter circle of radius 1, within 0.03 %."""
_YAW, _HEIGHT = "fleet:armYawDeg", "fleet:slotHeight"
_TYPES: dict[str, tuple[str, str]] = {
    "pick": ("pick", "LOAD_TRANSFER_GENERIC"),
    "drop": ("drop", "LOAD_TRANSFER_ALT_1"),
    "charger": ("startCharging", "RECHARGE_GENERIC"),
}
"""Type of location -> what can be done there, and its symbol."""


class _Point(FormatFields):
    name: str
    positionX: float
    positionY: float
    vehicleOrientationAngle: float = math.nan
    type: str


class _Path(FormatFields):
    name: str
    sourcePoint: str
    destinationPoint: str
    length: float
    maxVelocity: float
    maxReverseVelocity: float


class _ControlPoint(FormatFields):
    x: Coordinate
    y: Coordinate


class _Scale(FormatFields):
    scaleX: float = Field(gt=0, allow_inf_nan=False)
    scaleY: float = Field(gt=0, allow_inf_nan=False)


class _Location(FormatFields):
    name: str
    positionX: float = Field(allow_inf_nan=False)
    positionY: float = Field(allow_inf_nan=False)
    type: str


class _Property(FormatFields):
    name: str
    value: str


def write_opentcs(site: Site) -> str:
    """A site as a plant model, the same text whenever it is the same site."""
    layout = layout_of_states(site)
    model = ElementTree.Element("model", version=_VERSION, name=site.name)
    _add_points(model, layout)
    _add_paths(model, layout)
    _add_locations(model, layout)
    members: dict[str, list[str]] = {}
    for edge in layout.edges:
        for cell in edge.cells:
            names = members.setdefault(cell, [])
            # A path that is driven backwards is the path itself.
            names += [name for name in (edge.start, edge.end) if name.startswith(f"{cell}_") and name not in names]
            if not edge.backwards:
                names.append(edge.name)
    for cell in sorted(members):
        block = ElementTree.SubElement(model, "block", name=f"block_{cell}", type="SINGLE_VEHICLE_ONLY")
        for name in members[cell]:
            ElementTree.SubElement(block, "member", name=name)
        ElementTree.SubElement(block, "blockLayout", color="#FF9900")
    drawing = ElementTree.SubElement(
        model, "visualLayout", name="layout", scaleX=str(_MM_PER_UNIT), scaleY=str(_MM_PER_UNIT)
    )
    ElementTree.SubElement(drawing, "layer", id="0", ordinal="0", visible="true", name="floor", groupId="0")
    ElementTree.SubElement(drawing, "layerGroup", id="0", name="floor", visible="true")
    ElementTree.indent(model)
    return ElementTree.tostring(model, encoding="unicode", xml_declaration=True) + "\n"


def read_opentcs(text: str, where: str) -> FloorLayout:
    """Read a plant model of version 6 or 7.

    A location is a pick station if something can be loaded there, a drop station if something can be unloaded; where
    both are allowed, as one after the other comes in the file.

    Args:
        text: Content of the file.
        where: Opens every message.

    Raises:
        LayoutError: It is no XML, another document or version, or malformed.
    """
    try:
        model = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        line, column = error.position
        lines = text.splitlines() or [""]
        raise LayoutError(
            f"{where}: line {line}, column {column + 1}: {shown(lines[min(line, len(lines)) - 1].strip())} is no XML "
            f"({error.msg.partition(':')[0]}); valid: {_VALID}"
        ) from error
    if model.tag != "model":
        raise LayoutError(f"{where}: the root is <{model.tag}>; valid: {_VALID}")
    version = model.get("version", "")
    if not version.startswith(_READ):
        raise LayoutError(f"{where}: version is {shown(version)}; valid: 6.x.x or 7.x.x")
    nodes = [_node(element, where) for element in model.iter("point")]
    at_node = {node.name: (node.x, node.y) for node in nodes}
    scale = _drawing_scale(model, where)
    edges = [edge for element in model.iter("path") for edge in _edges(element, at_node, scale, where)]
    uses = {
        element.get("name", ""): [operation.get("name", "") for operation in element.iter("allowedOperation")]
        for element in model.iter("locationType")
    }
    chargers: set[str] = set()
    stations: list[LayoutStation] = []
    for element in model.iter("location"):
        at = _at(element, where)
        location = read_fields(_Location, element.attrib, at)
        if location.type not in uses:
            raise LayoutError(f"{at}: type is {shown(location.type)}; valid: one of {', '.join(uses) or 'none'}")
        # Others lead to the same place from elsewhere, as a station here has one dock.
        link = element.find("link")
        if link is None:
            continue
        allowed = [operation.get("name", "") for operation in link.iter("allowedOperation")]
        use = _use_of(allowed or uses[location.type], len(stations))
        point = link.get("point", "")
        if use == "charger":
            chargers.add(point)
        elif use is not None:
            properties = [read_fields(_Property, found.attrib, at) for found in element.iter("property")]
            known = {found.name: found.value for found in properties}
            stations.append(_station(location, use, point, known, at))
    made = FloorLayout(
        name=model.get("name", "model"),
        nodes=tuple(LayoutNode(**{**vars(node), "charger": node.name in chargers}) for node in nodes),
        edges=tuple(edges),
        stations=tuple(stations),
    )
    return checked_layout(made, where)


def _node(element: ElementTree.Element, where: str) -> LayoutNode:
    point = read_fields(_Point, element.attrib, _at(element, where))
    x, y = (
        _metres(value, name, element, where)
        for name, value in (("positionX", point.positionX), ("positionY", point.positionY))
    )
    angle = point.vehicleOrientationAngle
    return LayoutNode(
        name=point.name,
        x=x,
        y=y,
        yaw=math.radians(angle) if math.isfinite(angle) else None,
        parking=point.type == "PARK_POSITION",
    )


def _edges(element: ElementTree.Element, at_node: dict[str, Point], scale: Point, where: str) -> list[LayoutEdge]:
    """A path as the ways along it: one for each sense in which vehicles may drive."""
    path = read_fields(_Path, element.attrib, _at(element, where))
    curve = _curve(element, at_node.get(path.sourcePoint), at_node.get(path.destinationPoint), scale, where)
    ways = []
    if path.maxVelocity > 0:
        ways.append(
            LayoutEdge(
                name=path.name,
                start=path.sourcePoint,
                end=path.destinationPoint,
                curve=curve,
                length_m=path.length / 1e3,
            )
        )
    if path.maxReverseVelocity > 0:
        ways.append(
            LayoutEdge(
                name=f"{path.name} (back)",
                start=path.destinationPoint,
                end=path.sourcePoint,
                backwards=True,
                curve=tuple(piece[::-1] for piece in curve[::-1]),
                length_m=path.length / 1e3,
            )
        )
    return ways


def _drawing_scale(model: ElementTree.Element, where: str) -> Point:
    """Metres of a unit of the drawing to the right and upwards."""
    drawing = model.find("visualLayout")
    if drawing is None:
        return _MM_PER_UNIT / 1e3, _MM_PER_UNIT / 1e3
    scale = read_fields(_Scale, drawing.attrib, _at(drawing, where))
    return scale.scaleX / 1e3, scale.scaleY / 1e3


def _curve(
    element: ElementTree.Element, start: Point | None, end: Point | None, scale: Point, where: str
) -> tuple[tuple[Point, ...], ...]:
    """The curve of a path that is drawn as a Bezier curve of degree two or three, or as several lines."""
    drawn = element.find("pathLayout")
    kind = "" if drawn is None else drawn.get("connectionType", "")
    if drawn is None or start is None or end is None or kind not in ("BEZIER", "POLYPATH"):
        return ()
    read = [read_fields(_ControlPoint, point.attrib, _at(element, where)) for point in drawn.iter("controlPoint")]
    # The drawing has y down.
    points = [(point.x * scale[0], -point.y * scale[1]) for point in read]
    if kind == "POLYPATH":
        return tuple(pairwise((start, *points, end)))
    if len(points) == 1:
        (x, y) = points[0]
        points = [((x0 + 2 * x) / 3, (y0 + 2 * y) / 3) for x0, y0 in (start, end)]
    return ((start, *points, end),) if len(points) == 2 else ()


def _station(location: _Location, use: Use, point: str, known: dict[str, str], where: str) -> LayoutStation:
    values: dict[str, float | None] = {}
    for key in (_YAW, _HEIGHT):
        try:
            values[key] = _finite(known[key]) if key in known else None
        except ValueError as error:
            raise LayoutError(f"{where}: property {key} is {shown(known[key])}; valid: a number") from error
    yaw = values[_YAW]
    return LayoutStation(
        name=location.name,
        use="pick" if use == "pick" else "drop",
        node=point,
        x=location.positionX / 1e3,
        y=location.positionY / 1e3,
        yaw=None if yaw is None else math.radians(yaw),
        height_m=values[_HEIGHT],
    )


def _use_of(operations: list[str], number: int) -> Use | None:
    words = [operation.casefold() for operation in operations]
    drops = any("unload" in word or "drop" in word for word in words)
    picks = any(("load" in word and "unload" not in word) or "pick" in word for word in words)
    if picks and drops:
        return "drop" if number % 2 else "pick"
    if picks or drops:
        return "pick" if picks else "drop"
    return "charger" if any("charg" in word for word in words) else None


def _finite(text: str) -> float:
    """A number; raises ValueError if it is none, or not finite."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(text)
    return number


def _metres(value: float, name: str, element: ElementTree.Element, where: str) -> float:
    if not abs(value) <= MOST_M * 1e3:
        raise LayoutError(f"{_at(element, where)}: {name} is {shown(value)}; valid: millimetres up to {MOST_M * 1e3:g}")
    return value / 1e3


def _at(element: ElementTree.Element, where: str) -> str:
    return f"{where}: {element.tag} {shown(element.get('name', ''))}"


def _mm(value_m: float) -> str:
    return str(round(value_m * 1e3))


def _add_points(model: ElementTree.Element, layout: FloorLayout) -> None:
    leaving: dict[str, list[str]] = {}
    for edge in layout.edges:
        if not edge.backwards:
            leaving.setdefault(edge.start, []).append(edge.name)
    for node in layout.nodes:
        point = ElementTree.SubElement(
            model,
            "point",
            name=node.name,
            positionX=_mm(node.x),
            positionY=_mm(node.y),
            positionZ="0",
            vehicleOrientationAngle="NaN" if node.yaw is None else f"{math.degrees(node.yaw):g}",
            type="PARK_POSITION" if node.parking else "HALT_POSITION",
        )
        ElementTree.SubElement(
            point,
            "maxVehicleBoundingBox",
            length=_mm(BODY_FRONT_M + _REAR_M),
            width=str(_WIDTH_MM),
            height=str(_HEIGHT_MM),
            referenceOffsetX=_mm((_REAR_M - BODY_FRONT_M) / 2),
            referenceOffsetY="0",
        )
        for name in leaving.get(node.name, ()):
            ElementTree.SubElement(point, "outgoingPath", name=name)
        ElementTree.SubElement(point, "pointLayout", labelOffsetX="-10", labelOffsetY="-20", layerId="0")


def _add_paths(model: ElementTree.Element, layout: FloorLayout) -> None:
    back = {(edge.end, edge.start) for edge in layout.edges if edge.backwards}
    for edge in layout.edges:
        if edge.backwards:
            continue
        path = ElementTree.SubElement(
            model,
            "path",
            name=edge.name,
            sourcePoint=edge.start,
            destinationPoint=edge.end,
            length=_mm(edge.length_m or 0.0),
            maxVelocity=str(_SPEED_MM_S),
            maxReverseVelocity=str(_SPEED_MM_S if (edge.start, edge.end) in back else 0),
            locked="false",
        )
        handles = _handles(edge.curve)
        drawn = ElementTree.SubElement(
            path, "pathLayout", connectionType="BEZIER" if handles else "DIRECT", layerId="0"
        )
        for x, y in handles:
            # The drawing has y down.
            ElementTree.SubElement(
                drawn, "controlPoint", x=str(round(x * 1e3 / _MM_PER_UNIT)), y=str(round(-y * 1e3 / _MM_PER_UNIT))
            )


def _add_locations(model: ElementTree.Element, layout: FloorLayout) -> None:
    for name, (operation, symbol) in _TYPES.items():
        kind = ElementTree.SubElement(model, "locationType", name=name)
        ElementTree.SubElement(kind, "allowedOperation", name=operation)
        ElementTree.SubElement(kind, "locationTypeLayout", locationRepresentation=symbol)
    for station in layout.stations:
        at = (station.x or 0.0, station.y or 0.0)
        facts = {_YAW: f"{math.degrees(station.yaw or 0.0):.9g}", _HEIGHT: f"{station.height_m:g}"}
        _add_location(model, station.name, station.use, station.node, at, facts)
    for node in layout.nodes:
        if node.charger:
            _add_location(model, f"charger_{node.name}", "charger", node.name, (node.x, node.y), {})


def _add_location(
    model: ElementTree.Element, name: str, use: str, point: str, at: Point, facts: dict[str, str]
) -> None:
    location = ElementTree.SubElement(
        model,
        "location",
        name=name,
        positionX=_mm(at[0]),
        positionY=_mm(at[1]),
        positionZ="0",
        type=use,
        locked="false",
    )
    ElementTree.SubElement(location, "link", point=point)
    for key, value in facts.items():
        ElementTree.SubElement(location, "property", name=key, value=value)
    ElementTree.SubElement(
        location,
        "locationLayout",
        labelOffsetX="-10",
        labelOffsetY="-20",
        locationRepresentation="DEFAULT",
        layerId="0",
    )


def _handles(curve: tuple[tuple[Point, ...], ...]) -> tuple[Point, ...]:
    """Control points of the one cubic that stands for a turn in the drawing; none for a line."""
    corners = [piece[1] for piece in curve if len(piece) == 3]
    if not corners:
        return ()
    (x0, y0), (x1, y1), (x, y) = curve[0][0], curve[-1][-1], corners[0]
    return (x0 + _CUBIC * (x - x0), y0 + _CUBIC * (y - y0)), (x1 + _CUBIC * (x - x1), y1 + _CUBIC * (y - y1))
