"""Route graphs of Nav2, as GeoJSON: a point for each state of the lane graph, an edge for each move.

The format has no headings and no stations: both are kept as metadata, which it allows and others leave alone. Edges are
lines; walls, racks and slots are lost.

Source: Nav2, route server, graph file, https://docs.nav2.org/configuration/packages/configuring-route-server.html.
"""

from __future__ import annotations

import json
from typing import Any, Literal

from maps.layouts.fields import Angle, Coordinate, FormatFields, read_fields
from maps.layouts.from_site import layout_of_states
from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutError, LayoutNode, LayoutStation, checked_layout
from maps.reading.shown import shown
from maps.reading.text_file import FileError, parse_json
from maps.site import Site

_FRAME = "map"
_VALID = "a route graph of Nav2, a GeoJSON FeatureCollection of points and lines"


class _KeptStation(FormatFields):
    name: str
    use: Literal["pick", "drop"]
    x: Coordinate
    y: Coordinate
    yaw: Angle
    height_m: float


class _Metadata(FormatFields):
    name: str = ""
    yaw: Angle | None = None
    use: str = ""
    stations: tuple[_KeptStation, ...] = ()
    backwards: bool = False


class _PointGeometry(FormatFields):
    type: Literal["Point"]
    coordinates: tuple[Coordinate, Coordinate]


class _PointProperties(FormatFields):
    id: int
    metadata: _Metadata = _Metadata()


class _PointFeature(FormatFields):
    properties: _PointProperties
    geometry: _PointGeometry


class _EdgeProperties(FormatFields):
    id: int
    startid: int
    endid: int
    metadata: _Metadata = _Metadata()


class _EdgeFeature(FormatFields):
    properties: _EdgeProperties


def write_nav2(site: Site) -> str:
    """A site as a route graph in the frame `map`, the same text whenever it is the same site."""
    layout = layout_of_states(site)
    number = {node.name: k for k, node in enumerate(layout.nodes)}
    features: list[dict[str, Any]] = []
    for node in layout.nodes:
        metadata: dict[str, Any] = {"name": node.name, "yaw": node.yaw}
        if node.parking or node.charger:
            metadata["use"] = "charger" if node.charger else "parking"
        stations = [
            {key: value for key, value in vars(station).items() if key != "node"}
            for station in layout.stations
            if station.node == node.name
        ]
        if stations:
            metadata["stations"] = stations
        properties = {"id": number[node.name], "frame": _FRAME, "metadata": metadata}
        geometry = {"type": "Point", "coordinates": [node.x, node.y]}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    at = {node.name: [node.x, node.y] for node in layout.nodes}
    for k, edge in enumerate(layout.edges):
        metadata = {"name": edge.name, "length_m": edge.length_m}
        if edge.backwards:
            metadata["backwards"] = True
        properties = {
            "id": len(layout.nodes) + k,
            "startid": number[edge.start],
            "endid": number[edge.end],
            "cost": edge.length_m,
            "overridable": False,
            "metadata": metadata,
        }
        geometry = {"type": "MultiLineString", "coordinates": [[at[edge.start], at[edge.end]]]}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    content = {
        "type": "FeatureCollection",
        "name": site.name,
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}},
        "features": features,
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def read_nav2(text: str, where: str) -> FloorLayout:
    """Read a route graph.

    Args:
        text: Content of the file.
        where: Opens every message.

    Raises:
        LayoutError: It is no GeoJSON, or malformed.
    """
    try:
        content = parse_json(text, where, valid=_VALID)
    except FileError as error:
        raise LayoutError(str(error)) from error
    if not isinstance(content, dict) or content.get("type") != "FeatureCollection":
        found = shown(content.get("type") if isinstance(content, dict) else content)
        raise LayoutError(f"{where}: type is {found}; valid: {_VALID}")
    features = content.get("features")
    if not isinstance(features, list):
        raise LayoutError(f"{where}: features is {shown(features)}; valid: a list of points and lines")
    nodes, edges, stations = [], [], []
    names: dict[int, str] = {}
    for k, feature in enumerate(features):
        geometry = feature.get("geometry") if isinstance(feature, dict) else None
        if isinstance(geometry, dict) and geometry.get("type") == "Point":
            point = read_fields(_PointFeature, feature, f"{where}: features[{k}]")
            known = point.properties.metadata
            name = known.name or str(point.properties.id)
            names[point.properties.id] = name
            x, y = point.geometry.coordinates
            parking, charger = known.use == "parking", known.use == "charger"
            nodes.append(LayoutNode(name=name, x=x, y=y, yaw=known.yaw, parking=parking, charger=charger))
            stations += [LayoutStation(node=name, **vars(station)) for station in known.stations]
    for k, feature in enumerate(features):
        geometry = feature.get("geometry") if isinstance(feature, dict) else None
        if not isinstance(geometry, dict) or geometry.get("type") != "Point":
            edge = read_fields(_EdgeFeature, feature, f"{where}: features[{k}]").properties
            ends = [names.get(number, str(number)) for number in (edge.startid, edge.endid)]
            name = edge.metadata.name or str(edge.id)
            edges.append(LayoutEdge(name=name, start=ends[0], end=ends[1], backwards=edge.metadata.backwards))
    title = content.get("name")
    made = FloorLayout(
        name=title if isinstance(title, str) and title else "route_graph",
        nodes=tuple(nodes),
        edges=tuple(edges),
        stations=tuple(stations),
    )
    return checked_layout(made, where)
