"""Descriptions of our own are complete XML with every number filled in."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

from fleet.robots import ARMS, TOOLS
from fleet.robots.cars.racecar import racecar_spec, racecar_urdf
from fleet.robots.description import fill
from fleet.robots.spec import HINGES, WHEELS


def joints(text: str) -> dict[str, ElementTree.Element]:
    return {joint.attrib["name"]: joint for joint in ElementTree.fromstring(text).findall("joint")}


def test_the_racecar_has_hinges_and_wheels_where_its_specification_says() -> None:
    found = joints(racecar_urdf())
    assert set(found) == {*HINGES, *(f"{wheel}_spin" for wheel in WHEELS)}
    rear_left = [float(x) for x in found["rear_left_spin"].find("origin").attrib["xyz"].split()]  # type: ignore[union-attr]
    np.testing.assert_allclose(rear_left, racecar_spec().wheel_places[0])


def test_chassis_and_tray_collide_and_the_tray_is_open() -> None:
    boxes = ElementTree.fromstring(racecar_urdf()).findall("link[@name='chassis']/collision/geometry/box")
    assert [box.attrib["size"] for box in boxes].count("0.5 0.28 0.08") == 1
    assert len(boxes) == 6  # chassis, support of the tray floor, four walls


def test_an_unknown_wheel_shape_is_refused() -> None:
    with pytest.raises(ValueError, match="'cube'; valid"):
        racecar_urdf("cube")  # type: ignore[arg-type]


@pytest.mark.parametrize("tool", TOOLS)
def test_a_tool_is_fixed_to_the_last_link_of_the_arm(tool: str) -> None:
    found = joints(ARMS["iiwa"].text(TOOLS[tool]))
    mounts = [j for j in found.values() if j.find("parent").attrib["link"] == "lbr_iiwa_link_7"]  # type: ignore[union-attr]
    assert [mount.attrib["type"] for mount in mounts] == ["fixed"]
    assert set(TOOLS[tool].finger_joints) <= set(found)


def test_a_missing_number_is_an_error() -> None:
    with pytest.raises(KeyError):
        fill("suction", flange="x")
