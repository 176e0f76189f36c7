"""Observer: what agents are told, a row of numbers in [-1, 1] per agent (layout: see `fleet.envs.warehouse.env`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray, IntArray
from fleet.envs.warehouse.control.hands import is_ahead, turning_joints
from fleet.envs.warehouse.rows import (
    MOST_ROUTE_POINTS,
    N_ARM_NUMBERS,
    N_CAR_NUMBERS,
    ArmGround,
    ArmsAtWork,
    ArmsDoing,
    ArmsNow,
    CarGround,
    CarsDoing,
    CarsNow,
    ParcelsNow,
    Routes,
    arm_rows,
    car_rows,
)
from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.envs.warehouse.run.starts import dock_states
from fleet.missions.phases import AT_DOCK, PHASES, CarPhase
from fleet.robots.cars.models import CarModels
from fleet.sensors.lidar import Lidar, LidarRing
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.stations.arms.transfer import TRAY, TransferRequest

MISSIONS = (CarPhase.TO_PICK, CarPhase.LOADING, CarPhase.TO_DROP, CarPhase.UNLOADING)
"""Phases that a car's row tells from all others."""
N_PLANNED = 2
"""Moves that are planned and not granted, as far as a route shows them."""
_LOOKS_AT_ONCE = 16
"""Looks whose noise is drawn at once."""
_SERVED = np.array([phase in AT_DOCK for phase in PHASES])
_MISSION_OF = np.array([MISSIONS.index(phase) if phase in MISSIONS else -1 for phase in PHASES])

Rings = tuple[tuple[IntArray, LidarRing], ...]
"""Lidars by model: which cars have one, and its rays."""


class Told(NamedTuple):
    """What agents were told to do, and what became of it."""

    cars: FloatArray
    """Actions, shape (n_agent_cars, 2)."""
    arms: FloatArray
    """Actions, shape (n_agent_arms, n_entries)."""
    in_order: npt.NDArray[np.bool_]
    """False for a car that does not do what it is told, shape (n_agent_cars,)."""
    closed: npt.NDArray[np.bool_]
    """Whether each grip holds what it gets hold of, shape (n_agent_arms,)."""
    opening: FloatArray
    """Share of the time that has passed for which a grip has to be told to open, shape (n_agent_arms,)."""
    time_left: float
    """Share of the episode's steps that is left."""


