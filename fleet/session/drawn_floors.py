"""Drawn floors: what recordings show of yards and of lanes on no grid, beside the cars."""

from __future__ import annotations

import math

import numpy as np

from fleet.arrays import FloatArray
from fleet.recording import DrawnFloor
from fleet.robots.cars.models import usual_car
from maps.free_lanes.graph import FreeLanes
from maps.yard import KINDS, Yard

_ARROWS_M = 1.0
"""Between the signs that show where a lane leads [m]."""


def yard_floor(yard: Yard) -> DrawnFloor:
    """Spots, and a name for each kind of them, beyond the spot in the middle of those."""
    bays = _middles(yard.spots)
    in_the_middle = [int(spots[len(spots) // 2]) for spots in (yard.picks, yard.drops)]
    ahead = np.column_stack((np.cos(yard.spots[:, 2]), np.sin(yard.spots[:, 2])))
    return DrawnFloor(
        name=yard.name,
        lanes=np.empty((0, 2, 2)),
        station_names=KINDS,
        station_xy=bays[in_the_middle] + ahead[in_the_middle],
        dock_xy=bays[in_the_middle],
        parking_xy=bays,
    )


def lane_floor(lanes: FreeLanes) -> DrawnFloor:
    """Where lanes lead, where cars stand at stations, with their names, and where they stand at nodes to park at."""
    graph, nodes = lanes.graph, {node.name: node for node in lanes.layout.nodes}
    signs = []
    for move in range(graph.n_moves):
        part = slice(graph.path_ptr[move], graph.path_ptr[move + 1])
        s, points = graph.path_s[part], graph.path_points[part]
        n_signs = max(1, math.floor(s[-1] / _ARROWS_M))
        along = (np.arange(n_signs) + 0.5) * s[-1] / n_signs
        ends = along[:, None] + np.array([-0.05, 0.05])
        signs.append(np.stack([np.interp(ends, s, points[:, k]) for k in (0, 1)], axis=2))
    stations = lanes.layout.stations
    beside = [
        (nodes[station.node].x, nodes[station.node].y)
        if station.x is None or station.y is None
        else (station.x, station.y)
        for station in stations
    ]
    parks = [node.name for node in lanes.layout.nodes if node.parking and node.name in lanes.states_at]
    return DrawnFloor(
        name=lanes.layout.name,
        lanes=np.concatenate(signs),
        station_names=tuple(station.name for station in stations),
        station_xy=np.array(beside).reshape(-1, 2) - lanes.corner_m,
        dock_xy=_middles(graph.state_pose[[lanes.states_at[station.node][0] for station in stations]]),
        parking_xy=_middles(graph.state_pose[[lanes.states_at[name][0] for name in parks]]),
    )


def _middles(poses: FloatArray) -> FloatArray:
    """Middles of the bodies of cars that stand somewhere [m], shape (n, 2)."""
    car = usual_car()
    ahead = np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    return np.asarray(poses[:, :2] + 0.5 * (car.front_m - car.rear_m) * ahead)
