"""Building maps of Open-RMF, as its traffic editor draws them, and the navigation graphs that follow from them.

Coordinates are pixels with y down, metres, or places on the earth. In pixels, the reference level gets its scale from
measurements, every other level its scale, rotation and place from the fiducials that both have. Places on the earth are
projected to the plane that the file names. A lane belongs to one of the graphs 0 to 8.

Source: Open-RMF, rmf_building_map_tools, https://github.com/open-rmf/rmf_traffic_editor: what its navigation graphs
hold was read there, and compared with the graphs that it made of public maps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from maps.layouts.fields import FormatFields, read_fields
from maps.layouts.from_site import layout_of_cells
from maps.layouts.layout import FloorLayout, LayoutError
from maps.layouts.rmf.graph import NavGraph, NavLane, NavLevel, NavVertex, graph_of_layout, layout_of_graph
from maps.layouts.rmf.projection import Projection
from maps.layouts.rmf.yaml_file import dump_yaml, parse_yaml
from maps.reading.shown import shown
from maps.site import Site

Floats = npt.NDArray[np.float64]
Frame = Callable[[Floats], Floats]
"""From the places of a level in the file to metres, shape (n, 2) each."""

_VALID = "a building map of Open-RMF, YAML with levels, each with vertices and lanes"
_PIXELS, _METRES, _DEGREES, _TILES = "reference_image", "cartesian_meters", "wgs84", "web_mercator"
_SYSTEMS = (_PIXELS, _METRES, _DEGREES, _TILES)
_N_GRAPHS = 9
_FURTHEST = 1e9  # pixels, metres or degrees
_PARALLEL = 0.01
"""Smaller determinants are those of parallel lines [pixels^2]."""
_TEXT, _INT, _DOUBLE, _BOOL = 1, 2, 3, 4
"""Types of parameters in the file."""
_OPPOSITE = {"forward": "backward", "backward": "forward"}
_PX_M = 0.05
"""Edge of a pixel in files that are written [m]."""
_COPIED = ("speed_limit", "mutex", "demo_mock_floor_name", "demo_mock_lift_name")
"""Parameters of a lane that its navigation graph has where they are not empty."""


@dataclass(frozen=True, kw_only=True)
class _Row:
    """An edge of the file, or a vertex: numbers, and parameters without their types."""

    numbers: tuple[float, ...]
    name: str
    facts: Mapping[str, Any]

    @property
    def ends(self) -> tuple[int, int]:
        return int(self.numbers[0]), int(self.numbers[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Drawing:
    """A level as it is drawn."""

    xy: Floats
    """Vertices, y up [pixels], shape (n, 2)."""
    vertices: tuple[_Row, ...]
    lanes: tuple[_Row, ...]
    doors: tuple[_Row, ...]
    measurements: tuple[_Row, ...]
    fiducials: Mapping[str, tuple[float, float]]
    """Name -> place, y up."""
    elevation: float


@dataclass(frozen=True, kw_only=True)
class _Frame:
    """From the pixels of a level to metres: turned, scaled, moved."""

    scale: float
    yaw: float = 0.0
    x: float = 0.0
    y: float = 0.0

    def __call__(self, xy: Floats) -> Floats:
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        turned = np.column_stack((cos * xy[:, 0] - sin * xy[:, 1], sin * xy[:, 0] + cos * xy[:, 1]))
        return np.asarray(turned * self.scale + (self.x, self.y))


class _Lift(FormatFields):
    x: float
    y: float
    yaw: float = 0.0
    width: float
    depth: float
    lowest_floor: str = ""
    highest_floor: str = ""
    reference_floor_name: str = ""
    level_doors: Mapping[str, tuple[str, ...]] = MappingProxyType({})


def read_building(text: str, where: str) -> FloorLayout:
    """Read the first navigation graph of a building map, see `navigation_graphs`."""
    graphs = navigation_graphs(text, where)
    if not graphs:
        raise LayoutError(f"{where}: no lanes; valid: at least one lane on a level")
    return layout_of_graph(graphs[min(graphs)], where)


def write_building(site: Site) -> str:
    """A site as a building map, with a wall round each block of cells that nothing drives on.

    Raises:
        LayoutError: PyYAML is not installed.
    """
    graph = graph_of_layout(layout_of_cells(site))
    level = graph.levels["L1"]
    vertices: list[list[Any]] = []
    for vertex in level.vertices:
        facts = {key: _typed(value) for key, value in vertex.facts.items() if key != "name"}
        row = [_pixels(vertex.x), -_pixels(vertex.y), 0.0, vertex.facts["name"]]
        vertices.append([*row, facts] if facts else row)
    lanes = [
        [
            lane.start,
            lane.end,
            {
                "bidirectional": [_BOOL, False],
                "graph_idx": [_INT, 0],
                "orientation": [_TEXT, lane.facts["orientation_constraint"]],
                "mutex": [_TEXT, lane.facts["mutex"]],
                "speed_limit": [_DOUBLE, 0.0],
            },
        ]
        for lane in level.lanes
    ]
    corners: dict[tuple[float, float], int] = {}
    walls = []
    for ends in _wall_lines(site):
        numbers = []
        for x, y in ends:
            if (x, y) not in corners:
                corners[x, y] = len(vertices)
                vertices.append([_pixels(x), -_pixels(y), 0.0, ""])
            numbers.append(corners[x, y])
        walls.append([*numbers, {}])
    # The scale: the floor's own lower edge.
    width = site.grid.cols * site.grid.cell_m
    vertices += [[0.0, 0.0, 0.0, ""], [_pixels(width), 0.0, 0.0, ""]]
    measurements = [[len(vertices) - 2, len(vertices) - 1, {"distance": [_DOUBLE, width]}]]
    content = {
        "name": site.name,
        "coordinate_system": "reference_image",
        "levels": {
            "L1": {
                "elevation": 0.0,
                "measurements": measurements,
                "vertices": vertices,
                "lanes": lanes,
                "walls": walls,
            }
        },
        "lifts": {},
    }
    return dump_yaml(content)


def navigation_graphs(text: str, where: str) -> dict[int, NavGraph]:
    """Read a building map and make its navigation graphs.

    Args:
        text: Content of the file.
        where: Opens every message.

    Returns:
        Graphs that have a lane, by their number.

    Raises:
        LayoutError: It is no YAML, malformed, or on the earth with no plane to project it to.
    """
    content = parse_yaml(text, where, valid=_VALID)
    system = content.get("coordinate_system", _PIXELS)
    if system not in _SYSTEMS:
        raise LayoutError(f"{where}: coordinate_system is {shown(system)}; valid: one of {', '.join(_SYSTEMS)}")
    levels = content.get("levels")
    if not isinstance(levels, dict) or not levels:
        raise LayoutError(f"{where}: levels is {shown(levels)}; valid: {_VALID}")
    down = -1.0 if system == _PIXELS else 1.0
    drawings = {str(name): _drawing(level, down, f"{where}: levels.{name}") for name, level in levels.items()}
    reference = str(content.get("reference_level_name", next(iter(drawings))))
    if reference not in drawings:
        raise LayoutError(f"{where}: reference_level_name is {reference!r}; valid: one of {', '.join(drawings)}")
    frames: dict[str, Frame] = dict.fromkeys(drawings, _Frame(scale=1.0))
    if system in (_DEGREES, _TILES):
        frames = dict.fromkeys(drawings, _plane(content, where))
    if system == _PIXELS:
        scale = _scale(drawings[reference])
        frames[reference] = _Frame(scale=scale)
        for name, drawing in drawings.items():
            if name != reference:
                frames[name] = _aligned(drawing, drawings[reference], scale)
    cabins = _cabins(content.get("lifts") or {}, drawings, frames, reference, down, where)
    building = str(content.get("building_name", content.get("name", "building")))
    graphs = {}
    for number in range(_N_GRAPHS):
        made = {
            name: _nav_level(d, frames[name], cabins[name], number, f"{where}: levels.{name}")
            for name, d in drawings.items()
        }
        if any(level.lanes for level in made.values()):
            graphs[number] = NavGraph(building=building, levels=made)
    return graphs


def _plane(content: dict[str, Any], where: str) -> Projection:
    """The projection to the plane that a file names."""
    parameters = content.get("parameters") or {}
    named = parameters.get("generate_crs") if isinstance(parameters, dict) else None
    if not isinstance(named, list) or len(named) != 2 or not isinstance(named[1], str):
        raise LayoutError(
            f"{where}: parameters.generate_crs is {shown(named)}; valid: the plane that places on the earth are "
            "projected to, such as [1, EPSG:3414]"
        )
    tiles = content["coordinate_system"] == _TILES
    return Projection(named[1], tiles=tiles, where=f"{where}: parameters.generate_crs")


def _drawing(content: Any, down: float, where: str) -> _Drawing:
    if not isinstance(content, dict):
        raise LayoutError(f"{where} is {shown(content)}; valid: vertices and lanes")
    vertices = _read_rows(content, "vertices", where, n_numbers=3, named=True)
    xy = np.array([row.numbers[:2] for row in vertices], dtype=np.float64).reshape(-1, 2) * (1.0, down)
    edges = {key: _read_rows(content, key, where) for key in ("lanes", "doors", "measurements")}
    for key, rows in edges.items():
        for k, row in enumerate(rows):
            for number in row.numbers:
                if number != int(number) or not 0 <= number < len(vertices):
                    valid = f"a vertex, 0 to {len(vertices) - 1}"
                    raise LayoutError(f"{where}.{key}[{k}]: vertex {number:g}; valid: {valid}")
    for k, row in enumerate(edges["lanes"]):
        _check_lane(row, f"{where}.lanes[{k}]")
    for k, row in enumerate(edges["measurements"]):
        distance = row.facts.get("distance", 1.0)
        if isinstance(distance, bool) or not isinstance(distance, int | float) or not 0 < distance <= _FURTHEST:
            at = f"{where}.measurements[{k}]"
            raise LayoutError(f"{at}: distance is {shown(distance)}; valid: a length > 0 [m]")
    fiducials = _read_rows(content, "fiducials", where, named=True)
    elevation = content.get("elevation", 0.0)
    return _Drawing(
        xy=xy,
        vertices=vertices,
        fiducials={row.name: (row.numbers[0], down * row.numbers[1]) for row in fiducials},
        elevation=float(elevation) if isinstance(elevation, int | float) else 0.0,
        **edges,
    )


def _check_lane(row: _Row, where: str) -> None:
    """Refuse a lane whose parameters say nothing, or that belongs to no graph."""
    orientation, graph = row.facts.get("orientation", ""), row.facts.get("graph_idx", 0)
    if not isinstance(orientation, str):
        raise LayoutError(f"{where}: orientation is {shown(orientation)}; valid: forward, backward or none")
    if isinstance(graph, bool) or not isinstance(graph, int) or not 0 <= graph < _N_GRAPHS:
        raise LayoutError(f"{where}: graph_idx is {shown(graph)}; valid: an integer from 0 to {_N_GRAPHS - 1}")


def _read_rows(
    content: dict[str, Any], key: str, where: str, *, n_numbers: int = 2, named: bool = False
) -> tuple[_Row, ...]:
    """Rows of numbers, a name where they have one, and parameters as [type, value]."""
    rows = content.get(key) or []
    if not isinstance(rows, list):
        raise LayoutError(f"{where}.{key} is {shown(rows)}; valid: a list")
    found = []
    for k, row in enumerate(rows):
        n_fixed = n_numbers + named
        numbers = row[:n_numbers] if isinstance(row, list) else []
        fits = len(numbers) == n_numbers and all(isinstance(n, int | float) and abs(n) <= _FURTHEST for n in numbers)
        facts = row[n_fixed] if fits and len(row) > n_fixed else {}
        if not fits or (named and len(row) < n_fixed) or not isinstance(facts, dict):
            names = [*("xyz" if named else ("from", "to"))[:n_numbers], *(["name"] if named else [])]
            raise LayoutError(f"{where}.{key}[{k}] is {shown(row)}; valid: [{', '.join(names)}, {{...}}]")
        values = {}
        for name, value in facts.items():
            if not isinstance(value, list) or len(value) != 2:
                raise LayoutError(f"{where}.{key}[{k}]: {name} is {shown(value)}; valid: [type, value]")
            values[str(name)] = value[1]
        found.append(_Row(numbers=tuple(map(float, numbers)), name=str(row[n_numbers]) if named else "", facts=values))
    return tuple(found)


def _scale(drawing: _Drawing) -> float:
    """Metres in a pixel: mean of what the measurements say."""
    found = []
    for row in drawing.measurements:
        start, end = (drawing.xy[number] for number in row.ends)
        length = math.dist(start, end)
        distance = row.facts.get("distance")
        if length > 0 and distance is not None:
            found.append(distance / length)
    return sum(found) / len(found) if found else 1.0


def _aligned(drawing: _Drawing, reference: _Drawing, scale: float) -> _Frame:
    """The frame of a level whose fiducials are to lie over those of the reference level."""
    pairs = [
        (reference.fiducials[name], drawing.fiducials[name])
        for name in reference.fiducials
        if name in drawing.fiducials
    ]
    if len(pairs) < 2:
        return _Frame(scale=1.0)
    turns, ratios = [], []
    for (ref_a, a), (ref_b, b) in combinations(pairs, 2):
        if math.dist(a, b) == 0.0 or math.dist(ref_a, ref_b) == 0.0:
            continue  # two at one place say nothing of scale and direction
        bearing = math.atan2(b[1] - a[1], b[0] - a[0])
        ref_bearing = math.atan2(ref_b[1] - ref_a[1], ref_b[0] - ref_a[0])
        turns.append(bearing - ref_bearing)
        ratios.append(math.dist(a, b) / math.dist(ref_a, ref_b))
    if not ratios:
        return _Frame(scale=1.0)
    yaw = -math.atan2(sum(map(math.sin, turns)), sum(map(math.cos, turns)))
    ratio = sum(ratios) / len(ratios)
    here = _Frame(scale=1.0 / ratio, yaw=yaw)(np.array([own for _, own in pairs]))
    move = (np.array([ref for ref, _ in pairs]) - here).mean(axis=0) * scale
    return _Frame(scale=scale / ratio, yaw=yaw, x=float(move[0]), y=float(move[1]))


def _cabins(
    lifts: Any, drawings: Mapping[str, _Drawing], frames: Mapping[str, Frame], reference: str, down: float, where: str
) -> dict[str, dict[str, Floats]]:
    """Corners of the lifts that stop at each level [m], shape (4, 2) each."""
    found: dict[str, dict[str, Floats]] = {name: {} for name in drawings}
    if not isinstance(lifts, dict):
        raise LayoutError(f"{where}: lifts is {shown(lifts)}; valid: a mapping of names to lifts")
    for name, content in lifts.items():
        lift = read_fields(_Lift, content, f"{where}: lifts.{name}")
        if not lift.level_doors:
            continue
        frame = frames.get(lift.reference_floor_name or reference, frames[reference])
        centre = frame(np.array([[lift.x, down * lift.y]]))[0]
        box = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (lift.width / 2, lift.depth / 2)
        corners = _Frame(scale=1.0, yaw=lift.yaw, x=float(centre[0]), y=float(centre[1]))(box)
        ends = [drawings[level].elevation for level in (lift.lowest_floor, lift.highest_floor) if level in drawings]
        for level, drawing in drawings.items():
            if not ends or min(ends) <= drawing.elevation <= max(ends):
                found[level][str(name)] = corners
    return found


def _nav_level(drawing: _Drawing, frame: Frame, cabins: Mapping[str, Floats], number: int, where: str) -> NavLevel:
    """The part of a level that belongs to a graph: vertices of its lanes in the order in which lanes name them."""
    lanes = [row for row in drawing.lanes if row.facts.get("graph_idx", 0) == number]
    order: dict[int, int] = {}
    for row in lanes:
        for end in row.ends:
            order.setdefault(end, len(order))
    xy = frame(drawing.xy) if len(drawing.xy) else drawing.xy
    vertices = []
    for k in order:
        if not np.isfinite(xy[k]).all():
            raise LayoutError(
                f"{where}.vertices[{k}] is at {shown(drawing.xy[k].tolist())}; valid: a place in the plane of "
                "generate_crs, as longitude and latitude in degrees"
            )
        facts: dict[str, Any] = {"name": drawing.vertices[k].name, **drawing.vertices[k].facts}
        lift = next((name for name, corners in cabins.items() if _within(xy[k], corners)), None)
        if lift is not None:
            facts["lift"] = lift
        vertices.append(NavVertex(x=float(xy[k, 0]), y=float(xy[k, 1]), facts=facts))
    made = [lane for row in lanes for lane in _nav_lanes(drawing, row, order)]
    return NavLevel(vertices=tuple(vertices), lanes=tuple(made))


def _nav_lanes(drawing: _Drawing, row: _Row, order: Mapping[int, int]) -> list[NavLane]:
    """One lane of a graph, or two of one that is bidirectional."""
    first, second = row.ends
    facts: dict[str, Any] = {}
    for door in drawing.doors:
        if _cross(drawing.xy[[first, second]], drawing.xy[list(door.ends)]):
            facts["door_name"] = door.facts.get("name", "")
    orientation = row.facts.get("orientation", "")
    if orientation:
        facts["orientation_constraint"] = orientation
    facts |= {key: row.facts[key] for key in _COPIED if row.facts.get(key)}
    docks = [drawing.vertices[k].facts.get("dock_name") for k in (first, second)]
    onward = facts | _docked(*docks)
    ends = order[first], order[second]
    if not row.facts.get("bidirectional", row.facts.get("is_bidirectional", False)):
        one_way = facts | {"is_bidirectional": False} | _docked(*docks)
        return [NavLane(start=ends[0], end=ends[1], facts=one_way)]
    back = facts | _docked(*docks[::-1])
    if orientation:
        back["orientation_constraint"] = _OPPOSITE.get(orientation, orientation)
    return [NavLane(start=ends[0], end=ends[1], facts=onward), NavLane(start=ends[1], end=ends[0], facts=back)]


def _docked(start: Any, end: Any) -> dict[str, Any]:
    """Docks at the ends of a lane, seen along it."""
    return ({"dock_name": end} if end else {}) | ({"undock_name": start} if start else {})


def _cross(one: Floats, other: Floats) -> bool:
    """Whether two line segments, shape (2, 2) each, have a point in common; parallel ones have none."""
    along, door, apart = one[1] - one[0], other[1] - other[0], other[0] - one[0]
    determinant = along[0] * door[1] - along[1] * door[0]
    if abs(determinant) < _PARALLEL:
        return False
    at = (apart[0] * door[1] - apart[1] * door[0]) / determinant
    at_door = (apart[0] * along[1] - apart[1] * along[0]) / determinant
    return bool(0.0 <= at <= 1.0 and 0.0 <= at_door <= 1.0)


def _within(point: Floats, corners: Floats) -> bool:
    """Whether a point lies in a convex polygon."""
    sides, apart = np.roll(corners, -1, axis=0) - corners, point - corners
    side = sides[:, 0] * apart[:, 1] - sides[:, 1] * apart[:, 0]
    return bool((side >= 0).all() or (side <= 0).all())


def _pixels(value_m: float) -> float:
    return round(value_m / _PX_M, 6)


def _typed(value: Any) -> list[Any]:
    """A parameter with its type."""
    return [_BOOL if isinstance(value, bool) else _TEXT, value]


def _wall_lines(site: Site) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Borders of walls and racks towards cells that are neither, as lines of one row or column [m]."""
    built = np.pad(site.walls | site.shelves, 1)
    rows, cell_m = site.grid.rows, site.grid.cell_m
    found = []
    for across in (True, False):
        solid = built if across else built.T
        edge = solid[1:] != solid[:-1]  # between line k and line k + 1
        for line in range(edge.shape[0]):
            marks = np.flatnonzero(np.diff(np.concatenate(([False], edge[line], [False])).astype(np.int8)))
            for begin, end in marks.reshape(-1, 2).tolist():
                pair = [((place - 1) * cell_m, (rows - line) * cell_m) for place in (begin, end)]
                if not across:
                    pair = [(line * cell_m, (rows - place + 1) * cell_m) for place in (begin, end)]
                found.append((pair[0], pair[1]))
    return found
