"""RunSetup: where a run takes place and what it starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.config import RunConfig
from fleet.run.starts import start_states
from fleet.traffic.floor_distances import FloorDistances
from fleet.world.protocol import World
from fleet.world.scene import Scene
from fleet.world.site_scene import scene_of
from maps.lane_graph import LaneGraph, build_lane_graph, states_of_lanes
from maps.site import Site, load_site


@dataclass(frozen=True, kw_only=True)
class RunSetup:
    """What runs with as many cars on the same site have in common, and may hand on from one to the next."""

    site: Site
    graph: LaneGraph
    start_states: npt.NDArray[np.int32]
    """Lane-graph state of each car at the start, shape (n_cars,)."""
    scene: Scene
    distances: FloorDistances
    """Distances with nothing blocked."""
    world: World | None = None
    """The world to run in, as it was when it was made; None = a new one."""

    @staticmethod
    def of(config: RunConfig) -> RunSetup:
        """The setup of a run.

        Raises:
            ConfigError: The site has no room for that many robots.
            SiteError: The site cannot be read.
        """
        site = load_site(config.site)
        graph = build_lane_graph(site)
        docks = [place.dock.cell for place in site.stations]
        against = states_of_lanes(graph, site.against, site.grid) if site.allow_reverse else None
        states = start_states(config, site, graph)
        return RunSetup(
            site=site,
            graph=graph,
            start_states=states,
            scene=scene_of(site, graph.state_pose[states], config.grip, config.arms),
            distances=FloorDistances(graph, docks, against=against),
        )
