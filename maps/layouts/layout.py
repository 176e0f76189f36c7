"""FloorLayout: nodes, edges and stations of a floor as the formats of fleet managers have them, on no grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from maps.errors import MapsError

Point: TypeAlias = tuple[float, float]
Use: TypeAlias = Literal["pick", "drop", "charger", "parking"]


class LayoutError(MapsError):
    """A layout is malformed or cannot become a site; the message names the file, the element and what is valid."""


@dataclass(frozen=True, kw_only=True)
class LayoutNode:
    """A place that a vehicle can stop at."""

    name: str
    x: float
    """[m], to the east."""
    y: float
    """[m], to the north."""
    yaw: float | None = None
    """How a vehicle stands there, counter-clockwise from +x, -pi to pi [rad]; None = any way."""
    parking: bool = False
    charger: bool = False
    level: str = ""
    """Name of the storey, where a format has several."""


@dataclass(frozen=True, kw_only=True)
class LayoutEdge:
    """A way from one node to another, in this direction."""

    name: str
    start: str
    end: str
    backwards: bool = False
    """Whether the vehicle reverses."""
    curve: tuple[tuple[Point, ...], ...] = ()
    """Its pieces one after the other [m]: two points are a line, three a quarter circle with the corner of its tangents
    in the middle, four a cubic Bezier curve. Empty = a line between the nodes, or unknown."""
    length_m: float | None = None
    cells: tuple[str, ...] = ()
    """Names of the squares of floor that a vehicle needs on it, where they are known."""


@dataclass(frozen=True, kw_only=True)
class LayoutStation:
    """Where something is taken from vehicles or given to them."""

    name: str
    use: Literal["pick", "drop"]
    node: str
    """Where the vehicle stands."""
    x: float | None = None
    """Base of the arm, or the middle of what else stands there [m]; None = unknown."""
    y: float | None = None
    yaw: float | None = None
    """Direction of the arm's +x [rad]."""
    height_m: float | None = None
    """Top of its slots above the floor [m]."""


@dataclass(frozen=True, kw_only=True)
class FloorLayout:
    """A floor."""

    name: str
    nodes: tuple[LayoutNode, ...]
    edges: tuple[LayoutEdge, ...]
    stations: tuple[LayoutStation, ...] = ()


def checked_layout(layout: FloorLayout, where: str) -> FloorLayout:
    """Check that names are used once and that edges and stations name nodes.

    Args:
        layout: As it was read.
        where: Opens every message.

    Raises:
        LayoutError: A name is used twice, or there is no node of it; there are no nodes or no edges.
    """
    for what, items in (("node", layout.nodes), ("edge", layout.edges)):
        if not items:
            raise LayoutError(f"{where}: no {what}s; valid: at least one {what}")
        seen: set[str] = set()
        for item in items:
            if item.name in seen:
                raise LayoutError(f"{where}: {what} {item.name!r} is there twice; valid: a name of its own for each")
            seen.add(item.name)
    nodes = {node.name for node in layout.nodes}
    for edge in layout.edges:
        for what, name in (("begins", edge.start), ("ends", edge.end)):
            if name not in nodes:
                raise LayoutError(f"{where}: edge {edge.name!r} {what} at {name!r}; valid: {some_nodes(nodes)}")
    for station in layout.stations:
        if station.node not in nodes:
            raise LayoutError(f"{where}: station {station.name!r} is at {station.node!r}; valid: {some_nodes(nodes)}")
    return layout


def one_level(layout: FloorLayout, level: str | None, where: str) -> FloorLayout:
    """The part of a layout on one storey; ways from one to another are left out.

    Args:
        layout: A layout.
        level: Name of the level; None = the only one that there is.
        where: Opens every message.

    Raises:
        LayoutError: There are several and none is named, or none has this name.
    """
    levels = sorted({node.level for node in layout.nodes})
    if level is None and len(levels) == 1:
        return layout
    if level not in levels:
        named = f"level {level!r} is not there" if level is not None else f"levels {', '.join(levels)}"
        raise LayoutError(
            f"{where}: {named}; valid: one level (--level), of {', '.join(filter(None, levels)) or 'none'}"
        )
    nodes = tuple(node for node in layout.nodes if node.level == level)
    names = {node.name for node in nodes}
    return replace(
        layout,
        nodes=nodes,
        edges=tuple(edge for edge in layout.edges if edge.start in names and edge.end in names),
        stations=tuple(station for station in layout.stations if station.node in names),
    )


def some_nodes(names: set[str]) -> str:
    """A few of the names that there are."""
    first = sorted(names)[:4]
    return f"a node, one of {', '.join(first)}{', ...' if len(names) > len(first) else ''}"
