"""PhysicalPods: shelves that stand on their legs, plates that lift them by contact, and constraints that hold them."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.robots.angle import rotation
from fleet.robots.cars.models import CarModels
from fleet.robots.twist.pod import LIFT_M, LIFT_S, POD, pod_urdf
from fleet.world.bullet.contacts import ContactMonitor
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.frames import quaternion
from fleet.world.bullet.engine.urdf_text import without_visuals
from fleet.world.bullet.vehicles.floor import load_on_floor
from fleet.world.bullet.vehicles.lift import CENTRE_S, Hold, Lift
from fleet.world.pods import NO_CAR

_SETTLE_S = 0.5
"""A plate rests for so long before the car may drive."""
_UP_M, _DOWN_M = LIFT_M - 0.005, 0.002
"""A plate is up, or down, from this height on [m]."""
_NEAR_M = 1.5
"""Cars touch no pods whose middles are farther from theirs than this [m]."""


@dataclass(kw_only=True)
class _Carriage:
    """A pod on a car's plate, from when the plate begins to rise until it is down again."""

    pod: int
    ticks: int = 0
    """Since the plate was told to move."""
    hold: Hold | None = None
    """What holds the pod on the plate."""
    centring: int = 0
    """Ticks until the pod that is held is in the middle of the plate."""
    lowers: bool = False


