"""Footprints: cells under a body, and the lanes that have room for it."""

from __future__ import annotations

import numpy as np
import pytest

from maps.lane_graph import LEFT, RIGHT, build_lane_graph
from maps.site import load_site
from maps.vehicle import Footprint

CAR = Footprint(front_m=0.41, rear_m=0.09, half_width_m=0.14, turn_radius_m=0.32)
BUS = Footprint(front_m=0.65, rear_m=0.09, half_width_m=0.3, turn_radius_m=0.4)
SITE = load_site("small")


def test_a_body_is_in_the_cells_that_it_touches() -> None:
    assert CAR.cells(np.array([[0.0, 0.0, 0.0]]), 1.0) == {(0, 0)}
    assert CAR.cells(np.array([[0.2, 0.0, 0.0]]), 1.0) == {(0, 0), (1, 0)}
    assert CAR.cells(np.array([[0.0, 0.45, 0.0]]), 1.0) == {(0, 0), (0, 1)}
    # Turned by 45 degrees: the box round it reaches into four cells, its corners into two beside its own.
    assert CAR.cells(np.array([[0.2, 0.2, np.pi / 4]]), 1.0) == {(0, 0), (1, 0), (0, 1)}
    assert CAR.cells(np.array([[0.35, 0.0, np.pi / 4]]), 1.0) == {(0, 0), (1, 0)}


def test_lanes_for_the_usual_car_are_those_that_need_no_footprint() -> None:
    plain, fitted = build_lane_graph(SITE), build_lane_graph(SITE, footprint=CAR)
    for name in ("move_from", "move_to", "swept_ptr", "swept_cell", "path_points", "state_index"):
        assert np.array_equal(getattr(plain, name), getattr(fitted, name)), name


def test_a_longer_body_sweeps_more_cells_where_it_turns_and_keeps_to_lanes() -> None:
    graph = build_lane_graph(SITE, footprint=BUS)
    n_swept = np.diff(graph.swept_ptr)
    turns = np.isin(graph.move_kind, (LEFT, RIGHT))
    assert n_swept[~turns].max() == 2
    assert n_swept[turns].min() == 4
    drivable = (graph.state_index >= 0).any(axis=1)
    assert drivable[graph.swept_cell].all()
    assert 0 < turns.sum() < np.isin(build_lane_graph(SITE).move_kind, (LEFT, RIGHT)).sum()
    for move in np.flatnonzero(turns).tolist():
        swept = graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]].tolist()
        assert swept[:2] == graph.state_cell[[graph.move_from[move], graph.move_to[move]]].tolist()
        path = graph.path_points[graph.path_ptr[move] : graph.path_ptr[move + 1]]
        row, col = SITE.grid.rows - 0.5, 0.5  # cell (0, 0) of a footprint is the one whose middle is the origin
        under = BUS.cells(path - (col, 0.5, 0.0), 1.0)
        assert {int(SITE.grid.index(int(row - 0.5 - j), i)) for i, j in under} == set(swept)


@pytest.mark.parametrize(
    "footprint",
    [
        Footprint(front_m=0.41, rear_m=0.2, half_width_m=0.14, turn_radius_m=0.4),
        Footprint(front_m=0.95, rear_m=0.09, half_width_m=0.14, turn_radius_m=0.4),
        Footprint(front_m=0.41, rear_m=0.09, half_width_m=0.55, turn_radius_m=0.4),
    ],
    ids=["tail", "nose", "sides"],
)
def test_a_body_that_does_not_stand_in_a_cell_has_no_moves(footprint: Footprint) -> None:
    assert build_lane_graph(SITE, footprint=footprint).n_moves == 0


def test_a_vehicle_that_turns_too_wide_drives_straight_on() -> None:
    graph = build_lane_graph(SITE, footprint=Footprint(front_m=0.41, rear_m=0.09, half_width_m=0.14, turn_radius_m=0.5))
    assert graph.n_moves > 0
    assert not np.isin(graph.move_kind, (LEFT, RIGHT)).any()
