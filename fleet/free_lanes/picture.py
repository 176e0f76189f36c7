"""A picture of free lanes: what cars drive along, where they stop, nodes and stations."""

from __future__ import annotations

import math

import numpy as np

from fleet.charts.drawing import Drawing
from fleet.charts.floor import ARM, LANE, FloorFrame
from maps.free_lanes.graph import FreeLanes
from maps.grid import GridMap

PX_PER_M = 24.0
TURN, STOP, PICK, DROP = "#e0a030", "#6a7685", "#2f7d4f", "#b04a3a"


def lane_picture(lanes: FreeLanes) -> Drawing:
    """Draw lanes in grey, turns from one to another in yellow, places where cars may stand as dots, stations named."""
    graph = lanes.graph
    cols, rows = (math.ceil(size) for size in lanes.size_m)
    floor = FloorFrame(GridMap(np.ones((rows, cols), dtype=np.bool_)), px_per_m=PX_PER_M)
    for move in range(graph.n_moves):
        points = graph.path_points[graph.path_ptr[move] : graph.path_ptr[move + 1]]
        bends = abs(points[-1, 2] - points[0, 2]) > 0.1
        floor.line(points, TURN if bends else LANE, width=2.0)
    for x, y, _ in graph.state_pose.tolist():
        floor.square(x, y, 0.1, STOP)
    at = {node.name: (node.x - lanes.corner_m[0], node.y - lanes.corner_m[1]) for node in lanes.layout.nodes}
    for name, (x, y) in at.items():
        floor.square(x, y, 0.25, ARM, opacity=0.5, title=name)
    for station in lanes.layout.stations:
        floor.square(*at[station.node], 0.5, PICK if station.use == "pick" else DROP, title=station.name)
    return floor.drawing