class PhysicalPods:
    """The pods of one world; see `PodLifts`.

    Args:
        client: Connection.
        start: Where they stand, x, y, yaw, shape (p, 3).
        models: Models of the cars.
        cars: Bodies of the cars.
        tick_s: Length of a tick [s].
        visuals: Whether they are drawn by the engine.
    """

    def __init__(
        self, client: Client, start: FloatArray, models: CarModels, cars: list[int], tick_s: float, *, visuals: bool
    ) -> None:
        self._client, self._cars = client, cars
        urdf = pod_urdf() if visuals else without_visuals(pod_urdf())
        self.bodies = [load_on_floor(client, urdf, pose) for pose in start]
        self._com = np.array(client.getDynamicsInfo(self.bodies[0], -1)[3])
        self._lifts = {car: Lift(client, body) for car, body in enumerate(cars) if models[car].lifts is not None}
        self._carriages: dict[int, _Carriage] = {}
        self._wait = round((LIFT_S + _SETTLE_S) / tick_s)
        self._centring = round(CENTRE_S / tick_s)
        self._near: list[tuple[int, int]] = []

    def poses(self) -> FloatArray:
        """See `PodLifts`."""
        rows = []
        for body in self.bodies:
            place, quat = self._client.getBasePositionAndOrientation(body)
            rows.append((*(np.array(place) - rotation(np.array(quat)) @ self._com), *quat))
        return np.array(rows)

    def balls(self) -> FloatArray:
        """Centres and radii of balls round the pods, shape (p, 4)."""
        poses = self.poses()
        radius = np.full(len(poses), math.hypot(*POD.half_m, POD.height_m / 2))
        return np.column_stack((poses[:, :2], poses[:, 2] + POD.height_m / 2, radius))

    def carried_by(self) -> IntArray:
        """See `PodLifts`."""
        cars = np.full(len(self.bodies), NO_CAR, dtype=np.int64)
        for car, carriage in self._carriages.items():
            cars[carriage.pod] = car
        return cars

    def lift(self, car: int, pod: int) -> None:
        """See `PodLifts`."""
        self._carriages[car] = _Carriage(pod=pod)
        self._lifts[car].raise_()

    def lower(self, car: int) -> None:
        """See `PodLifts`."""
        carriage = self._carriages[car]
        self._let_go(carriage)
        carriage.lowers, carriage.ticks = True, 0
        self._lifts[car].lower()

    def put(self, pod: int, pose: FloatArray) -> None:
        """See `PodLifts`."""
        for car in [car for car, carriage in self._carriages.items() if carriage.pod == pod]:
            self._let_go(self._carriages.pop(car))
            self._lifts[car].reset()
        quat = quaternion(float(pose[2]))
        place = np.append(pose[:2], 0.0) + rotation(np.array(quat)) @ self._com
        self._client.resetBasePositionAndOrientation(self.bodies[pod], place.tolist(), quat)
        self._client.resetBaseVelocity(self.bodies[pod], (0, 0, 0), (0, 0, 0))

    def is_up(self, car: int) -> bool:
        """See `PodLifts`."""
        carriage = self._carriages.get(car)
        return carriage is not None and carriage.hold is not None and carriage.centring == 0

    def is_down(self, car: int) -> bool:
        """See `PodLifts`."""
        return car not in self._carriages

    def tick(self, car_poses: FloatArray) -> None:
        """Hold what has been lifted, and forget what has been set down; poses x, y, yaw, shape (n_cars, 3)."""
        for car, carriage in list(self._carriages.items()):
            carriage.ticks += 1
            lift = self._lifts[car]
            if carriage.hold is not None and carriage.centring > 0:
                carriage.centring -= 1
                carriage.hold = lift.centre(carriage.hold, carriage.centring / (carriage.centring + 1))
            if carriage.hold is not None or carriage.ticks < self._wait:
                continue
            if carriage.lowers and lift.height_m <= _DOWN_M:
                del self._carriages[car]
            elif not carriage.lowers and lift.height_m >= _UP_M:
                carriage.hold = lift.hold(self.bodies[carriage.pod])
                carriage.centring = self._centring
        places = self.poses()[:, None, :2]
        near = np.argwhere(np.hypot(*np.moveaxis(places - car_poses[None, :, :2], -1, 0)) < _NEAR_M)
        carried = {carriage.pod for carriage in self._carriages.values()}
        self._near = [(self._cars[car], self.bodies[pod]) for pod, car in near.tolist() if pod not in carried]

    def observe(self, monitor: ContactMonitor) -> None:
        """Count what pods touched in the physics step that was just made."""
        for car, pod in self._near:
            monitor.observe_pod(car, pod)
        for car, carriage in self._carriages.items():
            monitor.observe_load(
                self._cars[car],
                self.bodies[carriage.pod],
                plate=self._lifts[car].plate,
                lifted=carriage.hold is not None,
            )

    def state(self) -> list[float]:
        """Positions and velocities of pods, and heights and speeds of plates, one after the other."""
        client, numbers = self._client, list[float]()
        for body in self.bodies:
            for part in (*client.getBasePositionAndOrientation(body), *client.getBaseVelocity(body)):
                numbers.extend(part)
        for lift in self._lifts.values():
            numbers.extend(lift.motion())
        return numbers

    def place(self, state: list[float]) -> None:
        """Put pods and plates where `state` told them to be."""
        numbers = np.array(state)
        of_pods, of_plates = np.split(numbers, [13 * len(self.bodies)])
        for body, row in zip(self.bodies, of_pods.reshape(-1, 13).tolist(), strict=True):
            self._client.resetBasePositionAndOrientation(body, row[:3], row[3:7])
            self._client.resetBaseVelocity(body, row[7:10], row[10:])
        for lift, motion in zip(self._lifts.values(), of_plates.reshape(-1, 2).tolist(), strict=True):
            lift.place(*motion)

    def memory(self) -> tuple[dict[int, _Carriage], list[tuple[int, int]]]:
        """State beside that of the engine: what is carried, and which cars are near which pods."""
        return copy.deepcopy(self._carriages), list(self._near)

    def recall(self, memory: tuple[dict[int, _Carriage], list[tuple[int, int]]]) -> None:
        """Return to `memory`."""
        for carriage in self._carriages.values():
            self._let_go(carriage)
        carriages, near = memory
        self._carriages, self._near = copy.deepcopy(carriages), list(near)
        for car, carriage in self._carriages.items():
            lift = self._lifts[car]
            (lift.lower if carriage.lowers else lift.raise_)()
            if carriage.hold is not None:
                carriage.hold = lift.hold_again(carriage.hold)
        for car in self._lifts.keys() - self._carriages.keys():
            self._lifts[car].lower()

    def _let_go(self, carriage: _Carriage) -> None:
        if carriage.hold is not None:
            carriage.hold.end(self._client)
            carriage.hold = None
