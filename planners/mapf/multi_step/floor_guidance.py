"""Floor guidance: costs for floors that are too large to learn on, and how many robots such a floor can bear."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from maps.grid import GridMap
from maps.lane_graph import LaneGraph
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step.guidance import Errands
from planners.mapf.multi_step.streets import street_costs, street_share
from planners.mapf.multi_step.traffic_assignment import AssignmentConfig, assign_traffic

_LAID_OUT = 0.8
"""Share of a floor in streets, from which on it is guided by them."""
_AGAINST = 24
"""Cost of a move against its street, of one with it, where nobody is."""
_IN_STREETS = AssignmentConfig(meeting=0.0, crowding=5.0)
_IN_CAVES = AssignmentConfig()
_BUSIEST = 1.5
"""Robots a timestep that may want to pass a cell, all of them driving unhindered. No cell passes more than one, and
where many more want to, those that wait stand in everybody's way."""


class FloorGuidance(NamedTuple):
    """What robots on a floor are told."""

    cost: IntArray
    """Cost of each move of the pebble graph, shape (n_moves,)."""
    share: float
    """Share of the robots that may push on at once; all others only make room."""
    in_streets: bool
    """Whether the floor is laid out in rows and columns, and guided by them."""


def guide_floor(
    grid: GridMap, pebble: LaneGraph, errands: Errands, n_robots: int, *, seed: int | np.random.Generator = 0
) -> FloorGuidance:
    """Find guidance without letting anybody drive, in seconds on floors of any size.

    A floor that is laid out in rows and columns is guided by them, and its streams of robots spread. In caves and
    cities, where few cells lie in streets, streams are assigned to ways until opposing ones part; bottlenecks show
    there, and robots are held back so that these are not asked for more than they can pass.

    Args:
        grid: The floor.
        pebble: Pebble graph on it.
        errands: Tasks as the fleet will get them; at least one.
        n_robots: Robots on the floor.
        seed: Seed of the goals that streams are sent to.
    """
    if street_share(grid) >= _LAID_OUT:
        own = street_costs(grid, pebble, against=_AGAINST)
        traffic = assign_traffic(grid, pebble, errands, n_robots, own_cost=own, config=_IN_STREETS, seed=seed)
        return FloorGuidance(traffic.cost, 1.0, in_streets=True)
    first = street_costs(grid, pebble, against=2, open_share=0.0)
    traffic = assign_traffic(grid, pebble, errands, n_robots, first_cost=first, config=_IN_CAVES, seed=seed)
    busiest = np.bincount(pebble.move_to, weights=traffic.flow, minlength=pebble.n_states).max(initial=0.0)
    return FloorGuidance(traffic.cost, float(_BUSIEST / max(busiest, _BUSIEST)), in_streets=False)
