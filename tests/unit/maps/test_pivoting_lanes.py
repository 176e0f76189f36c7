"""Lanes of vehicles that turn on the spot, and floors of wider cells."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.errors import PlanError
from maps.lane_graph import LEFT, RIGHT, STRAIGHT, build_lane_graph
from maps.site import load_site, save_site
from maps.vehicle import TURN_M_PER_RAD, Footprint
from maps.warehouse import generate_warehouse

WIDE = generate_warehouse(rows=12, cols=16, pick=2, drop=2, parking=6, rack_cols=3, cell_m=1.25)
BODY = Footprint(front_m=0.495, rear_m=0.495, half_width_m=0.345, turn_radius_m=0.0, pivots=True)


def test_a_vehicle_that_turns_on_the_spot_waits_in_the_middle_of_its_cell() -> None:
    graph = build_lane_graph(WIDE, footprint=BODY)
    np.testing.assert_allclose(graph.state_pose[:, :2], WIDE.grid.cell_xy(graph.state_cell), atol=1e-12)
    assert graph.n_moves == build_lane_graph(WIDE).n_moves


def test_a_turn_is_a_quarter_on_the_spot_and_a_cell_ahead() -> None:
    graph = build_lane_graph(WIDE, footprint=BODY)
    for kind, side in ((LEFT, 1.0), (RIGHT, -1.0), (STRAIGHT, 0.0)):
        move = int(np.flatnonzero(graph.move_kind == kind)[0])
        points = graph.path_points[graph.path_ptr[move] : graph.path_ptr[move + 1]]
        s = graph.path_s[graph.path_ptr[move] : graph.path_ptr[move + 1]]
        turned = TURN_M_PER_RAD * abs(side) * math.pi / 2
        assert s[-1] == pytest.approx(1.25 + turned) == pytest.approx(graph.move_length[move])
        assert (np.diff(s) > 0.0).all()
        assert points[-1, 2] - points[0, 2] == pytest.approx(side * math.pi / 2)
        spot = s <= turned + 1e-9
        np.testing.assert_allclose(points[spot, :2], points[[0] * int(spot.sum()), :2])
        end = graph.state_pose[graph.move_to[move]]
        np.testing.assert_allclose(points[-1, :2], end[:2], atol=1e-9)


def test_a_body_turns_within_cells_that_are_as_wide_as_its_diagonal_only() -> None:
    graph = build_lane_graph(WIDE, footprint=BODY)
    assert (np.diff(graph.swept_ptr) == 2).all()
    narrow = generate_warehouse(rows=12, cols=16, pick=2, drop=2, parking=6, rack_cols=3)
    turns = np.isin(build_lane_graph(narrow, footprint=BODY).move_kind, (LEFT, RIGHT)).sum()
    assert turns < np.isin(graph.move_kind, (LEFT, RIGHT)).sum() / 2


def test_arms_stand_beside_wide_docks_and_the_site_comes_back_from_its_file(tmp_path) -> None:
    for station in WIDE.stations:
        away = math.dist(station.dock.tray_xy, station.arm.pose[:2])
        assert away == pytest.approx(0.63)
    save_site(WIDE, tmp_path / "wide.toml")
    assert load_site(tmp_path / "wide.toml") == WIDE


@pytest.mark.parametrize("cell_m", [0.9, 1.3, math.nan])
def test_cells_of_other_sizes_are_refused(cell_m: float) -> None:
    with pytest.raises(PlanError, match=r"cell_m is .*; valid: a number from 1 to 1\.25"):
        generate_warehouse(rows=12, cols=16, pick=2, drop=2, parking=6, cell_m=cell_m)
