"""ForeignSimulation: a run whose cars are vehicles of others, ordered by our dispatch, planner and executor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from fleet.assembly import Parts
from fleet.config import Fidelity, RunConfig, require
from fleet.gateway.errors import GatewayError
from fleet.gateway.foreign_driver import ForeignDriver
from fleet.gateway.foreign_vehicles import ForeignVehicles
from fleet.gateway.node_map import DEVIATION_M, DEVIATION_RAD
from fleet.gateway.simulation import require_one_motion
from fleet.robots.angle import wrapped_all
from fleet.run.events import Event
from fleet.run.setup import RunSetup
from fleet.simulation import Actions, Simulation
from fleet.traffic.drivers import Driver
from fleet.world.grid import GridWorld
from fleet.world.protocol import World
from fleet.world.site_scene import scene_of
from maps.lane_graph import LaneGraph
from maps.layouts.from_site import state_names


class ForeignSimulation(Simulation):
    """A `Simulation` on the grid whose cars go where the vehicles have gone that they stand for.

    Orders, allocation, plans and grants are the usual ones, and our arms serve at the docks.

    Args:
        config: Everything that decides the outcome, but for the vehicles; its fidelity is `grid`.
        vehicles: The vehicles, one for each car; all have said where they stand.
        map_id: Name of the map that nodes lie on; empty = the name of the site.
        on_event: Called with every event as it happens.

    Raises:
        ConfigError: The fidelity is another one; or see `Simulation`.
        GatewayError: A vehicle stands beside the lanes, or two stand in one cell.
    """

    def __init__(
        self,
        config: RunConfig,
        vehicles: ForeignVehicles,
        *,
        map_id: str = "",
        on_event: Callable[[Event], None] | None = None,
    ) -> None:
        require(config.fidelity is Fidelity.GRID, "--fidelity", str(config.fidelity), "grid: the vehicles are outside")
        self.vehicles = vehicles
        setup = RunSetup.of(config)
        require_one_motion(setup)
        states = _states(setup.graph, [vehicles.pose(car) for car in range(config.robots)])
        scene = scene_of(setup.site, setup.graph.state_pose[states], config.grip, config.arms, setup.scene.cars)

        def driver(setup: RunSetup, world: World, config: RunConfig, rng: np.random.Generator) -> Driver:
            del config, rng
            if not isinstance(world, GridWorld):
                raise AssertionError("a run with foreign vehicles is on the grid")
            names = state_names(setup.site, setup.graph)
            start, where = setup.start_states, map_id or setup.site.name
            return ForeignDriver(setup.graph, start, world.car_states, vehicles, names, where)

        super().__init__(
            config,
            on_event=on_event,
            setup=replace(setup, start_states=states, scene=scene),
            parts=Parts(driver=driver),
        )

    def tick(self, actions: Actions | None = None) -> None:
        """See `Simulation`; what was out of the ordinary with a vehicle is an event."""
        super().tick(actions)
        for note in self.vehicles.taken_notes():
            self.events.log("vda5050", car=f"car_{note.car}", what=note.what, of=note.of, cause=note.cause)


def _states(graph: LaneGraph, poses: Sequence[tuple[float, float, float]]) -> npt.NDArray[np.int32]:
    """The state that each vehicle stands in."""
    found: list[int] = []
    for car, (x, y, theta) in enumerate(poses):
        off_m = np.hypot(graph.state_pose[:, 0] - x, graph.state_pose[:, 1] - y)
        turn = np.abs(wrapped_all(graph.state_pose[:, 2] - theta))
        off_m[turn > DEVIATION_RAD] = np.inf
        state = int(off_m.argmin())
        if off_m[state] > DEVIATION_M:
            raise GatewayError(
                f"the vehicle of car_{car} stands at ({x:.2f}, {y:.2f}, {theta:.2f}); "
                f"valid: at most {DEVIATION_M} m and 45 degrees beside a lane"
            )
        cells = graph.state_cell[found]
        if graph.state_cell[state] in cells:
            other = int(np.flatnonzero(cells == graph.state_cell[state])[0])
            raise GatewayError(f"the vehicles of car_{other} and car_{car} stand in one cell; valid: one in each")
        found.append(state)
    return np.array(found, dtype=np.int32)
