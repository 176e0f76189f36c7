"""What tools hold."""

from __future__ import annotations

import pytest

from fleet.robots.tools import TOOLS
from fleet.tasks.order import MAX_GENERATED_KG, MAX_MASS_KG


@pytest.mark.parametrize("name", TOOLS)
def test_a_tool_holds_every_parcel_there_is_and_more_with_more_force(name):
    tool = TOOLS[name]
    assert tool.payload_kg() >= 2.0 > MAX_GENERATED_KG
    assert max(tool.payload_kg() for tool in TOOLS.values()) >= MAX_MASS_KG
    assert tool.payload_kg(tool.force_n / 2) == pytest.approx(tool.payload_kg() / 2)


def test_fingers_hold_three_times_the_weight_by_what_two_pads_rub():
    assert TOOLS["friction"].payload_kg(10.0) * 3 * 9.81 == pytest.approx(2 * 1.0 * 0.8 * 10.0)
