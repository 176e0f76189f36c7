"""Layouts from elsewhere become sites where they lie on a grid, and say what was changed."""

import json
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maps.grid import EAST, GridMap
from maps.layouts.formats import LAYOUT_FORMATS
from maps.layouts.from_site import layout_of_cells, layout_of_states
from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutError, LayoutNode, LayoutStation, one_level
from maps.layouts.lif import read_lif, write_lif
from maps.layouts.rmf.building import navigation_graphs
from maps.layouts.rmf.graph import read_graph
from maps.layouts.to_site import site_of_layout
from maps.orientation import path_lengths
from maps.site import load_site

RMF = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[5] / "shared" / "instances")) / "interop" / "rmf"
REFERENCES = ["battle_royale/0", "hotel/0", "hotel/1", "hotel/2", "office/0", "triple_H/0"]


def made(layout):
    return site_of_layout(layout, name="made", where="file")


def moved(layout, x=0.0, y=0.0, scale=1.0):
    """The same layout elsewhere and larger."""
    nodes = tuple(replace(node, x=node.x * scale + x, y=node.y * scale + y) for node in layout.nodes)
    return replace(layout, nodes=nodes, stations=tuple(replace(s, x=None, y=None) for s in layout.stations))


def ring(side=6.0, step=2.0):
    """A one-way ring with a pick and a drop station, its nodes `step` apart."""
    n = round(side / step)
    corners = [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)]
    points = []
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
        points += [(x0 + (x1 - x0) * k / n, y0 + (y1 - y0) * k / n) for k in range(n)]
    nodes = tuple(LayoutNode(name=f"n{k}", x=x, y=y) for k, (x, y) in enumerate(points))
    ends = [(k, (k + 1) % len(nodes)) for k in range(len(nodes))]
    edges = tuple(LayoutEdge(name=f"e{a}", start=f"n{a}", end=f"n{b}") for a, b in ends)
    stations = (
        LayoutStation(name="goods in", use="pick", node="n1"),
        LayoutStation(name="goods out", use="drop", node=f"n{2 * n + 1}"),
    )
    return FloorLayout(name="ring", nodes=nodes, edges=edges, stations=stations)


def test_edges_are_as_many_cells_long_as_they_are_metres():
    found = made(ring())
    assert len(found.site.lanes) == 24
    assert found.names == {"pick_1": "goods in", "drop_1": "goods out"}
    assert "coordinates are not those of the file" in found.notes[0]


def test_stations_go_by_their_own_names_when_they_go_out_again():
    site = made(ring()).site
    assert site.names == {"pick_1": "goods in", "drop_1": "goods out"}
    for name in ("lif", "opentcs", "nav2"):
        again = LAYOUT_FORMATS[name].read(LAYOUT_FORMATS[name].write(site), "file")
        assert {station.name for station in again.stations} == {"goods in", "goods out"}
        assert made(again).site.names == site.names


def test_the_grid_may_lie_anywhere():
    layout = layout_of_cells(load_site("small"))
    here, there = made(layout), made(moved(layout, x=-103.27, y=41.4))
    assert there.site.grid.cols == here.site.grid.cols + 2
    assert len(there.site.lanes) == len(here.site.lanes)
    assert there.path_ratio == pytest.approx(here.path_ratio)


def test_nodes_are_moved_by_a_tenth_of_a_cell():
    layout = layout_of_cells(load_site("small"))
    rng = np.random.default_rng(0)
    shaken = tuple(
        replace(node, x=node.x + dx, y=node.y + dy)
        for node, (dx, dy) in zip(layout.nodes, rng.uniform(-0.04, 0.04, (len(layout.nodes), 2)), strict=True)
    )
    found = made(replace(layout, nodes=shaken))
    assert np.array_equal(found.site.lanes, load_site("small").lanes)
    assert any("nodes were moved to the middle of their cells, by up to 0.0" in note for note in found.notes)


def test_a_coarser_grid_is_drawn_with_its_squares_as_cells():
    found = made(moved(layout_of_cells(load_site("small")), scale=2.7))
    assert len(found.site.lanes) == len(load_site("small").lanes)
    assert any("nodes lie 2.7 m apart and are drawn 1 m apart" in note for note in found.notes)


