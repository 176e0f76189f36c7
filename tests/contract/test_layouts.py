"""What every format of `LAYOUT_FORMATS` must fulfil on every site that ships: the same lane graph comes back."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from maps.lane_graph import LaneGraph, build_lane_graph
from maps.layouts.formats import LAYOUT_FORMATS
from maps.layouts.to_site import ImportedSite, site_of_layout
from maps.site import Site, load_site, save_site, site_names

INSTANCES = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[3] / "shared" / "instances")) / "interop"
SAME = ("state_cell", "state_heading", "state_pose", "move_from", "move_to", "move_kind", "move_length", "swept_cell")


def there_and_back(name: str, site: Site) -> ImportedSite:
    layout_format = LAYOUT_FORMATS[name]
    if not layout_format.headings:
        pytest.importorskip("yaml", reason="the formats of Open-RMF need the extra rmf")
    return site_of_layout(layout_format.read(layout_format.write(site), "file"), name=site.name, where="file")


def same(one: LaneGraph, other: LaneGraph) -> bool:
    pairs = [(getattr(one, name), getattr(other, name)) for name in SAME]
    return all(a.shape == b.shape and np.allclose(a, b, rtol=0.0, atol=1e-6) for a, b in pairs)


@pytest.fixture(scope="module", params=site_names())
def site(request: pytest.FixtureRequest) -> Site:
    return load_site(request.param)


@pytest.mark.parametrize("name", LAYOUT_FORMATS)
def test_a_site_comes_back_with_the_same_lane_graph(name: str, site: Site, tmp_path: Path) -> None:
    made = there_and_back(name, site)
    assert same(build_lane_graph(site), build_lane_graph(made.site))
    assert made.site.bays().keys() >= {f"parking_{k}" for k in range(1, len(site.parking) + 1)}
    assert (made.site.parking, made.site.chargers) == (site.parking, site.chargers)
    assert made.notes == ()
    if LAYOUT_FORMATS[name].headings:
        assert made.site.stations == site.stations
        assert made.names == {station.name: station.name for station in site.stations}
    else:
        docks = {station.dock.cell: station.dock for station in site.stations}
        assert {station.dock.cell: station.dock for station in made.site.stations} == docks
    save_site(made.site, tmp_path / "site.toml")
    assert load_site(tmp_path / "site.toml") == made.site


@pytest.mark.parametrize("name", [name for name in LAYOUT_FORMATS if name != "building"])
def test_what_came_back_is_written_as_the_same_file(name: str, site: Site) -> None:
    made = there_and_back(name, site)
    assert LAYOUT_FORMATS[name].write(made.site) == LAYOUT_FORMATS[name].write(site)


def test_lif_is_what_its_schema_says(site: Site) -> None:
    jsonschema = pytest.importorskip("jsonschema", reason="the check by the schema needs the extra interop")
    path = INSTANCES / "lif" / "LIF.schema"
    if not path.is_file():
        pytest.skip(f"no {path}; set FLEET_INSTANCES to the folder that holds interop")
    schema = json.loads(path.read_text(encoding="utf-8-sig"))
    content = json.loads(LAYOUT_FORMATS["lif"].write(site))
    assert [error.message for error in jsonschema.Draft7Validator(schema).iter_errors(content)] == []


def test_lif_is_read_by_somebody_else(site: Site) -> None:
    parser = pytest.importorskip("vdma_lif.parser", reason="the other reader needs the extra interop")
    text = LAYOUT_FORMATS["lif"].write(site)
    read = parser.LIFParser.from_json(text)
    graph = build_lane_graph(site)
    assert (len(read.layouts[0].nodes), len(read.layouts[0].edges)) == (graph.n_states, graph.n_moves)
    again = json.loads(parser.LIFParser.to_json(read))
    ours = json.loads(text)
    assert again["layouts"] == ours["layouts"]


def test_opentcs_is_what_its_schema_says(site: Site) -> None:
    etree = pytest.importorskip("lxml.etree", reason="the check by the schema needs the extra interop")
    path = INSTANCES / "opentcs" / "model-7.0.0.xsd"
    if not path.is_file():
        pytest.skip(f"no {path}; set FLEET_INSTANCES to the folder that holds interop")
    model = etree.fromstring(LAYOUT_FORMATS["opentcs"].write(site).encode())
    schema = etree.XMLSchema(etree.parse(path))
    assert schema.validate(model), schema.error_log


def test_a_block_is_what_a_grant_is(site: Site) -> None:
    """All states in a cell, and all moves that touch it, are one block of openTCS."""
    from xml.etree import ElementTree

    model = ElementTree.fromstring(LAYOUT_FORMATS["opentcs"].write(site))
    graph = build_lane_graph(site)
    cells = sorted(set(graph.state_cell.tolist()))
    assert len(model.findall("block")) == len(cells)
    paths = {path.get("name"): (path.get("sourcePoint"), path.get("destinationPoint")) for path in model.iter("path")}
    for block in model.findall("block"):
        name = (block.get("name") or "").removeprefix("block_")
        members = {member.get("name") for member in block.findall("member")}
        points = {member for member in members if member not in paths}
        assert all(point is not None and point.startswith(f"{name}_") for point in points)
        touching = {path for path, ends in paths.items() if any(str(end).startswith(f"{name}_") for end in ends)}
        assert members - points == touching


def test_lif_has_angles_between_minus_pi_and_pi(site: Site) -> None:
    content = json.loads(LAYOUT_FORMATS["lif"].write(site))["layouts"][0]
    nodes = [of["theta"] for node in content["nodes"] for of in node["vehicleTypeNodeProperties"]]
    arms = [station["stationPosition"]["theta"] for station in content["stations"] if "stationPosition" in station]
    assert all(-np.pi <= theta <= np.pi for theta in nodes + arms)


def test_curves_of_lif_are_the_ways_that_cars_drive(site: Site) -> None:
    """A NURBS of every kind of move runs along the path of the lane graph, within a tenth of a millimetre."""
    from scipy.interpolate import BSpline

    graph = build_lane_graph(site)
    edges = json.loads(LAYOUT_FORMATS["lif"].write(site))["layouts"][0]["edges"]
    kinds, first = np.unique(graph.move_kind, return_index=True)
    assert len(kinds) >= 3
    for move in first.tolist():
        curve = edges[move]["vehicleTypeEdgeProperties"][0]["trajectory"]
        points = np.array([(p["x"] * p["weight"], p["y"] * p["weight"], p["weight"]) for p in curve["controlPoints"]])
        assert points[:, 2].min() >= 1.0
        spline = BSpline(np.array(curve["knotVector"]), points, curve["degree"])
        drawn = spline(np.linspace(0.0, 1.0, 2000))
        drawn = drawn[:, :2] / drawn[:, 2:]
        path = graph.path_points[graph.path_ptr[move] : graph.path_ptr[move + 1], :2]
        away = np.linalg.norm(path[:, None] - drawn[None], axis=2).min(axis=1)
        assert away.max() <= 5e-4
        length = np.linalg.norm(np.diff(drawn, axis=0), axis=1).sum()
        assert length == pytest.approx(graph.move_length[move], abs=1e-5)
