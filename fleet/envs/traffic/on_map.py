"""Traffic on a published map: the traffic environment with robots that step to neighbouring cells, goal after goal.

Observations, masks, rewards, wishes and their push are those of `fleet.envs.traffic.env`; what is different:

- Robots are pebbles: actions 1 to 4 are a step to the east, north, south and west, and a robot has no heading.
- There are no orders and no stations. Who reaches its goal has delivered, and is given another goal at once.
- Closed rings of robots may move on, as in POGEMA.
- Robots begin in cells drawn by chance, and are sent to cells of the part of the map that they are in.

`n_delivered` / steps is what POGEMA calls the average throughput; its episodes have 256 steps (mazes: 128).
"""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from fleet.abstract.fleet import FleetSite
from fleet.config import Fidelity, require
from fleet.envs.traffic.env import TrafficEnv, TrafficEnvConfig
from fleet.envs.traffic.fleets import TrafficFleet
from fleet.envs.traffic.lifelong import LifelongTraffic, open_place
from fleet.tasks.order import Delivery
from maps.formats.pogema import OpenFloor, read_floor
from maps.grid import GridMap
from maps.site import Site


@dataclass(frozen=True, kw_only=True)
class MapTrafficConfig(TrafficEnvConfig):
    """Settings of `MapTrafficEnv`.

    Raises:
        ConfigError: A setting is outside its valid range.
        MapsError: The map cannot be read.
    """

    map: str | os.PathLike[str] | GridMap
    """Path of a MovingAI .map; `FILE:NAME`, a file of POGEMA's maps and a name in it; or a grid."""
    site: str = ""
    """None: the map takes its place."""

    def __post_init__(self) -> None:
        known = isinstance(self.map, str | os.PathLike | GridMap)
        require(known, "map", self.map, "a path of a .map file, FILE:NAME, or a GridMap")
        require(self.site == "", "site", self.site, "no site beside a map")
        require(self.fidelity == Fidelity.GRID, "fidelity", self.fidelity, f"{Fidelity.GRID.value} on a map")
        super().__post_init__()

    @functools.cached_property
    def floor(self) -> FleetSite:
        """The map, worked out once."""
        if isinstance(self.map, GridMap):
            return open_place(OpenFloor(name="map", grid=self.map, starts=self.map.free, goals=self.map.free))
        return open_place(read_floor(self.map))

    @functools.cached_property
    def place(self) -> Site:
        """The map as a site without lanes; robots park wherever they may begin."""
        return self.floor.site


class MapTrafficEnv(TrafficEnv):
    """Robots on a published map; see the module's description.

    Args:
        config: All settings.
    """

    config: MapTrafficConfig

    def _orders(self, rng: np.random.Generator, duration_s: float) -> tuple[Delivery, ...]:
        return ()

    def _fleet_of(self, orders: tuple[Delivery, ...], seed: int, duration_s: float) -> TrafficFleet:
        return LifelongTraffic(self.place, self._n_cars, seed)


def parallel_env(**settings: Any) -> MapTrafficEnv:
    """Make the environment; the settings are those of `MapTrafficConfig`."""
    return MapTrafficEnv(MapTrafficConfig.of(settings))
