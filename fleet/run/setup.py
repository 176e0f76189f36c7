"""RunSetup: where a run takes place and what it starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.config import WHOLE, Connect, Fidelity, Perception, RunConfig, require
from fleet.robots.cars.models import CarModels
from fleet.run.lanes import lanes_for
from fleet.run.starts import require_room, start_states
from fleet.traffic.floor_distances import FloorDistances
from fleet.world.protocol import World
from fleet.world.scene import Scene
from fleet.world.site_scene import scene_of
from maps.lane_graph import LaneGraph, states_of_lanes
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
            ConfigError: The site has no room for that many robots, there is no such model, or its body fits no lanes.
            SiteError: The site cannot be read.
        """
        require(config.fidelity in WHOLE, "--fidelity", str(config.fidelity), ", ".join(WHOLE))
        site = load_site(config.site)
        require_room(config.robots, site)
        models = CarModels.named(config.models)
        _check_models(config, models)
        _check_pods(config, site)
        graph = lanes_for(site, models)
        docks = [place.dock.cell for place in site.stations]
        against = states_of_lanes(graph, site.against, site.grid) if site.allow_reverse else None
        states = (start_states(config, site, graph) + models.kind_of * graph.n_places).astype(np.int32)
        return RunSetup(
            site=site,
            graph=graph,
            start_states=states,
            scene=scene_of(site, graph.state_pose[states], config.grip, config.arms, models),
            distances=FloorDistances(graph, docks, against=against),
        )


def _require_plain_world(config: RunConfig, where: str, of_cars: str) -> None:
    """Refuse worlds that are mixed, or in tiles, where these do not have what the run needs."""
    valid = f"physics, kinematic or grid {where}"
    require(config.fidelity is not Fidelity.MIXED, "--fidelity", str(config.fidelity), valid)
    tiled = config.fidelity is Fidelity.PHYSICS and config.connect is Connect.DIRECT
    most = config.physics.plain_cars_n if tiled else config.robots
    require(config.robots <= most, "--robots", config.robots, f"1 to {most} in physics, {of_cars}")


def _check_pods(config: RunConfig, site: Site) -> None:
    """Refuse pods where a world has none."""
    if not site.storage:
        return
    _require_plain_world(config, f"on site {site.name}, on which pods stand", "on a site on which pods stand")


def _check_models(config: RunConfig, models: CarModels) -> None:
    """Refuse cars of several models where all have to be of one."""
    if len(models.kinds) == 1 and models.kinds[0].steers:
        return
    names = ", ".join(kind.name for kind in models.kinds)
    several = f"for cars of several models, or that do not steer ({names})"
    _require_plain_world(config, several, f"of such models ({names})")
    seen = config.perception is Perception.CAMERA
    fits = not seen or len(models.hulls) == 1
    require(fits, "models of the cars", names, "models with the same tray, as cameras are set up for one kind of tray")
