"""The table of robots: every figure has a source, and the courses are what they say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fleet.errors import ConfigError
from fleet.proving.course import CURVES, CURVES_AND_TURNS, LANES, Course
from fleet.proving.sheets import SHEETS, described_mass_kg, robot_sheet
from fleet.proving.vehicles import VEHICLES
from fleet.robots import ARMS
from fleet.robots.standing import STANDING


def test_all_robots_are_there() -> None:
    assert set(SHEETS) == {*ARMS, *VEHICLES, *STANDING}


@pytest.mark.parametrize("name", SHEETS)
def test_every_figure_of_a_sheet_has_a_value_and_a_source(name: str) -> None:
    sheet = robot_sheet(name)
    assert sheet.name == name
    assert sheet.mass_kg > 1.0
    assert sheet.figures
    assert all(figure.name and figure.value and figure.source for figure in sheet.figures)
    told = {figure.name for figure in sheet.figures}
    assert {"mass"} <= told
    assert ("max payload" in told) == (sheet.payload_kg is not None)


def test_an_unknown_robot_is_refused_with_the_valid_ones() -> None:
    with pytest.raises(
        ConfigError, match=r"'huskey' \(did you mean husky\?\); valid: racecar, husky, a1, lifter, iiwa"
    ):
        robot_sheet("huskey")


def test_masses_are_summed_also_of_a_file_that_is_no_clean_xml() -> None:
    assert described_mass_kg(STANDING["humanoid"].path) == pytest.approx(45.0, abs=0.1)


def test_courses_end_where_their_legs_lead() -> None:
    assert CURVES.way_m == pytest.approx(7.0 + 4 * 0.5 * math.pi / 2, abs=0.001)
    np.testing.assert_allclose(LANES.line[-1], [0.0, 0.0, 2 * math.pi], atol=1e-9)
    assert LANES.way_m == pytest.approx(50.0)
    assert CURVES_AND_TURNS.leg_at(0.0) == 0
    assert CURVES_AND_TURNS.leg_at(1e9) == len(CURVES_AND_TURNS.legs) - 1


def test_distances_from_a_course_are_those_near_the_progress() -> None:
    assert CURVES.off(np.array([1.0, 0.2]), 1.0) == pytest.approx(0.2)
    # The lanes come back to their start: what counts is where on the way the vehicle is.
    assert LANES.off(np.array([0.0, 1.0]), 1.0) == pytest.approx(math.hypot(0.5, 1.0), abs=0.05)
    assert LANES.off(np.array([0.0, 1.0]), float(LANES.ends_s[6]) - 1.0) == pytest.approx(0.0, abs=0.02)


def test_the_way_back_to_a_lane_ends_there() -> None:
    course = Course.back_to(np.array([-0.3, 0.6, 0.3]))
    np.testing.assert_allclose(course.line[-1, :2], [-0.3, 0.6], atol=1e-9)
    assert [leg.kind for leg in course.legs] == ["turn", "straight", "turn"]
    assert course.paths().end_s(0) == pytest.approx(float(course.ends_s[-1]))
