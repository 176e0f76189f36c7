"""Auto takes the planner that suits the floor and the density."""

from __future__ import annotations

import pytest

from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import load_site
from planners.mapf.multi_step.multi_step_pibt import MultiStepPibt
from planners.mapf.window_search.auto import Auto
from planners.mapf.window_search.window_search import WindowSearch
from tests.unit.planners.mapf.lanes import instance_of, open_grid, rotating_grid


@pytest.mark.parametrize(
    ("graph", "n", "chosen"),
    [
        (open_grid(4, 6), 8, WindowSearch),
        (open_grid(4, 6), 9, MultiStepPibt),
        (rotating_grid(4, 6), 2, MultiStepPibt),
        (build_lane_graph(load_site("cell")), 2, MultiStepPibt),
    ],
)
def test_the_planner_suits_motion_and_density(graph: LaneGraph, n: int, chosen: type) -> None:
    planner = Auto(seed=0)
    starts = graph.first_states(list(dict.fromkeys(graph.state_cell.tolist()))[:n]).tolist()
    planner.plan(instance_of(graph, starts, starts))
    assert isinstance(planner.chosen, chosen)


def test_another_number_of_agents_is_another_choice() -> None:
    planner, graph = Auto(seed=0), open_grid(4, 6)
    for n, chosen in ((4, WindowSearch), (20, MultiStepPibt), (4, WindowSearch)):
        planner.plan(instance_of(graph, list(range(n)), list(range(n))))
        assert isinstance(planner.chosen, chosen)
