"""Waiting cells: where a vehicle on a lane is in nobody's way to a bay."""

from __future__ import annotations

import numpy as np
import pytest

from maps.lane_graph import build_lane_graph
from maps.site import load_site
from maps.waiting_cells import waiting_cells


@pytest.mark.parametrize("name", ["small", "medium", "dense"])
def test_no_move_into_or_out_of_a_bay_leads_through_a_waiting_cell(name: str) -> None:
    site = load_site(name)
    graph = build_lane_graph(site)
    waiting = set(waiting_cells(site, graph).tolist())
    bays = set(site.bays().values())
    assert waiting
    assert not waiting & bays
    for move in range(graph.n_moves):
        ends = {int(graph.state_cell[graph.move_from[move]]), int(graph.state_cell[graph.move_to[move]])}
        if ends & bays:
            swept = graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]]
            assert not waiting & set(swept.tolist())


def test_every_waiting_cell_is_on_a_lane_of_one_direction() -> None:
    site = load_site("medium")
    lanes = {(int(a), int(b)) for a, b in site.lanes}
    cells = waiting_cells(site, build_lane_graph(site))
    assert np.isin(cells, site.lanes).all()
    assert not [lane for lane in lanes if lane[::-1] in lanes and lane[0] in cells]
