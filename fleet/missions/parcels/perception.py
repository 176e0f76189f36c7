"""Perception: where an arm is told that a parcel lies: where it truly is, or where the station's camera sees it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from fleet.arrays import FloatArray
from fleet.missions.parcels.inventory import Inventory
from fleet.robots.spec import CarSpec
from fleet.sensors.boxes import LocateStatus, SeenBox, locate_boxes
from fleet.sensors.camera import CameraImage
from fleet.sensors.station_camera import station_camera
from fleet.stations.station import Station
from fleet.stations.stations import Stations
from fleet.tasks.board import Task
from fleet.world.protocol import World

OTHER_SIZE_M = 0.012
"""A face whose sides differ from those of every face of the parcel by more than this is not the parcel's [m]."""
_RIGHT_TURNS = Rotation.create_group("O")
"""The 24 turns that leave a cube as it is."""


@dataclass(frozen=True, kw_only=True)
class Sighting:
    """Where a parcel is believed to be, or why that is not known."""

    pose: FloatArray
    """Pose of the box's centre in the world, x, y, z, qx, qy, qz, qw, shape (7,); nan if there is a reason."""
    size_m: tuple[float, float, float]
    """Edges of the box along the axes of that pose [m]."""
    reason: str = ""
    """Why it was not located; empty if it was."""


@dataclass(frozen=True, kw_only=True)
class PoseError:
    """How far a parcel was from where the camera located it."""

    distance_m: float
    """Between the centres."""
    turn_rad: float
    """Smallest turn that brings the located edges onto the true ones."""


class PoseSource(Protocol):
    """Tells where parcels lie."""

    errors: list[PoseError]
    """Of every parcel located so far; empty if nothing is measured."""
    n_blind: int
    """Looks that did not locate their parcel."""
    looks: dict[str, CameraImage]
    """The last image of every camera, by station; whoever shows it takes it out."""
    covered: set[int]
    """Arms whose stations' cameras see nothing at present."""

    def find(self, task: Task, station: Station) -> Sighting:
        """Where a task's parcel lies now, at the station whose arm is about to pick it."""


class TruePoses:
    """Knows every pose from the world itself.

    Args:
        inventory: Tells where parcels really are.
    """

    def __init__(self, inventory: Inventory) -> None:
        self._inventory = inventory
        self.errors: list[PoseError] = []
        self.n_blind = 0
        self.looks: dict[str, CameraImage] = {}
        self.covered: set[int] = set()

    def find(self, task: Task, station: Station) -> Sighting:
        """See `PoseSource`; never fails, as there is no camera."""
        return Sighting(pose=self._inventory.pose(task), size_m=task.delivery.size_m)


class SeenPoses:
    """Looks with the station's camera.

    Which pixels belong to which parcel is told by the renderer's segmentation, as if parcels bore marks. Where the
    parcel lies and how it is turned comes from depths and outlines alone; the order's edges decide its height.

    Args:
        stations: The stations.
        car: Car model, for its tray.
        world: Takes the images.
        inventory: Tells where parcels really are, for the errors that are reported and nothing else.
        log: Called as ``log(kind, **facts)`` with every look.
    """

    def __init__(
        self,
        stations: Stations,
        car: CarSpec,
        world: World,
        inventory: Inventory,
        log: Callable[..., None],
    ) -> None:
        self._cameras = [
            station_camera(station.place, station.place.dock.tray_xy, car.tray_floor_z_m) for station in stations
        ]
        self._world = world
        self._inventory = inventory
        self._log = log
        self.errors: list[PoseError] = []
        self.n_blind = 0
        self.looks: dict[str, CameraImage] = {}
        self.covered: set[int] = set()

    def find(self, task: Task, station: Station) -> Sighting:
        """See `PoseSource`; a parcel that the arm holds already is where the tool is, no look is needed."""
        true_pose = self._inventory.pose(task)
        if self._world.held()[station.arm] == task.parcel:
            return Sighting(pose=true_pose, size_m=task.delivery.size_m)
        camera = self._cameras[station.arm]
        if station.arm in self.covered:
            return self._unseen(task, camera.name, "is covered")
        image = self._world.image(camera)
        self.looks[station.name] = image
        labels = np.where(image.parcel == task.parcel, image.parcel, -1)
        search = locate_boxes(camera, image.depth_m, labels, 0.0)
        box = search.best
        reason = _REASONS[search.status]
        if box is not None:
            edges = _edges(box, task.delivery.size_m)
            if edges is not None:
                pose = _pose(box, edges[2])
                error = _error(pose, true_pose)
                self.errors.append(error)
                self._log(
                    "parcel_located",
                    task=task.order.name,
                    camera=camera.name,
                    error_mm=round(1000 * error.distance_m, 3),
                    turn_deg=round(float(np.degrees(error.turn_rad)), 3),
                )
                return Sighting(pose=pose, size_m=edges)
            length, width, _ = box.size_m
            reason = f"sees a face of {length:.3f} x {width:.3f} m, which is none of the parcel's"
        return self._unseen(task, camera.name, reason)

    def _unseen(self, task: Task, camera: str, why: str) -> Sighting:
        """What is told of a parcel that a camera did not locate."""
        self.n_blind += 1
        reason = f"{camera} {why}"
        self._log("parcel_not_located", task=task.order.name, camera=camera, cause=reason)
        return Sighting(pose=np.full(7, np.nan), size_m=task.delivery.size_m, reason=reason)


_REASONS = {
    LocateStatus.FOUND: "",
    LocateStatus.NOTHING_SEEN: "sees no part of the parcel",
    LocateStatus.NO_FACE: "sees no face of the parcel that looks up",
    LocateStatus.ALL_OBSTRUCTED: "sees the parcel partly hidden",
}


def _edges(box: SeenBox, size_m: tuple[float, float, float]) -> tuple[float, float, float] | None:
    """The parcel's edges along the axes of the face that is seen; None if it has no such face."""
    seen = np.array(box.size_m[:2])
    best, off_m = None, OTHER_SIZE_M
    for up in range(3):
        low, high = sorted(size_m[:up] + size_m[up + 1 :])
        apart_m = float(np.abs(seen - (high, low)).max())
        if apart_m <= off_m:
            best, off_m = (high, low, size_m[up]), apart_m
    return best


def _pose(box: SeenBox, height_m: float) -> FloatArray:
    centre = box.world_from_top[:3, 3] - box.world_from_top[:3, 2] * (height_m / 2)
    return np.array([*centre, *Rotation.from_matrix(box.world_from_top[:3, :3]).as_quat()])


def _error(pose: FloatArray, true_pose: FloatArray) -> PoseError:
    turn = Rotation.from_quat(pose[3:]).inv() * Rotation.from_quat(true_pose[3:])
    return PoseError(
        distance_m=float(np.linalg.norm(pose[:3] - true_pose[:3])),
        turn_rad=float((turn * _RIGHT_TURNS).magnitude().min()),
    )
