"""Observer: what agents are told, a row of numbers in [-1, 1] per agent (layout: see `fleet.envs.warehouse.env`)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fleet.envs.warehouse.agent_simulation import AgentSimulation
from fleet.envs.warehouse.rows import (
    ARM_N,
    CAR_N,
    ROUTE_N,
    arm_rows,
    car_rows,
)
from fleet.missions.phases import PHASES, CarPhase
from fleet.sensors.lidar import LidarRing
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.stations.arms.transfer import TRAY, TransferRequest
from fleet.world.protocol import FloatArray

MISSIONS = (CarPhase.TO_PICK, CarPhase.LOADING, CarPhase.TO_DROP, CarPhase.UNLOADING)
"""Phases that a car's row tells from all others."""
PLANNED_N = 2
"""Moves that are planned and not granted, as far as a route shows them."""
_BLOCK_N = 16
"""Looks whose noise is drawn at once."""
_MISSION_OF = np.array([MISSIONS.index(phase) if phase in MISSIONS else -1 for phase in PHASES])


class Observer:
    """Looks at a run.

    Args:
        simulation: The run.
        ring: Lidar of the agents' cars; None = they have none.
        rng: Source of its noise.
    """

    def __init__(self, simulation: AgentSimulation, ring: LidarRing | None, rng: np.random.Generator) -> None:
        self._simulation = simulation
        self._ring = ring
        self._rng = rng
        self._noises: list[FloatArray] = []  # of the coming looks, the next one last
        self._block_n = 1  # a reset does not wait for the noise of later looks
        world, scene, graph = simulation.world, simulation.scene, simulation.graph
        cars_n, arms_n = simulation.cars_n, simulation.arms_n
        rays_n = 0 if ring is None else ring.lidar.rays_n
        self.car_rows = np.zeros((cars_n, CAR_N + rays_n), dtype=np.float32)
        """Observations of the agents' cars, shape (cars_n, CAR_N + rays_n)."""
        self.arm_rows = np.zeros((arms_n, ARM_N), dtype=np.float32)
        """Observations of the agents' arms, shape (arms_n, ARM_N)."""
        self.arm_ways = np.zeros(arms_n)
        """Way of each agent's arm's tip to its parcel, and of the parcel to its place [m], shape (arms_n,)."""
        self.hits: FloatArray | None = None
        """How far the rays of the agents' cars came, as shares of their lengths, shape (cars_n * rays_n,)."""
        self.poses = world.car_poses()
        """Where cars are believed to be now, shape (n_cars, 3)."""
        self._car_limits = np.array([scene.car.max_speed_mps, scene.car.max_steering_rad])
        self._size = np.asarray(scene.size_m, dtype=np.float64)
        self._routes = np.zeros((cars_n, ROUTE_N, 3))
        self._routes_n = np.zeros(cars_n, dtype=np.int64)
        self._granted_m = np.zeros(cars_n)
        self._plans_n = -1
        docks = [station.dock_state for station in simulation.stations]
        self._docks = graph.state_pose[docks].reshape(-1, 3)
        self._ids: list[int] = []
        self._parcel_sizes = np.zeros((0, 3))
        self._asked: list[TransferRequest | None] = [None] * arms_n
        self._transfers = np.zeros((arms_n, 5))  # parcel or -1, place x, y, z, direction
        self._transfers[:, 0] = -1
        self.transfer_keys = [-1] * arms_n
        """Numbers that tell what each agent's arm is asked to do from what it was asked before; -1 for nothing."""

    def look(self, hits: FloatArray | None = None) -> None:
        """Take in this moment: fills the rows.

        Args:
            hits: What `hits` is now, if that is known; None = it is found out.
        """
        if len(self.car_rows):
            self._look_at_cars(hits)
        if len(self.arm_rows):
            self._look_at_arms()

    @property
    def agent_poses(self) -> list[list[float]]:
        """Where agents' cars are believed to be now, x, y, yaw."""
        poses: list[list[float]] = self.poses[: len(self.car_rows)].tolist()
        return poses

    def place(self, transfer: TransferRequest) -> FloatArray:
        """Where the centre of a transfer's parcel should come to rest, in the world [m], shape (3,)."""
        simulation = self._simulation
        if transfer.place_via == TRAY:
            car = simulation.scene.car
            x, y, yaw = transfer.car_pose
            top = np.array([x + car.tray_x_m * math.cos(yaw), y + car.tray_x_m * math.sin(yaw), car.tray_floor_z_m])
        else:
            top = np.asarray(simulation.stations[transfer.arm].place.slots[transfer.place_via], dtype=np.float64)
        return top_of(top, transfer.size_m)

    def _look_at_cars(self, hits: FloatArray | None) -> None:
        simulation = self._simulation
        world, driver = simulation.world, simulation.driver
        cars_n = len(self.car_rows)
        self.poses = driver.poses_now(world)
        self._draw_routes()
        roster, services = simulation.missions, simulation.arm_manager.services
        car_rows(
            self.car_rows,
            self.poses,
            world.car_speeds(),
            world.car_steering(),
            self._car_limits,
            self._size,
            simulation.traffic.goals,
            simulation.graph.state_pose,
            _MISSION_OF,
            roster.phase_index,
            roster.loaded,
            self._routes,
            self._routes_n,
            self._granted_m,
            simulation.missions.bookings.place_of,
            self._docks,
            np.array([service.state is ArmPhase.IDLE for service in services]),
            roster.served,
        )
        if self._ring is not None:
            # A lidar is where the car is, not where it is believed to be.
            self.hits = world.rays(*self._ring.rays(world.car_poses()[:cars_n])) if hits is None else hits
            self._ring.measure(self.hits, self._noise(), self.car_rows[:, CAR_N:])

    def _noise(self) -> FloatArray:
        """Noise of this look's distances, shape (cars_n, rays_n)."""
        if not self._noises:
            # Drawing for many looks at once gives the same numbers.
            shape = (self._block_n, len(self.car_rows), self.car_rows.shape[1] - CAR_N)
            self._noises = list(self._rng.standard_normal(shape)[::-1])
            self._block_n = _BLOCK_N
        return self._noises.pop()

    def _draw_routes(self) -> None:
        """Draw the routes of cars whose granted moves have changed, or of all when there is a new plan."""
        simulation = self._simulation
        driver, plans_n = simulation.driver, simulation.traffic.plans_n
        if plans_n != self._plans_n:
            self._plans_n = plans_n
            driver.stale.update(range(len(self._routes)))
        for car in driver.stale:
            if car < len(self._routes):
                self._draw_route(car)
        driver.stale.clear()

    def _draw_route(self, car: int) -> None:
        """Points x, y and distance from the first one, along a car's granted and next planned moves."""
        simulation, graph = self._simulation, self._simulation.graph
        moves = simulation.driver.moves(car)
        planned = simulation.executor.dependencies.next_moves(car)[:PLANNED_N]
        x, y, yaw = graph.state_pose[simulation.driver.reached(car)].tolist()
        # A short run-up gives a route without moves its direction.
        line, at = self._routes[car], 2
        line[0] = x - 0.01 * math.cos(yaw), y - 0.01 * math.sin(yaw), 0.0
        line[1] = x, y, 0.01
        self._granted_m[car] = 0.01
        for k, move in enumerate((*moves, *planned)):
            first, last = graph.path_ptr[move] + 1, graph.path_ptr[move + 1]
            n = min(int(last - first), ROUTE_N - at)
            line[at : at + n, :2] = graph.path_points[first : first + n, :2]
            line[at : at + n, 2] = line[at - 1, 2] + graph.path_s[first : first + n]
            at += n
            if k < len(moves):
                self._granted_m[car] = line[at - 1, 2]
        self._routes_n[car] = at

    def _look_at_arms(self) -> None:
        simulation = self._simulation
        world, scene = simulation.world, simulation.scene
        arms_n = len(self.arm_rows)
        for arm, asked in enumerate(self._asked):
            transfer = simulation.arm_manager.transfer(arm)
            if transfer is not asked:
                self._asked[arm] = transfer
                self._transfers[arm] = -1.0, 0.0, 0.0, 0.0, 0.0
                self.transfer_keys[arm] = -1
                if transfer is not None:
                    direction = 1.0 if transfer.place_via == TRAY else -1.0
                    self.transfer_keys[arm] = 2 * transfer.parcel + (direction > 0)
                    self._transfers[arm] = transfer.parcel, *self.place(transfer), direction
        ids = world.parcel_ids()
        listed = ids.tolist()
        if listed != self._ids:
            self._ids = listed
            tasks = simulation.board.tasks
            self._parcel_sizes = np.array([tasks[parcel].delivery.size_m for parcel in listed]).reshape(-1, 3)
        arm_rows(
            self.arm_rows,
            self.arm_ways,
            world.arm_positions()[:arms_n],
            world.arm_velocities()[:arms_n],
            scene.arm.lower_rad,
            scene.arm.upper_rad,
            scene.arm.max_velocity_radps,
            scene.arm.joints,
            scene.arm.tool_length_m,
            scene.arm_base,
            world.held(),
            ids,
            world.parcel_poses(),
            self._parcel_sizes,
            self._transfers,
            world.car_poses(),
        )


def top_of(centre: FloatArray, size_m: Sequence[float] | npt.NDArray[np.float64]) -> FloatArray:
    """The point half a box's height above another point [m], shape (3,)."""
    return centre + np.array([0.0, 0.0, size_m[2] / 2])