def test_lanes_that_lead_both_ways_get_a_direction_each():
    layout = layout_of_cells(load_site("small"))
    back = tuple(replace(edge, name=f"{edge.name} back", start=edge.end, end=edge.start) for edge in layout.edges)
    found = made(replace(layout, edges=layout.edges + back))
    lanes = {(int(a), int(b)) for a, b in found.site.lanes}
    assert not {(b, a) for a, b in lanes} & lanes
    assert found.path_ratio == pytest.approx(path_lengths(found.site.lanes, found.site.grid).ratio)
    assert 1.0 < found.path_ratio <= 1.5
    assert found.notes[0] == f"{len(layout.edges)} two-way lanes were given one direction each"


def test_a_dead_end_is_left_out_and_named():
    layout = ring()
    edges = tuple(replace(edge, name=f"{edge.name} back", start=edge.end, end=edge.start) for edge in layout.edges)
    blind = (LayoutEdge(name="in", start="n2", end="blind"), LayoutEdge(name="out", start="blind", end="n2"))
    nodes = (*layout.nodes, LayoutNode(name="blind", x=4.0, y=-3.0))
    found = made(replace(layout, nodes=nodes, edges=layout.edges + edges + blind))
    assert "3 cells are left out" in found.notes[1]
    assert len(found.site.lanes) == 24


def test_one_of_several_levels():
    layout = ring()
    nodes = tuple(replace(node, level="L1") for node in layout.nodes)
    upstairs = (LayoutNode(name="up", x=90.3, y=1.1, level="L2"), LayoutNode(name="top", x=95.0, y=1.7, level="L2"))
    edges = (LayoutEdge(name="lift", start="n0", end="up"), LayoutEdge(name="hall", start="up", end="top"))
    both = replace(layout, nodes=nodes + upstairs, edges=layout.edges + edges)
    assert len(made(one_level(both, "L1", "file")).site.lanes) == 24
    with pytest.raises(LayoutError, match=r"file: level 'L3' is not there; valid: one level \(--level\), of L1, L2"):
        one_level(both, "L3", "file")


def test_only_what_is_open_to_one_vehicle_comes_in():
    content = json.loads(write_lif(load_site("cell")))
    layout = content["layouts"][0]
    other = {**layout["nodes"][0], "nodeId": "ramp", "vehicleTypeNodeProperties": [{"vehicleTypeId": "forklift"}]}
    layout["nodes"].append(other)
    way = {**layout["edges"][0], "edgeId": "ramp way", "endNodeId": "ramp"}
    way["vehicleTypeEdgeProperties"] = [{"vehicleTypeId": "forklift", "rotationAllowed": True}]
    layout["edges"].append(way)
    layout["stations"].append({"stationId": "dock gate", "interactionNodeIds": ["ramp"], "stationDescription": "pick"})
    found = made(read_lif(json.dumps(content), "file"))
    assert np.array_equal(found.site.lanes, load_site("cell").lanes)
    assert found.site.stations == load_site("cell").stations


def test_an_arm_never_stands_before_the_nose_of_a_car():
    """A dock in a corner: the car comes in eastwards and leaves to the north."""
    layout = ring()
    corner = (LayoutStation(name="in", use="pick", node="n3"), layout.stations[1])
    found = made(replace(layout, stations=corner))
    (place,) = [station for station in found.site.stations if station.kind == "pick"]
    assert place.dock.heading == EAST
    assert place.arm.pose[1] == pytest.approx(place.dock.pose[1] - 0.6)


def test_stations_keep_what_is_not_usual():
    site = load_site("small")
    layout = layout_of_states(site)
    station = layout.stations[0]
    turned = replace(station, yaw=station.yaw + 0.25, x=station.x - 0.03)
    deeper = tuple(
        replace(node, x=node.x + 0.05 * np.cos(node.yaw), y=node.y + 0.05 * np.sin(node.yaw))
        if node.name == station.node
        else node
        for node in layout.nodes
    )
    found = made(replace(layout, nodes=deeper, stations=(turned, *layout.stations[1:])))
    options = found.site.options["pick_1"]
    assert options.arm_yaw_deg == pytest.approx(np.degrees(turned.yaw))
    assert options.stop_offset_m == pytest.approx(0.29)
    assert options.arm_xy == pytest.approx((turned.x, turned.y))


