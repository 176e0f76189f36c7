"""Broken: files of layouts with one fault each, which have to be refused in one line that names it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from typing import Any

from benchmarks.harness import Row, Trial
from benchmarks.interop.others import package
from maps.errors import MapsError
from maps.layouts.formats import LAYOUT_FORMATS
from maps.layouts.to_site import site_of_layout
from maps.site import load_site

Change = Callable[[str], str]
_LAYOUT = ("layouts", 0)
GROWING = "a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 10))
"""Some hundred characters of YAML that stand for a thousand million values."""


def changed(path: tuple[str | int, ...], value: Any) -> Change:
    """A change to JSON: the item at a path becomes another, or goes if that is None."""

    def change(text: str) -> str:
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


def swapped(old: str, new: str) -> Change:
    """A change to text: the first of some words become others."""

    def change(text: str) -> str:
        if old not in text:
            raise ValueError(f"no {old!r} to be changed")
        return text.replace(old, new, 1)

    return change


BROKEN: list[tuple[str, Change, list[str]]] = [
    ("lif", lambda text: text[:500], ["is no JSON", "valid: LIF 1.0.0"]),
    ("lif", lambda text: "[1, 2]", ["is [1, 2]", "valid: LIF 1.0.0"]),
    ("lif", changed(("layouts",), None), ["layouts is missing"]),
    ("lif", changed(("layouts",), []), ["layouts are none; valid: one layout"]),
    ("lif", changed(("metaInformation", "lifVersion"), "2.0.0"), ["lifVersion is '2.0.0'; valid: 1.0.0"]),
    (
        "lif",
        changed((*_LAYOUT, "nodes", 3, "nodePosition", "x"), "east"),
        ["layouts[0].nodes[3].nodePosition.x is 'east'"],
    ),
    ("lif", changed((*_LAYOUT, "nodes", 3, "nodePosition", "y"), 1e9), ["nodePosition.y is 1000000000.0", "100000"]),
    ("lif", changed((*_LAYOUT, "nodes", 1, "nodeId"), "r1_c1_west"), ["node 'r1_c1_west' is there twice"]),
    ("lif", changed((*_LAYOUT, "edges", 0, "endNodeId"), "nowhere"), ["ends at 'nowhere'; valid: a node, one of"]),
    ("lif", changed((*_LAYOUT, "edges"), []), ["no edges; valid: at least one edge"]),
    (
        "lif",
        changed((*_LAYOUT, "edges", 0, "vehicleTypeEdgeProperties"), 7),
        ["vehicleTypeEdgeProperties is 7", "tuple"],
    ),
    ("lif", changed((*_LAYOUT, "stations", 0, "interactionNodeIds"), ["x"]), ["station 'pick_1' is at 'x'"]),
    (
        "lif",
        changed((*_LAYOUT, "stations", 0, "interactionNodeIds"), ["r1_c1_west", "ghost"]),
        ["station 'pick_1' is at 'ghost'; valid: a node, one of"],
    ),
    ("lif", changed((*_LAYOUT, "stations"), []), ["no pick dock"]),
    ("opentcs", lambda text: text.replace("</model>", ""), ["line ", "is no XML", "valid: a plant model of openTCS"]),
    ("opentcs", lambda text: "<plant/>", ["the root is <plant>; valid: a plant model"]),
    ("opentcs", swapped('version="7.0.0"', 'version="5.1"'), ["version is '5.1'; valid: 6.x.x or 7.x.x"]),
    ("opentcs", swapped('positionX="', 'positionX="x'), ["point 'r1_c1_west': positionX is 'x", "a valid number"]),
    ("opentcs", swapped('positionX="', 'positionX="9999999'), ["positionX is 9999999", "millimetres up to"]),
    ("opentcs", swapped('positionY="', 'place="'), ["point 'r1_c1_west': positionY is missing"]),
    ("opentcs", swapped('sourcePoint="', 'sourcePoint="no'), ["begins at 'nor1_c1_west'"]),
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
    ("rmf", lambda text: GROWING, ["is no YAML (its aliases make more than 10000000 values of it)"]),
    ("building", lambda text: "levels: &a [*a]", ["is no YAML (an alias stands inside of what it stands for)"]),
    ("rmf", swapped("- - 0\n", "- - 777\n"), ["levels.L1.lanes[0]: from is 777; valid: a vertex, 0 to"]),
    ("rmf", swapped("    - - 1.5\n", "    - - here\n"), ["levels.L1.vertices[0]: x is 'here'"]),
    ("building", lambda text: "levels: {L1: 4}", ["levels.L1 is 4; valid: vertices and lanes"]),
    ("building", lambda text: "levels: {L1: {}}", ["no lanes; valid: at least one lane"]),
    (
        "building",
        swapped("speed_limit: [3, 0.0]", "speed_limit: 4"),
        ["lanes[0]: speed_limit is 4; valid: [type, value]"],
    ),
    (
        "building",
        swapped("distance: [3, 12.0]", "distance: [3, -12.0]"),
        ["measurements[0]: distance is -12.0; valid: a length > 0"],
    ),
    ("building", swapped("orientation: [1, forward]", "orientation: [1, [1, 2]]"), ["lanes[0]: orientation is [1, 2]"]),
    ("building", swapped("graph_idx: [2, 0]", "graph_idx: [2, 12]"), ["lanes[0]: graph_idx is 12; valid: "]),
    ("building", swapped("    - - 0\n      - 10\n", "    - - 0.7\n      - 10\n"), ["lanes[0]: vertex 0.7; valid: "]),
    (
        "opentcs",
        swapped('armYawDeg" value="0"', 'armYawDeg" value="inf"'),
        ["fleet:armYawDeg is 'inf'; valid: a number"],
    ),
]
"""Format, what is changed in the file of the site `cell`, and what the refusal has to say."""


def refusal(name: str, change: Change) -> str:
    """What is said of a broken file; empty if nothing is.

    Args:
        name: Of the format.
        change: What breaks the file.
    """
    layout_format = LAYOUT_FORMATS[name]
    try:
        site_of_layout(
            layout_format.read(change(layout_format.write(load_site("cell"))), "file"), name="s", where="file"
        )
    except MapsError as error:
        return str(error)
    return ""


def well_said(said: str, expected: Iterable[str]) -> bool:
    """Whether a refusal is one line that begins with the file, ends with what is valid, and says what it should."""
    one_line = said.startswith("file: ") and "\n" not in said and re.search(r"; valid: \S", said) is not None
    return one_line and all(words in said for words in expected)


def measure_broken(trial: Trial) -> Iterable[Row]:
    """Break a file in every way of the table."""
    if package("yaml", trial, "L5") is None:
        return
    faults = [(name, expected, refusal(name, change)) for name, change, expected in BROKEN]
    for name, expected, said in faults:
        trial.check(well_said(said, expected), f"L5: {name}, expected {expected}: {said!r}")
    yield Row(name="L5 broken files refused by name in one line", value=len(faults), unit="files", target=">= 20")
