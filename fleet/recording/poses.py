"""Poses: where every drawn part of every robot is, for many frames at once, in plain numpy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fleet.robots.spec import ArmSpec, CarSpec, Visual

Array = npt.NDArray[np.floating]
LinkPoses = Mapping[str, tuple[Array, Array]]
"""Link -> positions (f, n, 3) [m] and quaternions xyzw (f, n, 4), both in the world."""

_UPRIGHT = np.eye(3)
_STRAIGHT_RAD = 1e-6
"""Below this steering angle the turning circle is taken as infinite."""


def quat_multiply(a: Array, b: Array) -> Array:
    """Products of quaternions xyzw, broadcast, shape (..., 4): first `b`, then `a`."""
    ax, ay, az, aw = np.moveaxis(a, -1, 0)
    bx, by, bz, bw = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def quat_rotate(quat: Array, vector: Array) -> Array:
    """Vectors turned by quaternions xyzw, broadcast, shape (..., 3).

    Source: v' = v + 2 w (u x v) + 2 u x (u x v), the expansion of q v q* for unit q = (u, w).
    """
    ux, uy, uz, w = np.moveaxis(quat, -1, 0)
    vx, vy, vz = np.moveaxis(vector, -1, 0)
    tx, ty, tz = 2 * (uy * vz - uz * vy), 2 * (uz * vx - ux * vz), 2 * (ux * vy - uy * vx)
    return np.stack(
        [vx + w * tx + uy * tz - uz * ty, vy + w * ty + uz * tx - ux * tz, vz + w * tz + ux * ty - uy * tx], axis=-1
    )


def quat_from_matrix(matrix: Array) -> Array:
    """Quaternion xyzw of one rotation matrix, shape (4,).

    Source: S. W. Shepperd, Quaternion from rotation matrix, J. Guidance and Control 1978 (largest of the four first).
    """
    m = np.asarray(matrix, float)[:3, :3]
    four = np.array([m[0, 0], m[1, 1], m[2, 2], np.trace(m)])
    k = int(np.argmax(four))
    quat = np.empty(4)
    if k == 3:
        quat[:] = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1.0 + four[3]
    else:
        i, j, n = k, (k + 1) % 3, (k + 2) % 3
        quat[i] = 1.0 + m[i, i] - m[j, j] - m[n, n]
        quat[j] = m[j, i] + m[i, j]
        quat[n] = m[n, i] + m[i, n]
        quat[3] = m[n, j] - m[j, n]
    return quat / np.linalg.norm(quat)


def _about(axis: int, angle: Array) -> Array:
    """Quaternions of turns about a coordinate axis, shape (..., 4)."""
    quat = np.zeros((*angle.shape, 4), angle.dtype)
    quat[..., axis] = np.sin(angle / 2)
    quat[..., 3] = np.cos(angle / 2)
    return quat


def ackermann_angles(spec: CarSpec, steering: Array) -> tuple[Array, Array]:
    """Steering of the left and the right front wheel for a bicycle-equivalent angle [rad], same shape.

    Source: R. Rajamani, Vehicle Dynamics and Control, 2nd ed., section 2.5: all wheels turn about one centre.
    """
    small = np.abs(steering) < _STRAIGHT_RAD
    radius = spec.wheelbase_m / np.tan(np.where(small, _STRAIGHT_RAD, steering))
    left = np.arctan(spec.wheelbase_m / (radius - spec.track_m / 2))
    right = np.arctan(spec.wheelbase_m / (radius + spec.track_m / 2))
    return np.where(small, steering, left), np.where(small, steering, right)


def car_link_poses(spec: CarSpec, poses: Array, steering: Array, wheel_angle: Array) -> LinkPoses:
    """Poses of the links of all cars.

    'chassis' and 'tray' are the car's own frame (rear axle centre, on the floor); a wheel's frame sits in its centre
    with +y along the axle, turned by the steering angle and then rolled.

    Args:
        spec: The car.
        poses: Rear-axle poses x, y, yaw, shape (f, n, 3).
        steering: Bicycle-equivalent steering [rad], shape (f, n).
        wheel_angle: Rolled angle [rad], shape (f, n).

    Returns:
        Poses of 'chassis', 'tray' and the four wheels.
    """
    yaw = poses[..., 2]
    cos, sin = np.cos(yaw), np.sin(yaw)
    origin = np.stack([poses[..., 0], poses[..., 1], np.zeros_like(yaw)], axis=-1)
    heading = _about(2, yaw)
    roll = _about(1, wheel_angle)
    steer_left, steer_right = ackermann_angles(spec, steering)
    rear = quat_multiply(heading, roll)
    links: dict[str, tuple[Array, Array]] = {"chassis": (origin, heading), "tray": (origin, heading)}
    half = spec.track_m / 2
    for link, ahead, aside, quat in (
        ("rear_left", 0.0, half, rear),
        ("rear_right", 0.0, -half, rear),
        ("front_left", spec.wheelbase_m, half, quat_multiply(_about(2, yaw + steer_left), roll)),
        ("front_right", spec.wheelbase_m, -half, quat_multiply(_about(2, yaw + steer_right), roll)),
    ):
        centre = origin.copy()
        centre[..., 0] += cos * ahead - sin * aside
        centre[..., 1] += sin * ahead + cos * aside
        centre[..., 2] = spec.wheel_radius_m
        links[link] = (centre, quat)
    return links


def arm_link_poses(spec: ArmSpec, base: Array, q: Array) -> LinkPoses:
    """Poses of the links of all arms by forward kinematics.

    Args:
        spec: The arm.
        base: Base poses x, y, z, yaw, shape (m, 4).
        q: Joint positions [rad], shape (f, m, n_joints).

    Returns:
        Poses of 'link_0' .. 'link_<n_joints>' and of 'tool', which moves with the last link.
    """
    shape = q.shape[:2]
    position = np.broadcast_to(base[:, :3], (*shape, 3))
    quat = np.broadcast_to(_about(2, base[:, 3]), (*shape, 4))
    links: dict[str, tuple[Array, Array]] = {"link_0": (position, quat)}
    for joint in range(spec.n_joints):
        parent_from_joint = spec.base_from_joint[joint]
        position = position + quat_rotate(quat, parent_from_joint[:3, 3])
        fixed = quat_from_matrix(parent_from_joint)
        turn = q[..., joint] / 2
        # fixed * (0, 0, sin, cos), written out: half of a general product
        cos, sin = np.cos(turn)[..., None], np.sin(turn)[..., None]
        about_z = np.array([fixed[1], -fixed[0], fixed[3], -fixed[2]])
        quat = quat_multiply(quat, fixed * cos + about_z * sin)
        links[f"link_{joint + 1}"] = (position, quat)
    links["tool"] = links[f"link_{spec.n_joints}"]
    return links


@dataclass(frozen=True, kw_only=True)
class Part:
    """All drawings that share one shape and colour; an entity of the recording."""

    name: str
    mesh: Path | None
    """None: boxes, which may differ in size and colour."""
    visuals: tuple[Visual, ...]

    def poses(self, links: LinkPoses) -> tuple[Array, Array]:
        """Poses of all instances, ordered by visual, then robot.

        Args:
            links: Poses of the robots' links, each over (f, n).

        Returns:
            Positions (f, n_visuals * n, 3) and quaternions xyzw (f, n_visuals * n, 4).
        """
        positions, quats = [], []
        for visual in self.visuals:
            position, quat = links[visual.link]
            matrix = visual.link_from_visual
            if matrix[:3, 3].any():
                position = position + quat_rotate(quat, matrix[:3, 3])
            if not (matrix[:3, :3] == _UPRIGHT).all():
                quat = quat_multiply(quat, quat_from_matrix(matrix))
            positions.append(position)
            quats.append(quat)
        return np.concatenate(positions, axis=1), np.concatenate(quats, axis=1)


def parts(visuals: Sequence[Visual]) -> tuple[Part, ...]:
    """Group visuals into parts: one per mesh and colour, and one for all boxes."""
    groups: dict[tuple[Path | None, tuple[float, ...]], list[Visual]] = {}
    for visual in visuals:
        key = (visual.mesh, visual.rgba if visual.mesh is not None else ())
        groups.setdefault(key, []).append(visual)
    made, taken = [], set()
    for (mesh, _), members in groups.items():
        stem = "boxes" if mesh is None else mesh.stem
        name, count = stem, 1
        while name in taken:
            count += 1
            name = f"{stem}_{count}"
        taken.add(name)
        made.append(Part(name=name, mesh=mesh, visuals=tuple(members)))
    return tuple(made)