BROKEN = {
    "beside the grid": (
        lambda r: replace(r, nodes=(replace(r.nodes[0], x=0.3), *r.nodes[1:])),
        ["node 'n0' at (0.30, 0.00) m lies 0.30 m beside the grid of 1 m", "(1 of 12 do not)", "at most 0.1 m"],
    ),
    "aslant": (
        lambda r: replace(r, edges=(replace(r.edges[0], end="n4"), *r.edges[1:])),
        ["edge 'e0' leads from (0.00, 0.00) to (6.00, 2.00) m, along no row and no column"],
    ),
    "on the spot": (
        lambda r: replace(r, edges=(*r.edges, LayoutEdge(name="turn", start="n0", end="n0"))),
        ["edge 'turn' leads from (0.00, 0.00) to (0.00, 0.00) m, within one cell"],
    ),
    "over a node": (
        lambda r: replace(r, edges=(replace(r.edges[0], end="n2"), *r.edges[1:])),
        ["edge 'e0' leads over node 'n1'"],
    ),
    "crossing": (
        lambda r: replace(
            r,
            edges=(
                *r.edges,
                LayoutEdge(name="across", start="n1", end="n8"),
                LayoutEdge(name="up", start="n11", end="n4"),
            ),
        ),
        ["edges 'across' and 'up' cross where there is no node"],
    ),
    "levels": (
        lambda r: replace(r, nodes=(replace(r.nodes[0], level="L2"), *r.nodes[1:])),
        ["levels , L2; valid: one level (--level), of L2"],
    ),
    "station aside": (
        lambda r: replace(
            r,
            nodes=(*r.nodes, LayoutNode(name="aside", x=3.0, y=3.0)),
            stations=(replace(r.stations[0], node="aside"), r.stations[1]),
        ),
        ["station 'goods in' is at node 'aside', which no edge joins"],
    ),
    "two ways in": (
        lambda r: replace(
            r,
            nodes=(*r.nodes, LayoutNode(name="side", x=2.0, y=-2.0)),
            edges=(
                *r.edges,
                LayoutEdge(name="in", start="side", end="n1"),
                LayoutEdge(name="out", start="n1", end="side"),
                LayoutEdge(name="back", start="side", end="n1", backwards=True),
            ),
        ),
        ["station 'goods in' at row 8, column 4 has 2 ways in; valid: one"],
    ),
    "no drop": (lambda r: replace(r, stations=r.stations[:1]), ["no drop dock"]),
    "cut off": (
        lambda r: replace(
            r,
            nodes=(*r.nodes, LayoutNode(name="blind", x=4.0, y=-2.0)),
            edges=(*r.edges, LayoutEdge(name="in", start="n2", end="blind")),
        ),
        ["is a dead end or cut off", "2 cells in all"],
    ),
    "far away": (
        lambda r: replace(r, nodes=(*r.nodes, LayoutNode(name="far", x=90000.0, y=3000.0))),
        ["cells of 1 m; valid: 4000000 in all"],
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_on_no_grid_or_cannot_be_driven_is_refused_by_name(name):
    broken, expected = BROKEN[name]
    with pytest.raises(ValueError, match="file") as refusal:
        made(broken(ring()))
    said = str(refusal.value)
    assert "\n" not in said
    assert "valid: " in said
    for words in expected:
        assert words in said


@pytest.mark.parametrize("reference", REFERENCES)
def test_graphs_of_building_maps_are_those_that_open_rmf_makes(reference):
    """Vertices to the micrometre, lanes and all properties, against graphs made by rmf_building_map_tools."""
    pytest.importorskip("yaml", reason="the formats of Open-RMF need the extra rmf")
    name, _, number = reference.partition("/")
    if not RMF.is_dir():
        pytest.skip(f"no {RMF}; set FLEET_INSTANCES to the folder that holds interop")
    building = (RMF / f"{name}.building.yaml").read_text(encoding="utf-8")
    ours = navigation_graphs(building, name)[int(number)]
    theirs = read_graph((RMF / "nav" / f"{reference}.yaml").read_text(encoding="utf-8"), reference)
    assert ours.building == theirs.building
    assert list(ours.levels) == list(theirs.levels)
    for level in theirs.levels:
        mine, other = ours.levels[level], theirs.levels[level]
        assert [vertex.facts for vertex in mine.vertices] == [vertex.facts for vertex in other.vertices]
        assert mine.lanes == other.lanes
        xy, other_xy = ([(vertex.x, vertex.y) for vertex in found.vertices] for found in (mine, other))
        assert np.allclose(xy, other_xy, rtol=0.0, atol=1e-6)


def test_docks_doors_and_orientations_are_seen_along_the_lane():
    pytest.importorskip("yaml", reason="the formats of Open-RMF need the extra rmf")
    drawn = """
name: b
levels:
  L1:
    measurements: [[0, 1, {distance: [3, 2.0]}]]
    vertices: [[0, 0, 0, a], [20, 0, 0, b, {dock_name: [1, d]}], [10, -5, 0, ""], [10, 5, 0, ""]]
    doors: [[2, 3, {name: [1, door]}]]
    lanes:
      - [0, 1, {bidirectional: [4, true], graph_idx: [2, 0], orientation: [1, forward], speed_limit: [3, 0.5]}]
      - [1, 0, {bidirectional: [4, false], graph_idx: [2, 3], mutex: [1, m]}]
"""
    graphs = navigation_graphs(drawn, "file")
    there, back = (lane.facts for lane in graphs[0].levels["L1"].lanes)
    both = {"door_name": "door", "speed_limit": 0.5}
    assert there == both | {"orientation_constraint": "forward", "dock_name": "d"}
    assert back == both | {"orientation_constraint": "backward", "undock_name": "d"}
    (alone,) = graphs[3].levels["L1"].lanes
    assert alone.facts == {"door_name": "door", "mutex": "m", "is_bidirectional": False, "undock_name": "d"}
    assert [(vertex.x, vertex.y) for vertex in graphs[0].levels["L1"].vertices] == [(0.0, 0.0), (2.0, 0.0)]


EARTH = """
coordinate_system: {system}
name: b
parameters: {{generate_crs: [1, "{plane}"]}}
levels: {{L1: {{vertices: [[{x}, {y}, 0, a], [{x}, 0, 0, b]], lanes: [[0, 1, {{graph_idx: [2, 0]}}]]}}}}
"""
ORIGIN = 103 + 50 / 60, 1 + 22 / 60
"""Longitude and latitude of the origin of Singapore's plane, EPSG:3414 [deg]."""
EAST_M, NORTH_M = 28001.642, 38744.572
"""What its definition says is there, https://epsg.io/3414."""


def earth(system: str, x: float, y: float, plane: str = "EPSG:3414") -> str:
    for package in ("yaml", "pyproj"):
        pytest.importorskip(package, reason="the formats of Open-RMF need the extra rmf")
    return EARTH.format(system=system, x=x, y=y, plane=plane)


@pytest.mark.parametrize("system", ["wgs84", "web_mercator"])
def test_places_on_the_earth_are_in_the_plane_that_the_file_names(system):
    longitude, latitude = ORIGIN
    x, y = longitude, latitude
    if system == "web_mercator":
        x = 128 + 128 * longitude / 180
        y = 128 - 128 / math.pi * math.asinh(math.tan(math.radians(latitude)))
    vertex = navigation_graphs(earth(system, x, y), "file")[0].levels["L1"].vertices[0]
    assert (vertex.x, vertex.y) == pytest.approx((EAST_M, NORTH_M), abs=1e-3)


def test_a_plane_in_feet_becomes_metres_and_x_is_always_east():
    """State planes of the USA are in feet, and their first axis is east."""
    text = earth("wgs84", -74.0, 40 + 10 / 60, "EPSG:2263")  # its origin, at 984250 feet east
    vertex = navigation_graphs(text, "file")[0].levels["L1"].vertices[0]
    assert (vertex.x, vertex.y) == pytest.approx((300000.0, 0.0), abs=2.0)


@pytest.mark.parametrize(
    ("system", "y", "plane", "said"),
    [
        ("wgs85", 1.3, "EPSG:3414", "coordinate_system is 'wgs85'; valid: one of reference_image, cartesian_meters, "),
        ("wgs84", 1.3, "EPSG:99", "parameters.generate_crs is 'EPSG:99'; valid: a projected coordinate"),
        ("wgs84", 1.3, "EPSG:4326", "parameters.generate_crs is 'EPSG:4326', which is no plane; valid: a projected"),
        ("wgs84", 91.0, "EPSG:3414", "levels.L1.vertices[0] is at [103.8, 91.0]; valid: a place in the plane"),
    ],
)
def test_places_that_are_in_no_plane_are_refused(system, y, plane, said):
    with pytest.raises(LayoutError, match=re.escape(said)):
        navigation_graphs(earth(system, 103.8, y, plane), "file")


def test_a_map_of_the_earth_has_to_name_its_plane():
    text = earth("wgs84", 103.8, 1.3).replace("generate_crs", "crs")
    with pytest.raises(LayoutError, match=r"generate_crs is None; valid: the plane .* such as \[1, EPSG:3414\]"):
        navigation_graphs(text, "file")


def test_a_site_knows_where_its_cells_are():
    """A floor whose nodes are where a site has them keeps its coordinates to the millimetre."""
    layout = layout_of_cells(load_site("cell"))
    grid = made(layout).site.grid
    assert isinstance(grid, GridMap)
    for node in layout.nodes:
        row, col = grid.cell_at(node.x, node.y)
        assert grid.free[row, col]
