"""A layout on no grid, drawn anew: what leads where is as before, on cells that a site can be made of."""

import os
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import Delaunay

from maps.layouts.layout import FloorLayout, LayoutEdge, LayoutError, LayoutNode, LayoutStation
from maps.layouts.opentcs import read_opentcs
from maps.layouts.redraw import redrawn
from maps.layouts.rmf.building import read_building
from maps.layouts.to_site import site_of_layout

INSTANCES = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[5] / "shared" / "instances")) / "interop"


def planar(seed, n=9, both=False, kept=1.0):
    """Nodes anywhere, edges of their triangulation, one way or both ways."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 30.0, (n, 2))
    pairs = {
        tuple(sorted((int(a), int(b)))) for t in Delaunay(xy).simplices for a, b in zip(t, np.roll(t, 1), strict=True)
    }
    ends = [pair if both or rng.random() < 0.5 else pair[::-1] for pair in sorted(pairs)]
    ends = [pair for pair in ends if rng.random() < kept]
    ends += [pair[::-1] for pair in ends] if both else []
    nodes = tuple(LayoutNode(name=f"n{k}", x=x, y=y) for k, (x, y) in enumerate(xy.tolist()))
    edges = tuple(LayoutEdge(name=f"{a}>{b}", start=f"n{a}", end=f"n{b}") for a, b in ends)
    return FloorLayout(name="planar", nodes=nodes, edges=edges)


def direct(layout, names):
    """Pairs of nodes of which one leads to the other without passing a third."""
    following = defaultdict(list)
    for edge in layout.edges:
        following[edge.start].append(edge.end)
    found = set()
    for name in names:
        seen, frontier = set(), [name]
        while frontier:
            for other in following[frontier.pop()]:
                if other in names:
                    found.add((name, other))
                elif other not in seen:
                    seen.add(other)
                    frontier.append(other)
    return found


@pytest.mark.parametrize("both", [False, True], ids=["one way", "both ways"])
@pytest.mark.parametrize("kept", [0.5, 1.0])
@pytest.mark.parametrize("seed", [0, 2, 3, 4, 5])
def test_what_leads_where_stays(seed, both, kept):
    layout = planar(seed, both=both, kept=kept)
    drawn = redrawn(layout, "file")
    names = {node.name for node in layout.nodes}
    before = {(edge.start, edge.end) for edge in layout.edges}
    after = {pair for pair in direct(drawn.layout, names) if pair[0] != pair[1]}
    assert after >= before
    if drawn.n_crossings == 0:
        assert after == before
    at = {node.name: (node.x, node.y) for node in drawn.layout.nodes}
    lanes = {(at[edge.start], at[edge.end]) for edge in drawn.layout.edges}
    assert len(set(at.values())) == len(at)
    assert all(abs(a[0] - b[0]) + abs(a[1] - b[1]) == 1.0 for a, b in lanes)
    assert not {(b, a) for a, b in lanes} & lanes, "cars would meet head-on"


def test_floors_without_crossings_are_drawn_without():
    drawings = [redrawn(planar(seed, kept=0.5), "file") for seed in range(8)]
    assert sum(drawing.n_crossings == 0 for drawing in drawings) >= 4


def test_ways_that_cannot_be_told_apart_are_refused_by_name():
    """A node amid eight others in the cells round it, however large the floor."""
    middle = LayoutNode(name="middle", x=0.0, y=0.0)
    places = [(x, y) for x in (-0.01, 0.0, 0.01) for y in (-0.01, 0.0, 0.01) if (x, y) != (0.0, 0.0)]
    around = [LayoutNode(name=f"n{k}", x=x, y=y) for k, (x, y) in enumerate(places)]
    far = LayoutNode(name="far", x=20.0, y=0.0)
    edges = (LayoutEdge(name="shut in", start="middle", end="far"),)
    layout = FloorLayout(name="crowd", nodes=(middle, *around, far), edges=edges)
    with pytest.raises(LayoutError, match=r"file: no way was found for edge 'shut in'.*; valid: "):
        redrawn(layout, "file")


def test_the_demo_of_opentcs_becomes_a_site():
    path = INSTANCES / "opentcs" / "Demo-01.xml"
    if not path.is_file():
        pytest.skip(f"no {path}; set FLEET_INSTANCES to the folder that holds interop")
    layout = read_opentcs(path.read_text(encoding="utf-8"), "demo")
    with pytest.raises(LayoutError, match=r"node 'Point-0015' at \(7.85, -11.00\) m lies 0.15 m beside the grid"):
        site_of_layout(layout, name="demo", where="demo")
    drawn = redrawn(layout, "demo")
    made = site_of_layout(drawn.layout, name="demo", where="demo")
    assert drawn.scale == 1
    assert drawn.length_ratio < 1.25
    assert sorted(made.names.values()) == sorted(station.name for station in layout.stations)
    assert len(made.site.chargers) + len(made.site.parking) == 5


def test_the_office_of_open_rmf_becomes_one_way():
    pytest.importorskip("yaml", reason="the formats of Open-RMF need the extra rmf")
    path = INSTANCES / "rmf" / "office.building.yaml"
    if not path.is_file():
        pytest.skip(f"no {path}; set FLEET_INSTANCES to the folder that holds interop")
    made = site_of_layout(
        redrawn(read_building(path.read_text(encoding="utf-8"), "office"), "office").layout,
        name="office",
        where="office",
    )
    lanes = {(int(a), int(b)) for a, b in made.site.lanes}
    assert not {(b, a) for a, b in lanes} & lanes
    assert made.path_ratio < 1.6
    assert made.names == {"pick_1": "coke_dispenser", "drop_1": "coke_ingestor_2", "drop_2": "coke_ingestor"}


def test_a_dock_has_one_way_in():
    layout = planar(3)
    node = max(layout.nodes, key=lambda node: sum(edge.end == node.name for edge in layout.edges))
    assert sum(edge.end == node.name for edge in layout.edges) >= 2
    drawn = redrawn(replace(layout, stations=(LayoutStation(name="s", use="pick", node=node.name),)), "file").layout
    assert sum(edge.end == node.name for edge in drawn.edges) == 1
