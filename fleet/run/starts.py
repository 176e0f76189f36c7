"""Starts: where cars stand when a run begins, in parking places and, where these are full, on lanes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.config import RunConfig, require
from maps.lane_graph import LaneGraph
from maps.site import Site
from maps.waiting_cells import waiting_cells

STARTS_KEY = 98
"""Branch of the seed's tree that starts on lanes are drawn from."""
LANE_SHARE = 0.3
"""Cars that may begin on lanes, for each cell of the lanes: more of them leave too little room to move in."""


def most_cars(site: Site) -> int:
    """Cars that a site has room for: one in each parking place, and as many on lanes as leave room to drive."""
    bays = len(site.bays())
    n_lane_cells = len(np.unique(site.lanes)) - bays
    return len(site.parking) + int(LANE_SHARE * n_lane_cells)


def require_room(n_cars: int, site: Site) -> None:
    """Refuse a fleet that is too large.

    Raises:
        ConfigError: The site has no room for that many cars.
    """
    most, n_parking = most_cars(site), len(site.parking)
    valid = (
        f"1 to {most} ({n_parking} parking cells of site {site.name}, and {most - n_parking} more cars on its lanes)"
    )
    require(n_cars <= most, "--robots", n_cars, valid)


def start_states(config: RunConfig, site: Site, graph: LaneGraph) -> npt.NDArray[np.int32]:
    """Lane-graph state of each car, shape (n_cars,).

    The first cars begin in parking places, in reading order. The rest wait on lanes, in cells drawn from the seed,
    apart from each other as long as there is room for that.

    Raises:
        ConfigError: The site has no room for that many cars.
    """
    require_room(config.robots, site)
    parked = graph.first_states(site.parking[: config.robots])
    n_on_lanes = config.robots - len(parked)
    if not n_on_lanes:
        return parked
    rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(STARTS_KEY,)))
    waiting = waiting_cells(site, graph)
    most = len(parked) + len(waiting)
    valid = f"1 to {most} ({len(parked)} parking cells, and {len(waiting)} on lanes where others get by)"
    require(n_on_lanes <= len(waiting), "--robots", config.robots, valid)
    cells = _spread(site, rng.permutation(waiting), n_on_lanes)
    return np.concatenate((parked, graph.first_states(cells)))


def _spread(site: Site, cells: npt.NDArray[np.intp], n: int) -> list[int]:
    """The first `n` of some cells, those first that are not beside one taken before."""
    taken = np.zeros((site.grid.rows + 2, site.grid.cols + 2), dtype=np.bool_)
    alone, others = [], []
    for cell in cells.tolist():
        row, col = site.grid.row_col(cell)
        if taken[row : row + 3, col : col + 3].any():
            others.append(cell)
        else:
            alone.append(cell)
            taken[row + 1, col + 1] = True
    return (alone + others)[:n]
