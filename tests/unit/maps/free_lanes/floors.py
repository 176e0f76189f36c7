"""Small layouts for tests of free lanes."""

from __future__ import annotations

from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutNode, LayoutStation, Point
from maps.vehicle import Footprint

BODY = Footprint(front_m=0.41, rear_m=0.09, half_width_m=0.15, turn_radius_m=0.4)
RING = {"a": (0.0, 0.0), "b": (6.0, 0.0), "c": (6.5, 5.0), "d": (0.0, 4.0)}
TREE = {"hub": (0.0, 0.0), "east": (4.0, 0.5), "north": (-0.5, 4.0), "west": (-4.0, -0.7)}


def layout_of(
    nodes: dict[str, Point],
    ways: list[tuple[str, str]],
    *,
    stations: dict[str, str] | None = None,
    curves: dict[tuple[str, str], tuple[tuple[Point, ...], ...]] | None = None,
) -> FloorLayout:
    """A layout with an edge for each way, and stations by their nodes."""
    return FloorLayout(
        name="test",
        nodes=tuple(LayoutNode(name=name, x=x, y=y) for name, (x, y) in nodes.items()),
        edges=tuple(LayoutEdge(name=f"{a} {b}", start=a, end=b, curve=(curves or {}).get((a, b), ())) for a, b in ways),
        stations=tuple(
            LayoutStation(name=f"{use} at {node}", use="pick" if use == "pick" else "drop", node=node)
            for node, use in (stations or {}).items()
        ),
    )


def ring() -> FloorLayout:
    """Four nodes, one way round, not on a grid."""
    return layout_of(RING, [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a")])


def tree() -> FloorLayout:
    """Three arms from a hub, driven both ways."""
    spokes = [("hub", arm) for arm in ("east", "north", "west")]
    return layout_of(TREE, [*spokes, *((b, a) for a, b in spokes)], stations={"east": "pick", "west": "drop"})
