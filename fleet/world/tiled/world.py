"""TiledWorld: contact physics on a large floor, by engines that share it."""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.sensors.camera import Camera, CameraImage
from fleet.world.kinematic import CommandError, SnapshotError
from fleet.world.parcels import ParcelError
from fleet.world.protocol import Contacts, ParcelBody
from fleet.world.ray_points import ray_points
from fleet.world.scene import Scene
from fleet.world.tiled.board import MOST_PARCELS, TileBoard
from fleet.world.tiled.config import TiledConfig
from fleet.world.tiled.crew import STEP, LocalCrew, TileCrew, TileSetup, WorkerCrew
from fleet.world.tiled.split import CELL_M, find_tiles, split_floor

_ON_CAR_M = 0.35
"""A parcel that is put down so near to the middle of a tray comes into that car's tile."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TiledSnapshot:
    """State of a `TiledWorld` at one instant; tiles free their parts when the object dies."""

    moments: list[int]
    board: dict[str, Any]
    rows: dict[int, int]
    tile_of_parcel: dict[int, int]


class TiledWorld:
    """A `BulletWorld` in tiles, each with its own engine, whose cost grows with the number of cars and no faster.

    A car that crosses a border is handed over with position, velocities, wheels, and what lies in its tray, to the last
    bit; what the solver remembers of contacts is left behind. Cars near a border are ghosts beyond it: they stop what
    runs into them, and do not give way to it there. A parcel on the floor stays in the tile in which it was dropped.

    Args:
        scene: The world at the start.
        config: Settings. With `n_workers` > 1, processes share the tiles; the number changes nothing in a run.

    Raises:
        PhysicsError: The engine refuses a description.
        TileWorkerError: A process cannot be started, or ends.
    """

    def __init__(self, scene: Scene, config: TiledConfig | None = None) -> None:
        self._config = config = config or TiledConfig()
        self._scene = scene
        self.tick_s = config.bullet.tick_s
        self.pods = None
        self.n_cars, self.n_arms = len(scene.car_start), len(scene.arm_base)
        self._split = split_floor(scene, config)
        self._bounds = [self._split.bounds(tile) for tile in range(self._split.n_tiles)]
        self._middle_m = (scene.car.front_m - scene.car.rear_m) / 2
        joints = np.asarray(scene.arm_start, dtype=np.float64).reshape(self.n_arms, scene.arms.width)
        self._board = board = TileBoard((self.n_cars, self.n_arms, joints.shape[1], self._split.n_tiles))
        board.poses[:] = np.asarray(scene.car_start, dtype=np.float64).reshape(-1, 3)
        board.q[:], board.held[:] = joints, -1
        board.tile_of[:] = -1
        board.tile_of[:] = self._tiles_now()
        self._ids = np.zeros(0, dtype=np.int64)
        self._rows: dict[int, int] = {}
        self._free_rows: list[int] = []
        self._row_list = np.zeros(0, dtype=np.int64)
        self._tile_of_parcel: dict[int, int] = {}
        self._forgotten: list[list[int]] = []
        setup = TileSetup(scene=scene, split=self._split, config=config)
        with board.file:  # whoever shares the memory has it by then
            self._crew: TileCrew = (
                LocalCrew(setup, board, list(range(self._split.n_tiles)))
                if min(config.n_workers, self._split.n_tiles) == 1
                else WorkerCrew(setup, board)
            )

    def step(self, car_commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: BoolArray) -> None:
        """Advance one tick; see `World.step`.

        Raises:
            CommandError: An array has the wrong shape.
        """
        board = self._board
        shapes = (car_commands.shape, arm_q.shape, arm_qd.shape, grip.shape)
        valid = (board.commands.shape, board.q.shape, board.q.shape, board.grip.shape)
        if shapes != valid:
            raise CommandError(f"step: car_commands, arm_q, arm_qd, grip have shapes {shapes}; valid: {valid}")
        while self._forgotten:
            for tile, moment in enumerate(self._forgotten.pop()):
                self._crew.ask(tile, "forget", [moment])
        self._hand_over()
        board.commands[:], board.arm_q[:], board.arm_qd[:], board.grip[:] = car_commands, arm_q, arm_qd, grip
        board.before[:] = board.poses
        self._crew.ask_all(STEP)

    def car_poses(self) -> FloatArray:
        """See `World`."""
        return self._board.poses.copy()

    def car_speeds(self) -> FloatArray:
        """See `World`."""
        return self._board.speeds.copy()

    def car_steering(self) -> FloatArray:
        """See `World`."""
        return self._board.steering.copy()

    def arm_positions(self) -> FloatArray:
        """See `World`."""
        return self._board.q.copy()

    def arm_velocities(self) -> FloatArray:
        """See `World`."""
        return self._board.qd.copy()

    def held(self) -> IntArray:
        """See `World`."""
        return self._board.held.copy()

    def parcel_ids(self) -> IntArray:
        """See `World`."""
        return self._ids

    def parcel_poses(self) -> FloatArray:
        """See `World`."""
        poses: FloatArray = self._board.parcels[self._row_list]
        return poses

    def add_parcel(self, body: ParcelBody) -> None:
        """Put a parcel into the world.

        Raises:
            ParcelError: The id is in use, or there are too many.
        """
        if body.parcel in self._rows:
            raise ParcelError(f"parcel {body.parcel} is in the world already; valid: an id not in use")
        row = self._free_rows.pop() if self._free_rows else len(self._rows)
        if row >= MOST_PARCELS:
            raise ParcelError(f"parcel {body.parcel} is one too many; valid: at most {MOST_PARCELS} at a time")
        tile = self._tile_for(body.pose)
        self._rows[body.parcel], self._tile_of_parcel[body.parcel] = row, tile
        self._crew.ask(tile, "add_parcel", body, row)
        self._list_parcels()

    def remove_parcel(self, parcel: int) -> None:
        """Take a parcel out of the world.

        Raises:
            ParcelError: No such parcel.
        """
        if parcel not in self._rows:
            raise ParcelError(f"parcel {parcel} is not in the world; valid: {self._ids.tolist()}")
        self._crew.ask(self._tile_of_parcel.pop(parcel), "remove_parcel", parcel)
        self._free_rows.append(self._rows.pop(parcel))
        self._list_parcels()

    def set_serving(self, arm: int, car: int) -> None:
        """See `World`."""
        self._crew.ask(self._tile_with(arm), "serve", arm, car)

    def add_obstacle(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> None:
        """See `World`."""
        self._crew.ask_all("add_obstacle", obstacle, np.asarray(centre_m), np.asarray(half_m))

    def remove_obstacle(self, obstacle: int) -> None:
        """See `World`."""
        self._crew.ask_all("remove_obstacle", obstacle)

    def push_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """See `BulletWorld`."""
        self._crew.ask(int(self._board.tile_of[car]), "push", car, (dx_m, dy_m, dyaw_rad))

    def shove_car(self, car: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """See `World`."""
        self.push_car(car, dx_m, dy_m, dyaw_rad)

    def put_car(self, car: int, pose: FloatArray) -> None:
        """See `World`."""
        self._crew.ask(int(self._board.tile_of[car]), "put", car, np.asarray(pose, dtype=np.float64))

    def fail_grip(self, arm: int) -> None:
        """See `World`."""
        self._crew.ask(self._tile_with(arm), "fail_grip", arm)

    def grip_loss(self, arm: int) -> str:
        """See `World`."""
        return str(self._crew.ask(self._tile_with(arm), "grip_loss", arm))

    def contacts(self) -> Contacts:
        """See `World`."""
        robot, static = self._board.counts.sum(axis=0).tolist()
        return Contacts(robot=robot, static=static)

    def contacts_of(self) -> tuple[IntArray, IntArray]:
        """See `World`."""
        return self._board.of_cars.copy(), self._board.of_arms.copy()

    def min_clearance_m(self) -> float:
        """See `World`."""
        return float(self._board.clearance.min())

    def rays(self, origins: FloatArray, ends: FloatArray) -> FloatArray:
        """See `World`.

        Raises:
            SensorError: Other shapes, or numbers that are no places.
        """
        origins, ends = ray_points(origins, ends)
        hits = np.ones(len(origins))
        low, high = np.minimum(origins, ends)[:, :2], np.maximum(origins, ends)[:, :2]
        for tile, bounds in enumerate(self._bounds):
            near = ((low <= bounds[1] + CELL_M) & (high >= bounds[0] - CELL_M)).all(axis=1)
            if near.any():
                hits[near] = np.minimum(hits[near], self._crew.ask(tile, "rays", origins[near], ends[near]))
        return hits

    def image(self, camera: Camera) -> CameraImage:
        """What a camera sees of the tile that it looks at.

        Raises:
            SensorError: Robots are not to be seen.
        """
        x, y = camera.aims_at.tolist()
        image: CameraImage = self._crew.ask(self._split.at(x, y), "image", camera)
        return image

    def save(self, *, settle: bool = False) -> TiledSnapshot:
        """See `World`; what `BulletWorld` says of exactness holds for each tile that has the cars of the snapshot."""
        moments = self._crew.ask_all("save", settle)
        snapshot = TiledSnapshot(
            moments=moments,
            board=self._board.copies(),
            rows=dict(self._rows),
            tile_of_parcel=dict(self._tile_of_parcel),
        )
        weakref.finalize(snapshot, self._forgotten.append, moments)
        return snapshot

    def load(self, snapshot: object) -> None:
        """See `World`.

        Raises:
            SnapshotError: The snapshot is of another kind of world, or of one with other robots.
        """
        if not isinstance(snapshot, TiledSnapshot) or len(snapshot.moments) != self._split.n_tiles:
            raise SnapshotError(f"snapshot is {type(snapshot).__name__}; valid: what save() of this world returned")
        self._board.recall(snapshot.board)
        for tile, moment in enumerate(snapshot.moments):
            self._crew.ask(tile, "load", moment)
        self._board.recall(snapshot.board)
        self._rows, self._tile_of_parcel = dict(snapshot.rows), dict(snapshot.tile_of_parcel)
        taken = set(self._rows.values())
        self._free_rows = [row for row in range(max(taken, default=0)) if row not in taken]
        self._list_parcels()

    def state_bytes(self) -> bytes:
        """See `World`; where a process has ended, all that is still known."""
        if self._crew.is_lost:
            return b"".join(array.tobytes() for array in self._board.copies().values())
        return b"".join(self._crew.ask_all("state_bytes"))

    def close(self) -> None:
        """See `World`."""
        self._crew.close()

    def tiles(self) -> IntArray:
        """The tile that each car is in, shape (n_cars,)."""
        return self._board.tile_of.copy()

    def _tiles_now(self) -> IntArray:
        """The tile that each car should be in."""
        board = self._board
        return find_tiles(board.poses, self._middle_m, self._split.tile_at, self._config.border_m, board.tile_of)

    def _hand_over(self) -> None:
        """Let cars that have crossed a border go on beyond it; at docks there is none, see `split_floor`."""
        tile_of = self._board.tile_of
        wanted = self._tiles_now()
        for car in np.flatnonzero(wanted != tile_of).tolist():
            motion, loads = self._crew.ask(int(tile_of[car]), "dismiss", car)
            tile_of[car] = wanted[car]
            self._crew.ask(int(wanted[car]), "admit", car, motion, loads)
            for load in loads:
                self._tile_of_parcel[load.body.parcel] = int(wanted[car])

    def _tile_with(self, arm: int) -> int:
        return int(self._split.tile_of_arm[arm])

    def _tile_for(self, pose: FloatArray) -> int:
        """The tile for a parcel at some pose: that of the car whose tray it is put on, or of the floor there."""
        board, tray_x = self._board, self._scene.car.tray_x_m
        if self.n_cars:
            x, y, yaw = board.poses.T
            away = np.hypot(x + tray_x * np.cos(yaw) - pose[0], y + tray_x * np.sin(yaw) - pose[1])
            car = int(away.argmin())
            if away[car] < _ON_CAR_M:
                return int(board.tile_of[car])
        return self._split.at(float(pose[0]), float(pose[1]))

    def _list_parcels(self) -> None:
        """Parcels came or went."""
        ids = sorted(self._rows)
        self._ids = np.array(ids, dtype=np.int64)
        self._row_list = np.array([self._rows[parcel] for parcel in ids], dtype=np.int64)
