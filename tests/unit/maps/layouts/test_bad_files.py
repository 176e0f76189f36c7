"""Files of layouts that are broken: one line each that says where, what stands there, and what is valid."""

import json
import re

import pytest

from maps.layouts.formats import LAYOUT_FORMATS, format_of
from maps.layouts.layout import LayoutError
from maps.layouts.to_site import site_of_layout
from maps.site import load_site


def written(name):
    if not LAYOUT_FORMATS[name].headings:
        pytest.importorskip("yaml", reason="the formats of Open-RMF need the extra rmf")
    return LAYOUT_FORMATS[name].write(load_site("cell"))


def changed(path, value):
    """A change to JSON: the item at a path becomes another, or goes."""

    def change(text):
        content = json.loads(text)
        item = content
        for key in path[:-1]:
            item = item[key]
        if value is None:
            del item[path[-1]]
        else:
            item[path[-1]] = value
        return json.dumps(content)

    return change


def swapped(old, new):
    def change(text):
        assert old in text
        return text.replace(old, new, 1)

    return change


LAYOUT = ("layouts", 0)
BROKEN = [
    ("lif", lambda text: text[:500], ["is no JSON", "valid: LIF 1.0.0"]),
    ("lif", lambda text: "[1, 2]", ["is [1, 2]", "valid: LIF 1.0.0"]),
    ("lif", changed(("layouts",), None), ["layouts is missing"]),
    ("lif", changed(("layouts",), []), ["layouts are none; valid: one layout"]),
    ("lif", changed(("metaInformation", "lifVersion"), "2.0.0"), ["lifVersion is '2.0.0'; valid: 1.0.0"]),
    (
        "lif",
        changed((*LAYOUT, "nodes", 3, "nodePosition", "x"), "east"),
        ["layouts[0].nodes[3].nodePosition.x is 'east'"],
    ),
    ("lif", changed((*LAYOUT, "nodes", 3, "nodePosition", "y"), 1e9), ["nodePosition.y is 1000000000.0", "100000"]),
    ("lif", changed((*LAYOUT, "nodes", 1, "nodeId"), "r2_c2_west"), ["node 'r2_c2_west' is there twice"]),
    ("lif", changed((*LAYOUT, "edges", 0, "endNodeId"), "nowhere"), ["ends at 'nowhere'; valid: a node, one of"]),
    ("lif", changed((*LAYOUT, "edges"), []), ["no edges; valid: at least one edge"]),
    (
        "lif",
        changed((*LAYOUT, "edges", 0, "vehicleTypeEdgeProperties"), 7),
        ["vehicleTypeEdgeProperties is 7", "tuple"],
    ),
    ("lif", changed((*LAYOUT, "stations", 0, "interactionNodeIds"), ["x"]), ["station 'pick_1' is at 'x'"]),
    ("lif", changed((*LAYOUT, "stations"), []), ["no pick dock"]),
    ("opentcs", lambda text: text.replace("</model>", ""), ["line ", "is no XML", "valid: a plant model of openTCS"]),
    ("opentcs", lambda text: "<plant/>", ["the root is <plant>; valid: a plant model"]),
    ("opentcs", swapped('version="7.0.0"', 'version="5.1"'), ["version is '5.1'; valid: 6.x.x or 7.x.x"]),
    ("opentcs", swapped('positionX="', 'positionX="x'), ["point 'r2_c2_west': positionX is 'x", "a valid number"]),
    ("opentcs", swapped('positionX="', 'positionX="9999999'), ["positionX is 9999999", "millimetres up to"]),
    ("opentcs", swapped('positionY="', 'place="'), ["point 'r2_c2_west': positionY is missing"]),
    ("opentcs", swapped('sourcePoint="', 'sourcePoint="no'), ["begins at 'nor2_c2_west'"]),
    ("opentcs", swapped('type="pick"', 'type="peck"'), ["location 'pick_1': type is 'peck'; valid: one of pick, drop"]),
    ("opentcs", swapped('armYawDeg" value="', 'armYawDeg" value="N'), ["property fleet:armYawDeg is 'N0'"]),
    ("nav2", lambda text: "{}", ["type is None; valid: a route graph of Nav2"]),
    ("nav2", changed(("features",), 3), ["features is 3; valid: a list"]),
    (
        "nav2",
        changed(("features", 0, "geometry", "coordinates"), [1.0]),
        ["features[0]: geometry.coordinates[1] is missing"],
    ),
    ("nav2", changed(("features", -1, "properties", "startid"), 99999), ["begins at '99999'"]),
    ("nav2", changed(("features", -1), "x"), ["is 'x'; valid: "]),
    ("rmf", lambda text: "levels: [", ["line 2, column 1: is no YAML", "valid: a navigation graph of Open-RMF"]),
    ("rmf", lambda text: "a: 1", ["levels is None"]),
    ("rmf", swapped("- - 0\n", "- - 777\n"), ["levels.L1.lanes[0]: from is 777; valid: a vertex, 0 to"]),
    ("rmf", swapped("    - - 1.5\n", "    - - here\n"), ["levels.L1.vertices[0]: x is 'here'"]),
    ("building", lambda text: "levels: {L1: 4}", ["levels.L1 is 4; valid: vertices and lanes"]),
    ("building", lambda text: "levels: {L1: {}}", ["no lanes; valid: at least one lane"]),
    (
        "building",
        swapped("speed_limit: [3, 0.0]", "speed_limit: 4"),
        ["lanes[0]: speed_limit is 4; valid: [type, value]"],
    ),
]


@pytest.mark.parametrize("case", range(len(BROKEN)), ids=lambda k: f"{BROKEN[k][0]}-{k}")
def test_a_broken_file_is_refused_in_one_line(case):
    name, change, expected = BROKEN[case]
    with pytest.raises(ValueError, match="file") as refusal:
        site_of_layout(LAYOUT_FORMATS[name].read(change(written(name)), "file"), name="made", where="file")
    said = str(refusal.value)
    assert said.startswith("file: ")
    assert "\n" not in said
    assert re.search(r"; valid: \S", said)
    for words in expected:
        assert words in said


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("a.lif.json", "lif"),
        ("A.XML", "opentcs"),
        ("m.building.yaml", "building"),
        ("0.yaml", "rmf"),
        ("g.geojson", "nav2"),
    ],
)
def test_a_format_is_told_by_the_name_of_the_file(file, name):
    assert format_of(file) == name


def test_a_name_that_says_nothing_is_refused():
    with pytest.raises(LayoutError, match=r"floor.dwg: the name says no format; valid: --format lif\|opentcs"):
        format_of("floor.dwg")
