"""LaneWays: from wherever a car is, the ways along lanes to the stops of all arms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from maps.lane_graph import LaneGraph
from planners.mapf.distance_table import UNREACHABLE, DistanceTable

AHEAD_M: FloatArray = np.array([0.4, 0.8, 1.6])
"""Distances ahead at which a way is told [m]."""
AT_STOP_M, AT_STOP_RAD = 0.6, 0.6
"""So near to a stop, and so straight, a car is measured against the stop itself, and may be beyond it."""
_TURN_M2 = 1.0
"""A state that is looked at squarely from the side counts as this much farther away [m^2]."""
_LONGEST_M = 3.5
"""Length of way that is looked at [m]."""

Ints = npt.NDArray[np.int32]


class LaneWays(NamedTuple):
    """What ways are found with; d stops, s states of the lane graph."""

    states: Ints
    """States from which all stops can be reached, shape (k,)."""
    poses: FloatArray
    """x, y, yaw of all states, shape (s, 3)."""
    stops: FloatArray
    """x, y, yaw of the stops, shape (d, 3)."""
    next_move: Ints
    """The move to make from each state, -1 at the stop and where there is no way, shape (d, s)."""
    left_m: FloatArray
    """Length of the way from each state [m], shape (d, s)."""
    move_to: Ints
    path_ptr: Ints
    path_points: FloatArray
    path_s: FloatArray
    """As the lane graph has them."""


def lane_ways(graph: LaneGraph, stops: Sequence[int]) -> LaneWays:
    """Work out the ways to some states.

    Args:
        graph: Lane graph.
        stops: The states, d of them.
    """
    tables = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_))
    next_move = np.full((len(stops), graph.n_states), -1, dtype=np.int32)
    left_m = np.full((len(stops), graph.n_states), np.inf)
    reached = np.ones(graph.n_states, dtype=np.bool_)
    for row, stop in enumerate(stops):
        to_stop = tables.to(stop)
        reached &= to_stop < UNREACHABLE
        left_m[row, stop] = 0.0
        # From the stop outwards, so that the way of the state that comes next is known.
        for state in np.argsort(to_stop, kind="stable").tolist():
            moves = graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]
            if state == stop or to_stop[state] >= UNREACHABLE or not len(moves):
                continue
            move = int(moves[np.argmin(to_stop[graph.move_to[moves]])])
            next_move[row, state] = move
            left_m[row, state] = graph.move_length[move] + left_m[row, graph.move_to[move]]
    return LaneWays(
        states=np.flatnonzero(reached).astype(np.int32),
        poses=graph.state_pose,
        stops=graph.state_pose[list(stops)].reshape(-1, 3),
        next_move=next_move,
        left_m=left_m,
        move_to=graph.move_to,
        path_ptr=graph.path_ptr,
        path_points=graph.path_points,
        path_s=graph.path_s,
    )


@njit(cache=True)
def find_ways(
    ways: LaneWays, poses: FloatArray, left: FloatArray, points: FloatArray
) -> None:  # pragma: no cover - compiled
    """Find the ways of all cars to all stops.

    A car is taken to be at the state that is nearest, in place and heading.

    Args:
        ways: The lanes.
        poses: Rear-axle poses x, y, yaw, shape (n, 3).
        left: Filled in with lengths of ways [m], negative just beyond a stop, shape (n, d).
        points: Filled in with x, y of the points `AHEAD_M` ahead, straight on beyond a stop, shape (n, d, 3, 2).
    """
    line = np.empty((512, 3))
    for car in range(len(poses)):
        x, y, yaw = poses[car]
        state, least = ways.states[0], math.inf
        for s in ways.states:
            dx, dy = ways.poses[s, 0] - x, ways.poses[s, 1] - y
            cost = dx * dx + dy * dy + _TURN_M2 * (1.0 - math.cos(ways.poses[s, 2] - yaw))
            if cost < least:
                state, least = s, cost
        for stop in range(len(ways.stops)):
            sx, sy, turned = ways.stops[stop]
            cos, sin = math.cos(turned), math.sin(turned)
            ahead = cos * (sx - x) + sin * (sy - y)
            near = math.hypot(sx - x, sy - y) < AT_STOP_M and math.cos(turned - yaw) > math.cos(AT_STOP_RAD)
            if near:
                left[car, stop] = ahead
                for p in range(len(AHEAD_M)):
                    points[car, stop, p, 0] = sx + (AHEAD_M[p] - ahead) * cos
                    points[car, stop, p, 1] = sy + (AHEAD_M[p] - ahead) * sin
                continue
            n = _draw(ways, stop, state, line)
            at = _nearest(line, n, x, y)
            left[car, stop] = ways.left_m[stop, state] - at
            for p in range(len(AHEAD_M)):
                _point_at(line, n, at + AHEAD_M[p], points[car, stop, p])


@njit(cache=True)
def _draw(ways: LaneWays, stop: int, state: int, line: FloatArray) -> int:  # pragma: no cover - compiled
    """Fill in x, y and arc length of the way from a state on; returns how many points it has, at least two."""
    x, y, yaw = ways.poses[state]
    # A short run-up gives a way without moves its direction.
    line[0] = x - 0.01 * math.cos(yaw), y - 0.01 * math.sin(yaw), -0.01
    line[1] = x, y, 0.0
    n, begin = 2, 0.0
    move = ways.next_move[stop, state]
    while move >= 0 and begin < _LONGEST_M:
        first, last = ways.path_ptr[move] + 1, ways.path_ptr[move + 1]
        for k in range(first, min(last, first + len(line) - n)):
            line[n] = ways.path_points[k, 0], ways.path_points[k, 1], begin + ways.path_s[k]
            n += 1
        begin = line[n - 1, 2]
        move = ways.next_move[stop, ways.move_to[move]]
    return n


@njit(cache=True)
def _nearest(line: FloatArray, n: int, x: float, y: float) -> float:  # pragma: no cover - compiled
    """Arc length of the point of a way that is nearest, negative before it begins; looks at a metre and a half."""
    at, least = 0.0, math.inf
    for k in range(n - 1):
        if line[k, 2] > 1.5:
            break
        dx, dy = line[k + 1, 0] - line[k, 0], line[k + 1, 1] - line[k, 1]
        length = math.hypot(dx, dy)
        if length < 1e-9:
            continue
        along = (dx * (x - line[k, 0]) + dy * (y - line[k, 1])) / length
        stays = min(along, length) if k == 0 else min(max(along, 0.0), length)
        gap = math.hypot(line[k, 0] + stays * dx / length - x, line[k, 1] + stays * dy / length - y)
        if gap < least:
            at, least = line[k, 2] + stays, gap
    return at


@njit(cache=True)
def _point_at(line: FloatArray, n: int, s: float, out: FloatArray) -> None:  # pragma: no cover - compiled
    """Fill in the point of a way at an arc length, straight on where it ends."""
    k = 0
    while k < n - 2 and line[k + 1, 2] < s:
        k += 1
    span = max(line[k + 1, 2] - line[k, 2], 1e-9)
    t = (s - line[k, 2]) / span
    for axis in range(2):
        out[axis] = line[k, axis] + t * (line[k + 1, axis] - line[k, axis])
