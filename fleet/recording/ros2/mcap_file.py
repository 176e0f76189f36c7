"""McapFile: a run as an MCAP file with the topics that a ROS 2 system of such robots would have."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from fleet.arrays import FloatArray
from fleet.recording.errors import RecordingError
from fleet.recording.rerun_stream.poses import ArmChain, ackermann_angles
from fleet.recording.ros2.messages import (
    JOINT_STATE,
    LOG,
    ODOMETRY,
    TRANSFORMS,
    definition,
    joint_state,
    log,
    odometry,
    transforms,
)
from fleet.world.scene import Scene

MAP = "map"
EXTRA = "pip install '.[mcap]'"
_LATCHED = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""
"""How a topic is offered whose last message is given to whoever comes later, in the words of rosbag2."""


class McapFile:
    """Writes a run; use as a context manager. The file appears under its name when it is whole, and not before.

    Topics: `/tf` (cars in `map`, flanges of arms in their bases), `/tf_static` (bases of arms in `map`), for each car
    `odom` and `joint_states` (its two steering joints), for each arm `joint_states`, and `/events`. All times are
    simulated.

    Args:
        path: File to write; replaced if it exists.
        scene: Robots.

    Raises:
        RecordingError: The package `mcap` is not installed, or the file cannot be opened.
    """

    def __init__(self, path: Path, scene: Scene) -> None:
        try:
            from mcap.writer import Writer
        except ImportError as error:
            raise RecordingError(f"{path}: MCAP needs the package mcap; valid: {EXTRA}") from error
        self._path = path
        self._wheelbase_m, self._track_m = scene.cars.each("wheelbase_m"), scene.cars.each("track_m")
        self._steers = scene.cars.each("turn_base_m") > 0.0
        self._part = path.with_name(path.name + ".part")
        try:
            self._file = self._part.open("wb")
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {error.strerror or error}; valid: a file") from error
        self._writer = Writer(self._file)
        self._writer.start(profile="ros2", library="fleet")
        self._schemas: dict[str, int] = {}
        n_cars, n_arms = len(scene.car_start), len(scene.arm_base)
        cars, arms = [f"car_{k}" for k in range(n_cars)], [f"arm_{k}" for k in range(n_arms)]
        pairs = [(MAP, f"{car}/base_link") for car in cars] + [(f"{arm}/base", f"{arm}/flange") for arm in arms]
        self._transforms = transforms(pairs)
        self._tf = self._channel("/tf", TRANSFORMS)
        self._odometry = [odometry(MAP, f"{car}/base_link") for car in cars]
        self._odom = [self._channel(f"/{car}/odom", ODOMETRY) for car in cars]
        self._steering = [joint_state(["left_steer", "right_steer"], velocities=False) for _ in cars]
        self._car_joints = [self._channel(f"/{car}/joint_states", JOINT_STATE) for car in cars]
        self._n_joints = scene.arms.n_joints.tolist()
        self._positions = [
            joint_state([f"joint_{k}" for k in range(1, n + 1)], velocities=True) for n in self._n_joints
        ]
        self._arm_joints = [self._channel(f"/{arm}/joint_states", JOINT_STATE) for arm in arms]
        self._events = self._channel("/events", LOG)
        self._chain = ArmChain(scene.arms)
        self._at_home = np.zeros((n_arms, 4))
        self.n_messages = 0
        """Messages written so far."""
        if arms:
            static = transforms([(MAP, f"{arm}/base") for arm in arms])
            channel = self._channel("/tf_static", TRANSFORMS, {"offered_qos_profiles": _LATCHED})
            self._write(
                channel, 0, static.encoded(0, _poses(scene.arm_base[:, :3], scene.arm_base[:, 3]).ravel().tolist())
            )

    def write(
        self,
        sim_s: float,
        car_poses: FloatArray,
        car_speeds: FloatArray,
        car_steering: FloatArray,
        arm_q: FloatArray,
        arm_qd: FloatArray,
    ) -> None:
        """Write where everything is.

        Args:
            sim_s: Simulated time [s].
            car_poses: Rear-axle poses x, y, yaw [m, m, rad], shape (n_cars, 3).
            car_speeds: Signed forward speeds [m/s], shape (n_cars,).
            car_steering: Bicycle-equivalent steering angles [rad], or yaw rates [rad/s], shape (n_cars,).
            arm_q: Joint positions [rad], shape (n_arms, n_joints).
            arm_qd: Joint velocities [rad/s], same shape.
        """
        time_ns = round(sim_s * 1e9)
        places = np.column_stack((car_poses[:, :2], np.zeros(len(car_poses))))
        rows = _poses(places, car_poses[:, 2])
        numbers = rows.ravel().tolist()
        if len(arm_q):
            position, quat = self._chain.link_poses(self._at_home, arm_q[None])
            numbers += np.column_stack((position[-1, 0], quat[-1, 0])).ravel().tolist()
        self._write(self._tf, time_ns, self._transforms.encoded(time_ns, numbers))
        steering = np.where(self._steers, car_steering, 0.0)
        left, right = ackermann_angles(self._wheelbase_m, self._track_m, steering)
        turning = np.where(self._steers, car_speeds * np.tan(steering) / self._wheelbase_m, car_steering)
        for k, row in enumerate(rows.tolist()):
            twist = [float(car_speeds[k]), 0.0, 0.0, 0.0, 0.0, float(turning[k])]
            self._write(self._odom[k], time_ns, self._odometry[k].encoded(time_ns, row + twist))
            angles = [float(left[k]), float(right[k])]
            self._write(self._car_joints[k], time_ns, self._steering[k].encoded(time_ns, angles))
        for k, n in enumerate(self._n_joints):
            q = [*arm_q[k, :n].tolist(), *arm_qd[k, :n].tolist()]
            self._write(self._arm_joints[k], time_ns, self._positions[k].encoded(time_ns, q))

    def event(self, sim_s: float, level: int, kind: str, text: str) -> None:
        """Write something that happened, in the order of time.

        Args:
            sim_s: Simulated time [s].
            level: `INFO` or `WARN` of the messages.
            kind: One word.
            text: What is known of it.
        """
        time_ns = round(sim_s * 1e9)
        self._write(self._events, time_ns, log(level, kind, text).encoded(time_ns))

    def _channel(self, topic: str, kind: str, metadata: Mapping[str, str] | None = None) -> int:
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition(kind).encode())
        return self._writer.register_channel(topic, "cdr", self._schemas[kind], dict(metadata or {}))

    def _write(self, channel: int, time_ns: int, content: bytes) -> None:
        self.n_messages += 1
        self._writer.add_message(channel, time_ns, content, time_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                self._writer.finish()
                self._file.close()
                self._part.replace(self._path)
        except OSError as fault:
            raise RecordingError(
                f"{self._path}: cannot be written: {fault.strerror or fault}; valid: a file"
            ) from fault
        finally:
            self._file.close()
            self._part.unlink(missing_ok=True)


def _poses(places: FloatArray, yaw: FloatArray) -> FloatArray:
    """Rows x, y, z, qx, qy, qz, qw, shape (n, 7)."""
    rows = np.zeros((len(places), 7))
    rows[:, :3] = places
    rows[:, 5], rows[:, 6] = np.sin(yaw / 2), np.cos(yaw / 2)
    return rows
