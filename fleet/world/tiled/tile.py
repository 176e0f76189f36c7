"""Tile: a part of the floor with an engine of its own."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fleet.arrays import FloatArray
from fleet.sensors.camera import Camera, CameraImage
from fleet.world.bullet.cars import CarBodyMotion
from fleet.world.bullet.world import BulletWorld
from fleet.world.protocol import ParcelBody
from fleet.world.scene import Scene
from fleet.world.tiled.board import TileBoard
from fleet.world.tiled.config import TiledConfig
from fleet.world.tiled.split import Split, find_guests, reaches, tile_scene


class Load(NamedTuple):
    """A parcel on its way from one tile to another."""

    body: ParcelBody
    row: int
    """Where its pose stands on the board."""
    velocity: FloatArray
    """Linear and angular, shape (6,) [m/s, rad/s]."""


@dataclass(frozen=True, kw_only=True)
class _Moment:
    """A moment of a `Tile`."""

    world: object
    cars: list[int]
    motions: list[CarBodyMotion]
    bodies: dict[int, ParcelBody]
    rows: dict[int, int]
    serving: dict[int, int]


class Tile:
    """Cars, arms and parcels on a part of the floor; reads what they are told from the board and writes what they did.

    Args:
        number: Which tile it is.
        scene: The whole.
        split: The tiles.
        config: Settings.
        board: Where all tiles write.
    """

    def __init__(self, number: int, scene: Scene, split: Split, config: TiledConfig, board: TileBoard) -> None:
        self._number, self._config, self._board = number, config, board
        self._cars: list[int] = np.flatnonzero(board.tile_of == number).tolist()
        self._arms = np.flatnonzero(split.tile_of_arm == number)
        self._bounds, self._near = split.bounds(number), split.near(number)
        self._middle_m = (scene.car.front_m - scene.car.rear_m) / 2
        self._world = BulletWorld(tile_scene(scene, split, number, self._cars, config.near_m), config.bullet)
        self._bodies: dict[int, ParcelBody] = {}
        self._rows: dict[int, int] = {}
        self._row_list = np.zeros(0, dtype=np.int64)
        self._serving: dict[int, int] = {}
        self._moments: dict[int, _Moment] = {}
        self._n_moments = 0
        self._seen = np.zeros(len(self._cars), dtype=np.int64)
        self._write()

    def step(self) -> None:
        """Advance one tick."""
        board, cars, arms = self._board, self._cars, self._arms
        guests = find_guests(board.before, self._middle_m, self._near, board.tile_of, self._number)
        self._world.show_ghosts(guests.tolist(), board.before[guests], cars)
        self._world.step(board.commands[cars], board.arm_q[arms], board.arm_qd[arms], board.grip[arms])
        self._write()

    # --- cars

    def admit(self, car: int, motion: CarBodyMotion, loads: list[Load]) -> None:
        """Let a car come, with what lies in its tray."""
        self._world.show_ghosts([], np.zeros((0, 3)), self._cars)  # it may be one of them
        self._world.admit_car(self._board.poses[car], motion)
        self._cars.append(car)
        for load in loads:
            self._world.add_parcel(load.body, load.velocity)
            self._bodies[load.body.parcel], self._rows[load.body.parcel] = load.body, load.row
        self._other_cars()

    def dismiss(self, car: int) -> tuple[CarBodyMotion, list[Load]]:
        """Let a car go, with what lies in its tray; returns what it takes along."""
        place = self._cars.index(car)
        motion, loads = self._world.car_motion(place), []
        for parcel in self._world.in_tray(place):
            moves = self._world.parcel_motion(parcel)
            body = replace(self._bodies.pop(parcel), pose=moves[:7])
            loads.append(Load(body=body, row=self._rows.pop(parcel), velocity=moves[7:]))
            self._world.remove_parcel(parcel)
        self._world.dismiss_car(place)
        self._cars.remove(car)
        self._other_cars()
        return motion, loads

    def serve(self, arm: int, car: int) -> None:
        """Say which car's tray an arm may touch, both by their indices in the fleet."""
        self._serving[arm] = car
        self._tell_served()

    def push(self, car: int, way: tuple[float, float, float]) -> None:
        """See `World.push_car`."""
        self._world.push_car(self._cars.index(car), *way)

    def put(self, car: int, pose: FloatArray) -> None:
        """See `World.put_car`."""
        self._world.put_car(self._cars.index(car), pose)
        self._write()

    # --- arms and parcels

    def fail_grip(self, arm: int) -> None:
        """See `World`."""
        self._world.fail_grip(int(np.searchsorted(self._arms, arm)))

    def grip_loss(self, arm: int) -> str:
        """See `World`."""
        return self._world.grip_loss(int(np.searchsorted(self._arms, arm)))

    def add_parcel(self, body: ParcelBody, row: int) -> None:
        """Put a parcel into the tile, whose pose stands in a row of the board."""
        self._world.add_parcel(body)
        self._bodies[body.parcel], self._rows[body.parcel] = body, row
        self._other_parcels()

    def remove_parcel(self, parcel: int) -> None:
        """Take a parcel out."""
        self._world.remove_parcel(parcel)
        del self._bodies[parcel], self._rows[parcel]
        self._other_parcels()

    # --- all else

    def add_obstacle(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> None:
        """Put a box up, if it reaches into the tile, in place of an earlier one of the same id."""
        self.remove_obstacle(obstacle)
        if reaches(self._bounds, centre_m, half_m, self._config.near_m):
            self._world.add_obstacle(obstacle, centre_m, half_m)

    def remove_obstacle(self, obstacle: int) -> None:
        """Take such a box down, if there is one."""
        if obstacle in self._world.obstacle_ids():
            self._world.remove_obstacle(obstacle)

    def rays(self, origins: FloatArray, ends: FloatArray) -> FloatArray:
        """See `World`."""
        return self._world.rays(origins, ends)

    def image(self, camera: Camera) -> CameraImage:
        """See `World`."""
        return self._world.image(camera)

    def save(self, settle: bool) -> int:
        """Remember this moment; returns its number."""
        self._n_moments += 1
        self._moments[self._n_moments] = _Moment(
            world=self._world.save(settle=settle),
            cars=list(self._cars),
            motions=[self._world.car_motion(place) for place in range(len(self._cars))],
            bodies=dict(self._bodies),
            rows=dict(self._rows),
            serving=dict(self._serving),
        )
        return self._n_moments

    def load(self, moment: int) -> None:
        """Return to a moment; what it writes on the board is the caller's to correct."""
        then = self._moments[moment]
        if self._cars != then.cars:
            for place in reversed(range(len(self._cars))):
                self._world.dismiss_car(place)
            for car, motion in zip(then.cars, then.motions, strict=True):
                self._world.admit_car(self._board.poses[car], motion)
        self._world.load(then.world)
        self._cars = list(then.cars)
        self._bodies, self._rows, self._serving = dict(then.bodies), dict(then.rows), dict(then.serving)
        self._seen = self._world.contacts_of()[0]
        self._other_parcels()

    def forget(self, moments: list[int]) -> None:
        """Free some moments."""
        for moment in moments:
            self._moments.pop(moment, None)

    def state_bytes(self) -> bytes:
        """A digest of the physical state, equal for equal states."""
        cars = np.array(self._cars, dtype=np.int64).tobytes()
        return hashlib.sha256(cars + self._world.state_bytes()).digest()

    def close(self) -> None:
        """Free the engine."""
        self._world.close()

    def _other_cars(self) -> None:
        """Cars came or went."""
        self._seen = np.zeros(len(self._cars), dtype=np.int64)
        self._tell_served()
        self._other_parcels()

    def _other_parcels(self) -> None:
        """Parcels came or went."""
        self._row_list = np.array([self._rows[parcel] for parcel in sorted(self._rows)], dtype=np.int64)
        self._write()

    def _tell_served(self) -> None:
        for arm, car in self._serving.items():
            place = self._cars.index(car) if car in self._cars else -1
            self._world.set_serving(int(np.searchsorted(self._arms, arm)), place)

    def _write(self) -> None:
        """Write what is so now."""
        board, world, cars, arms = self._board, self._world, self._cars, self._arms
        if cars:
            board.poses[cars] = world.car_poses()
            board.speeds[cars] = world.car_speeds()
            board.steering[cars] = world.car_steering()
        board.q[arms], board.qd[arms] = world.arm_positions(), world.arm_velocities()
        board.held[arms] = world.held()
        board.parcels[self._row_list] = world.parcel_poses()
        of_cars, of_arms = world.contacts_of()
        board.of_cars[cars] += of_cars - self._seen
        board.of_arms[arms] = of_arms
        self._seen = of_cars
        counts = world.contacts()
        board.counts[self._number] = counts.robot, counts.static
        board.clearance[self._number] = world.min_clearance_m()