class Observer:
    """Looks at a run.

    Args:
        simulation: The run.
        rings: Lidars of the agents' cars; none = they have none.
        rng: Source of its noise.
        sight_m: How far cars and arms see what moves [m].
        step_s: Time from one look to the next [s].
    """

    def __init__(
        self,
        simulation: AgentSimulation,
        rings: Rings,
        rng: np.random.Generator,
        sight_m: tuple[float, float],
        step_s: float,
    ) -> None:
        self._simulation = simulation
        self._rings = rings
        self._rng = rng
        self._noises: list[FloatArray] = []  # of the coming looks, the next one last
        self._n_looks = 1  # a reset does not wait for the noise of later looks
        world, scene, graph = simulation.world, simulation.scene, simulation.graph
        n_cars, n_arms = simulation.n_cars, simulation.n_arms
        n_rays = rings[0][1].lidar.n_rays if rings else 0
        self.car_rows = np.zeros((n_cars, N_CAR_NUMBERS + n_rays), dtype=np.float32)
        """Observations of the agents' cars, shape (n_cars, N_CAR_NUMBERS + n_rays)."""
        self.arm_rows = np.zeros((n_arms, N_ARM_NUMBERS), dtype=np.float32)
        """Observations of the agents' arms, shape (n_arms, N_ARM_NUMBERS)."""
        self.arm_ways = np.zeros(n_arms)
        """Way of each agent's arm's tip to its parcel, and of the parcel to its place [m], shape (n_arms,)."""
        self.hits: FloatArray | None = None
        """How far the rays of the agents' cars came, as shares of their lengths, shape (n_cars * n_rays,)."""
        self.poses = world.car_poses()
        """Where cars are believed to be now, shape (n_cars, 3)."""
        models = scene.cars
        self._steers = models.each("turn_base_m") > 0.0
        self._car_ground = CarGround(
            limits=np.stack((models.each("max_speed_mps"), models.each("max_turn")), axis=1),
            steers=self._steers,
            size_m=np.asarray(scene.size_m, dtype=np.float64),
            state_pose=graph.state_pose,
            docks=graph.state_pose[dock_states(graph, simulation.site)][models.kind_of],
            mission_of=_MISSION_OF,
        )
        team = scene.arms
        self._arm_ground = ArmGround(
            n_joints=team.n_joints,
            lower=team.lower_rad,
            upper=team.upper_rad,
            max_velocity=team.max_velocity_radps,
            joints=team.joints,
            turning=team.padded(turning_joints, 0.0),
            is_ahead=np.array([is_ahead(spec) for spec in team.specs], dtype=np.bool_),
            tool_length_m=team.tool_length_m,
            base=scene.arm_base,
        )
        self._routes = Routes(
            points=np.zeros((n_cars, MOST_ROUTE_POINTS, 3)),
            counts=np.zeros(n_cars, dtype=np.int64),
            granted_m=np.zeros(n_cars),
        )
        self._n_plans = -1
        self._ids: list[int] = []
        self._parcel_sizes = np.zeros((0, 3))
        self._asked: list[TransferRequest | None] = [None] * n_arms
        self._sight_m = sight_m
        self._step_s = step_s
        self._car_service_s = np.zeros(n_cars)
        self._arm_service_s = np.zeros(n_arms)
        self._held_s = np.zeros(n_arms)
        self._transfers = np.zeros((n_arms, 6))  # parcel or -1, place x, y, z, yaw, direction
        self._transfers[:, 0] = -1
        self.transfer_keys = [-1] * n_arms
        """Numbers that tell what each agent's arm is asked to do from what it was asked before; -1 for nothing."""

    def look(self, told: Told, hits: FloatArray | None = None) -> None:
        """Take in this moment: fills the rows.

        Args:
            told: What agents were told to do in the step that ends now.
            hits: What `hits` is now, if that is known; None = it is found out.
        """
        if len(self.car_rows):
            self._look_at_cars(told, hits)
        if len(self.arm_rows):
            self._look_at_arms(told)

    @property
    def agent_poses(self) -> list[list[float]]:
        """Where agents' cars are believed to be now, x, y, yaw."""
        poses: list[list[float]] = self.poses[: len(self.car_rows)].tolist()
        return poses

    def place(self, transfer: TransferRequest) -> FloatArray:
        """Where a transfer's parcel should come to rest, in the world: its centre [m] and yaw [rad], shape (4,)."""
        simulation = self._simulation
        if transfer.place_via == TRAY:
            car = simulation.scene.cars.hulls[transfer.tray]
            x, y, yaw = transfer.car_pose
            ahead, left, cos, sin = (
                car.tray_x_m + transfer.tray_at_m[0],
                transfer.tray_at_m[1],
                math.cos(yaw),
                math.sin(yaw),
            )
            top = np.array([x + ahead * cos - left * sin, y + ahead * sin + left * cos, car.tray_floor_z_m])
        else:
            top = np.asarray(simulation.stations[transfer.arm].place.slots[transfer.place_via], dtype=np.float64)
            yaw = float(simulation.scene.arm_base[transfer.arm, 3])
        return np.append(top_of(top, transfer.size_m), yaw)

    def _look_at_cars(self, told: Told, hits: FloatArray | None) -> None:
        simulation = self._simulation
        world, driver = simulation.world, simulation.driver
        n_cars = len(self.car_rows)
        self.poses = driver.poses_now(world)
        self._draw_routes()
        missions, services = simulation.missions, simulation.arm_manager.services
        cars = CarsNow(
            poses=self.poses,
            speeds=world.car_speeds(),
            steering=world.car_steering(),
            goals=simulation.traffic.goals,
            phases=missions.phase_index,
            loaded=missions.loaded,
            place_of=missions.bookings.place_of,
        )
        idle = np.array([service.state is ArmPhase.IDLE for service in services])
        arms = ArmsAtWork(idle=idle, served=missions.served)
        _last(self._car_service_s, _SERVED[missions.phase_index[:n_cars]], self._step_s)
        doing = CarsDoing(
            actions=told.cars,
            service_s=self._car_service_s,
            in_order=told.in_order,
            time_left=told.time_left,
            sight_m=self._sight_m[0],
        )
        car_rows(self.car_rows, self._car_ground, cars, self._routes, arms, doing)
        if self._rings:
            # A lidar is where the car is, not where it is believed to be.
            self.hits = self._scan(world.car_poses()[:n_cars]) if hits is None else hits
            by_car, noise, distances = self.hits.reshape(n_cars, -1), self._noise(), self.car_rows[:, N_CAR_NUMBERS:]
            for own, ring in self._rings:
                measured = np.empty((len(own), distances.shape[1]), dtype=np.float32)
                ring.measure(by_car[own].ravel(), noise[own], measured)
                distances[own] = measured

    def _scan(self, poses: FloatArray) -> FloatArray:
        """How far the rays of the agents' cars come, as shares of their lengths, shape (n_cars * n_rays,)."""
        n_rays = self.car_rows.shape[1] - N_CAR_NUMBERS
        origins, ends = np.empty((2, len(poses), n_rays, 3))
        for cars, ring in self._rings:
            of_kind = ring.rays(poses[cars])
            origins[cars], ends[cars] = (points.reshape(-1, n_rays, 3) for points in of_kind)
        return self._simulation.world.rays(origins.reshape(-1, 3), ends.reshape(-1, 3))

    def _noise(self) -> FloatArray:
        """Noise of this look's distances, shape (n_cars, n_rays)."""
        if not self._noises:
            # Drawing for many looks at once gives the same numbers.
            shape = (self._n_looks, len(self.car_rows), self.car_rows.shape[1] - N_CAR_NUMBERS)
            self._noises = list(self._rng.standard_normal(shape)[::-1])
            self._n_looks = _LOOKS_AT_ONCE
        return self._noises.pop()

    def _draw_routes(self) -> None:
        """Draw the routes of cars whose granted moves have changed, or of all when there is a new plan."""
        simulation = self._simulation
        driver, n_plans = simulation.driver, simulation.traffic.n_plans
        if n_plans != self._n_plans:
            self._n_plans = n_plans
            driver.stale.update(range(len(self.car_rows)))
        for car in driver.stale:
            if car < len(self.car_rows):
                self._draw_route(car)
        driver.stale.clear()

    def _draw_route(self, car: int) -> None:
        """Points x, y and distance from the first one, along a car's granted and next planned moves."""
        simulation, graph = self._simulation, self._simulation.executor.graph
        moves = simulation.driver.moves(car)
        planned = simulation.executor.dependencies.next_moves(car)[:N_PLANNED]
        x, y, yaw = graph.state_pose[simulation.driver.reached(car)].tolist()
        # A short run-up gives a route without moves its direction.
        line, at = self._routes.points[car], 2
        line[0] = x - 0.01 * math.cos(yaw), y - 0.01 * math.sin(yaw), 0.0
        line[1] = x, y, 0.01
        self._routes.granted_m[car] = 0.01
        for k, move in enumerate((*moves, *planned)):
            first, last = graph.path_ptr[move] + 1, graph.path_ptr[move + 1]
            points, s_m = graph.path_points[first:last, :2], graph.path_s[first:last]
            if not self._steers[car]:
                points, s_m = _without_turns(line[at - 1, :2], points)
            n = min(len(points), MOST_ROUTE_POINTS - at)
            line[at : at + n, :2] = points[:n]
            line[at : at + n, 2] = line[at - 1, 2] + s_m[:n]
            at += n
            if k < len(moves):
                self._routes.granted_m[car] = line[at - 1, 2]
        self._routes.counts[car] = at

    def _look_at_arms(self, told: Told) -> None:
        simulation = self._simulation
        world, n_arms = simulation.world, len(self.arm_rows)
        for arm, asked in enumerate(self._asked):
            transfer = simulation.arm_manager.transfer(arm)
            if transfer is not asked:
                self._asked[arm] = transfer
                self._transfers[arm] = -1.0, 0.0, 0.0, 0.0, 0.0, 0.0
                self._arm_service_s[arm] = -self._step_s
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
        arms = ArmsNow(
            q=world.arm_positions()[:n_arms],
            qd=world.arm_velocities()[:n_arms],
            held=world.held(),
            transfers=self._transfers,
        )
        _last(self._arm_service_s, self._transfers[:, 0] >= 0, self._step_s)
        _last(self._held_s, arms.held[:n_arms] >= 0, self._step_s)
        doing = ArmsDoing(
            actions=told.arms,
            closed=told.closed,
            opening=told.opening,
            held_s=self._held_s,
            service_s=self._arm_service_s,
            time_left=told.time_left,
            sight_m=self._sight_m[1],
        )
        parcels = ParcelsNow(ids=ids, poses=world.parcel_poses(), sizes=self._parcel_sizes)
        arm_rows(self.arm_rows, self.arm_ways, self._arm_ground, arms, parcels, world.car_poses(), doing)


def top_of(centre: FloatArray, size_m: Sequence[float] | npt.NDArray[np.float64]) -> FloatArray:
    """The point half a box's height above another point [m], shape (3,)."""
    return centre + np.array([0.0, 0.0, size_m[2] / 2])


def rings_of(lidar: Lidar | None, models: CarModels) -> Rings:
    """The lidar on cars of each model.

    Args:
        lidar: The sensor; None = they have none.
        models: Models of the cars.
    """
    if lidar is None:
        return ()
    return tuple(
        (models.cars_of(number), LidarRing(lidar, kind.front_m, kind.rear_m, kind.half_width_m))
        for number, kind in enumerate(models.kinds)
    )


def _without_turns(start: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points x, y of a path without those of turns on the spot, and how far they are along it [m]."""
    steps = np.hypot(*np.diff(np.vstack((start, points)), axis=0).T)
    goes = steps > 1e-6
    return points[goes], np.cumsum(steps[goes])


def _last(lasted_s: FloatArray, goes_on: npt.NDArray[np.bool_], step_s: float) -> None:
    """Let what goes on have lasted for a step more, and the rest for no time."""
    lasted_s += step_s
    lasted_s *= goes_on
