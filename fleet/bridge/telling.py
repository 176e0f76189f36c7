"""Telling: a run as frames of the bridge: what it is, and after each tick where everything is."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray
from fleet.bridge.wire import FORMAT, encoded
from fleet.recording.run_file import plain
from fleet.run.events import Event
from fleet.run.view import RunView
from fleet.sensors.lidar import Lidar, LidarRing
from fleet.sensors.station_camera import station_camera
from fleet.world.scene import Scene

SCAN_S = 0.1
"""Simulated time between two scans [s]."""
SCAN_KEY = 98
"""Branch of the seed's tree that the noise of scans is drawn from."""


def require_bridged(scene: Scene) -> None:
    """Refuse robots that a client cannot be told of: `hello` has one kind of cars and one of arms.

    Raises:
        ConfigError: There are none, or more.
    """
    _ = scene.car, scene.arms.only("--bridge")


class Telling:
    """Makes frames of a run.

    Args:
        run: The run.
        lidar: Whether cars scan around themselves.
    """

    def __init__(self, run: RunView, *, lidar: bool) -> None:
        self._run = run
        self._car, self._arm = run.scene.car, run.scene.arms.only("--bridge")
        car = self._car
        self._ring = LidarRing(Lidar(), car.front_m, car.rear_m, car.half_width_m) if lidar else None
        self._rng = np.random.default_rng(np.random.SeedSequence(run.config.seed, spawn_key=(SCAN_KEY,)))
        self._scan_ticks = max(1, round(SCAN_S / run.tick_s))

    def hello(self) -> bytes:
        """What a client has to know before all else."""
        run = self._run
        car, arm, lidar = self._car, self._arm, None if self._ring is None else self._ring.lidar
        header = {
            "op": "hello",
            "format": FORMAT,
            "site": run.site.name,
            "seed": run.config.seed,
            "tick_s": run.tick_s,
            "cars": [f"car_{k}" for k in range(run.world.n_cars)],
            "arms": [f"arm_{k}" for k in range(run.world.n_arms)],
            "stations": [station.name for station in run.stations],
            "joints": [f"joint_{k}" for k in range(1, arm.n_joints + 1)],
            "wheelbase_m": car.wheelbase_m,
            "track_m": car.track_m,
            "max_speed_mps": car.max_speed_mps,
            "max_steering_rad": car.max_steering_rad,
            "lidar": None
            if lidar is None
            else {"n_rays": lidar.n_rays, "range_m": lidar.range_m, "ahead_m": (car.front_m - car.rear_m) / 2},
            "batteries": run.batteries is not None,
        }
        limits = {"lower_rad": arm.lower_rad, "upper_rad": arm.upper_rad, "max_velocity_radps": arm.max_velocity_radps}
        return encoded(header, {**limits, "arm_base": run.scene.arm_base})

    def state(self) -> bytes:
        """Where everything is: cars x, y, yaw, speed, steering; arms' joint positions and velocities."""
        run = self._run
        world = run.world
        cars = np.column_stack((world.car_poses(), world.car_speeds(), world.car_steering()))
        arrays = {"cars": cars, "arm_q": world.arm_positions(), "arm_qd": world.arm_velocities()}
        if run.batteries is not None:
            arrays["battery"] = run.batteries.charge
        return encoded({"op": "state", "tick": run.now, "sim_s": run.sim_s}, arrays)

    def scan(self) -> bytes | None:
        """What the lidars of all cars measure, if that is due now: distances [m], shape (n_cars, n_rays)."""
        run = self._run
        if self._ring is None or run.now % self._scan_ticks:
            return None
        origins, ends = self._ring.rays(run.world.car_poses())
        distances: FloatArray = self._ring.distances(run.world.rays(origins, ends), self._rng)
        distances *= self._ring.lidar.range_m
        return encoded({"op": "scan", "tick": run.now, "sim_s": run.sim_s}, {"distances": distances})

    def image(self, station: str) -> bytes:
        """What the camera over a station sees, as rows of red, green and blue bytes.

        Raises:
            SensorError: The world has no bodies to see.
        """
        run = self._run
        place = run.stations.named(station).place
        camera = station_camera(place, place.dock.tray_xy, run.scene.car.tray_floor_z_m)
        rgb = run.world.image(camera).rgb
        head = {"op": "image", "camera": camera.name, "station": station, "sim_s": run.sim_s}
        size = {"height": rgb.shape[0], "width": rgb.shape[1]}
        return encoded(head | size, content=np.ascontiguousarray(rgb, dtype=np.uint8).tobytes())


def event_frame(event: Event) -> bytes:
    """Something that happened."""
    return encoded(
        {"op": "event", "tick": event.tick, "sim_s": event.sim_s, "kind": event.kind, "facts": plain(event.facts)}
    )
