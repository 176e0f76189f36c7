"""Poses: where every drawn part of every robot is, for many frames at once, in plain numpy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.recording.rerun_stream.meshes import Mesh, link_mesh
from fleet.robots.arms.spec import ArmSpec
from fleet.robots.arms.team import ArmTeam
from fleet.robots.spec import WHEELS, CarSpec
from fleet.robots.twist.pod import pod_visuals

Array = npt.NDArray[np.floating]
LinkPoses = Mapping[str, tuple[Array, Array]]
"""Link -> positions (f, n, 3) [m] and quaternions xyzw (f, n, 4), both in the world."""

BODY = "body"
_STEPS = 4096.0
"""Steps of a recorded coordinate in a metre, and of a component of a quaternion in one."""
_STRAIGHT_RAD = 1e-6
"""Below this steering angle the turning circle is taken as infinite."""


def at_height(xy: Array, z_m: float) -> FloatArray:
    """Put points of the floor at a height.

    Args:
        xy: Points [m], shape (k, 2), or (0,) for none.
        z_m: Height [m].

    Returns:
        x, y, z [m], shape (k, 3).
    """
    return np.column_stack([xy.reshape(-1, 2), np.full(len(xy), z_m)])


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


def ackermann_angles(wheelbase_m: Array | float, track_m: Array | float, steering: Array) -> tuple[Array, Array]:
    """Steering of the left and the right front wheel for a bicycle-equivalent angle [rad], same shape.

    Source: R. Rajamani, Vehicle Dynamics and Control, 2nd ed., section 2.5: all wheels turn about one centre.
    """
    small = np.abs(steering) < _STRAIGHT_RAD
    radius = wheelbase_m / np.tan(np.where(small, _STRAIGHT_RAD, steering))
    left = np.arctan(wheelbase_m / (radius - track_m / 2))
    right = np.arctan(wheelbase_m / (radius + track_m / 2))
    return np.where(small, steering, left), np.where(small, steering, right)


def car_link_poses(
    spec: CarSpec, poses: Array, steering: Array, wheel_angle: Array, *, wheels: bool = True
) -> LinkPoses:
    """Poses of the links of all cars.

    The body's frame is the car's own (rear axle centre, on the floor); a wheel's frame sits in its centre with +y along
    the axle, turned by the steering angle and then rolled.

    Args:
        spec: The car.
        poses: Rear-axle poses x, y, yaw, shape (f, n, 3).
        steering: Bicycle-equivalent steering [rad], shape (f, n).
        wheel_angle: Rolled angle [rad], shape (f, n).
        wheels: Whether the wheels are wanted.

    Returns:
        Poses of the body and the four wheels.
    """
    origin, heading = _on_floor(np.ascontiguousarray(poses, np.float64).reshape(-1, 3))
    origin, heading = origin.reshape(*poses.shape[:-1], 3), heading.reshape(*poses.shape[:-1], 4)
    links: dict[str, tuple[Array, Array]] = {BODY: (origin, heading)}
    if not wheels:
        return links
    yaw = poses[..., 2]
    cos, sin = np.cos(yaw), np.sin(yaw)
    roll = _about(1, wheel_angle)
    turn = steering if spec.steers else np.zeros_like(steering)
    left, right = ackermann_angles(spec.wheelbase_m, spec.track_m, turn)
    straight = np.zeros_like(yaw)
    turns = dict(zip(WHEELS, (straight, straight, left, right), strict=True))
    for link, (ahead, aside, up) in zip(WHEELS, spec.wheel_places.tolist(), strict=True):
        centre = origin.copy()
        centre[..., 0] += cos * ahead - sin * aside
        centre[..., 1] += sin * ahead + cos * aside
        centre[..., 2] = up
        links[link] = (centre, quat_multiply(_about(2, yaw + turns[link]), roll))
    return links


@njit(cache=True)
def _on_floor(poses: Array) -> tuple[FloatArray, FloatArray]:
    """Positions (k, 3) and quaternions xyzw (k, 4) from x, y, yaw, (k, 3)."""
    position, quat = np.zeros((len(poses), 3)), np.zeros((len(poses), 4))
    for k in range(len(poses)):
        position[k, 0], position[k, 1] = poses[k, 0], poses[k, 1]
        quat[k, 2], quat[k, 3] = np.sin(poses[k, 2] / 2), np.cos(poses[k, 2] / 2)
    return position, quat


class ArmChain:
    """Forward kinematics of arms.

    Args:
        team: Their models.
    """

    def __init__(self, team: ArmTeam) -> None:
        self._places = np.ascontiguousarray(team.joints[:, :, :, 3])
        self._turns = np.array([[quat_from_matrix(joint) for joint in arm] for arm in team.joints])
        self._turns = self._turns.reshape(len(team), team.width, 4)

    def link_poses(self, base: Array, q: Array) -> tuple[Array, Array]:
        """Poses of the links; those of links that an arm does not have are those of its last.

        Args:
            base: Base poses x, y, z, yaw, shape (m, 4).
            q: Joint positions [rad], shape (f, m, n_joints).

        Returns:
            Positions (n_joints + 1, f, m, 3) [m] and quaternions xyzw (n_joints + 1, f, m, 4) of the links from the
            base on, in the world.
        """
        shape = (self._turns.shape[1] + 1, *q.shape[:2])
        position, quat = np.empty((*shape, 3)), np.empty((*shape, 4))
        _chain(np.asarray(base, np.float64), self._places, self._turns, np.asarray(q, np.float64), position, quat)
        return position, quat


@njit(cache=True)
def _chain(
    base: FloatArray,
    places: FloatArray,
    turns: FloatArray,
    q: FloatArray,
    position: FloatArray,
    quat: FloatArray,
) -> None:
    """Fill positions (n + 1, f, m, 3) and quaternions (n + 1, f, m, 4) from base (m, 4) on, along joints that stand at
    `places` (m, n, 3), turned by `turns` (m, n, 4), in the link before, and turn about their z by q (f, m, n).
    """
    for f in range(q.shape[0]):
        for m in range(q.shape[1]):
            x, y, z = base[m, 0], base[m, 1], base[m, 2]
            a, b, c, d = 0.0, 0.0, np.sin(base[m, 3] / 2), np.cos(base[m, 3] / 2)
            position[0, f, m, 0], position[0, f, m, 1], position[0, f, m, 2] = x, y, z
            quat[0, f, m, 0], quat[0, f, m, 1], quat[0, f, m, 2], quat[0, f, m, 3] = a, b, c, d
            for k in range(q.shape[2]):
                vx, vy, vz = places[m, k, 0], places[m, k, 1], places[m, k, 2]
                # v' = v + 2 w (u x v) + 2 u x (u x v), the expansion of q v q* for unit q = (u, w)
                tx, ty, tz = 2 * (b * vz - c * vy), 2 * (c * vx - a * vz), 2 * (a * vy - b * vx)
                x += vx + d * tx + b * tz - c * ty
                y += vy + d * ty + c * tx - a * tz
                z += vz + d * tz + a * ty - b * tx
                sin, cos = np.sin(q[f, m, k] / 2), np.cos(q[f, m, k] / 2)
                # the fixed turn, then (0, 0, sin, cos)
                e = turns[m, k, 0] * cos + turns[m, k, 1] * sin
                g = turns[m, k, 1] * cos - turns[m, k, 0] * sin
                h = turns[m, k, 2] * cos + turns[m, k, 3] * sin
                i = turns[m, k, 3] * cos - turns[m, k, 2] * sin
                a, b, c, d = (
                    d * e + a * i + b * h - c * g,
                    d * g - a * h + b * i + c * e,
                    d * h + a * g - b * e + c * i,
                    d * i - a * e - b * g - c * h,
                )
                position[k + 1, f, m, 0], position[k + 1, f, m, 1], position[k + 1, f, m, 2] = x, y, z
                quat[k + 1, f, m, 0], quat[k + 1, f, m, 1] = a, b
                quat[k + 1, f, m, 2], quat[k + 1, f, m, 3] = c, d


def snapped(values: Array) -> npt.NDArray[np.float32]:
    """Coordinates on a grid of 2^-12, a quarter of a millimetre: what stands or drives straight repeats its bytes.

    Recordings are compressed by LZ4, which finds repeated bytes and nothing else.
    """
    return _snapped(np.ascontiguousarray(values).reshape(-1)).reshape(values.shape)


@njit(cache=True)
def _snapped(values: Array) -> npt.NDArray[np.float32]:
    made = np.empty(len(values), np.float32)
    for k in range(len(values)):
        made[k] = np.rint(values[k] * _STEPS) / _STEPS
    return made


@dataclass(frozen=True, kw_only=True)
class Part:
    """What is drawn of one link of all robots of a kind; an entity of the recording."""

    link: str
    mesh: Mesh


def car_parts(spec: CarSpec, *, wheels: bool) -> tuple[Part, ...]:
    """Drawn parts of a car: its body and, with `wheels`, each wheel by itself; without, the body has its wheels on."""
    own = {link: [visual for visual in spec.visuals if visual.link == link] for link in WHEELS}
    body = [visual for visual in spec.visuals if visual.link not in own]
    if not wheels:
        for link, (ahead, aside, up) in zip(WHEELS, spec.wheel_places.tolist(), strict=True):
            place = np.eye(4)
            place[:3, 3] = ahead, aside, up
            body += [replace(visual, link_from_visual=place @ visual.link_from_visual) for visual in own[link]]
        own = {}
    return tuple(Part(link=link, mesh=link_mesh(drawn)) for link, drawn in ({BODY: body} | own).items() if drawn)


def pod_part() -> Part:
    """The drawn part of a pod."""
    return Part(link="pods", mesh=link_mesh(pod_visuals()))


def arm_parts(spec: ArmSpec) -> tuple[Part, ...]:
    """Drawn parts of an arm, link by link; the tool belongs to the last one."""
    last = f"link_{spec.n_joints}"
    links = [f"link_{k}" for k in range(spec.n_joints + 1)]
    drawn = {link: [v for v in spec.visuals if v.link == link or (link == last and v.link == "tool")] for link in links}
    return tuple(Part(link=link, mesh=link_mesh(visuals)) for link, visuals in drawn.items() if visuals)
