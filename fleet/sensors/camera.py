"""Camera: a pinhole with a pose in the world, and the image it takes: colour, depth, segmentation, points.

Camera frame: x to the right of the image, y down, z along the optical axis. Pixel (u, v) is column u, row v; its centre
has the image coordinates (u, v), so the image spans -0.5 to width - 0.5. A point (x, y, z) in the camera frame is seen
at u = f x / z + cx, v = f y / z + cy.
Source: R. Hartley, A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd ed., 2004, chapter 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.arrays import BoolArray, FloatArray
from fleet.config.field_checks import is_whole
from fleet.sensors.errors import SensorError

MAX_EDGE_PX = 2048
"""Largest width and height of an image: more than this takes seconds to render."""
FOV_RAD = (math.radians(1.0), math.radians(170.0))
"""Smallest and largest field of view."""
_ROTATION_TOLERANCE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A pinhole camera with square pixels and the principal point in the middle of the image.

    Raises:
        SensorError: A size, angle, distance or pose that no camera can have.
    """

    name: str
    world_from_camera: FloatArray
    """Pose of the camera frame, shape (4, 4)."""
    width_px: int = 640
    height_px: int = 480
    fov_rad: float = math.radians(45.0)
    """Field of view from the upper to the lower edge of the image [rad]."""
    near_m: float = 0.1
    """What is nearer along the optical axis is not seen [m]."""
    far_m: float = 10.0
    """What is farther along the optical axis is not seen [m]."""

    def __post_init__(self) -> None:
        for what, size in (("width_px", self.width_px), ("height_px", self.height_px)):
            ok = is_whole(size) and 1 <= size <= MAX_EDGE_PX
            self._require(ok, what, size, f"an integer from 1 to {MAX_EDGE_PX}")
        low, high = FOV_RAD
        self._require(low <= self.fov_rad <= high, "fov_rad", self.fov_rad, f"{low:.3f} to {high:.3f}")
        self._require(0.0 < self.near_m < math.inf, "near_m", self.near_m, "a number > 0")
        ok = self.near_m < self.far_m < math.inf
        self._require(ok, "far_m", self.far_m, f"a number > near_m = {self.near_m:g}")
        pose = np.asarray(self.world_from_camera, dtype=np.float64)
        ok = pose.shape == (4, 4)
        self._require(ok, "world_from_camera", f"of shape {pose.shape}", "a rigid transform of shape (4, 4)")
        turn, last = pose[:3, :3], (0.0, 0.0, 0.0, 1.0)
        rigid = bool(np.isfinite(pose).all()) and np.allclose(turn @ turn.T, np.eye(3), atol=_ROTATION_TOLERANCE)
        rigid = rigid and np.linalg.det(turn) > 0 and np.array_equal(pose[3], last)
        self._require(rigid, "world_from_camera", pose.tolist(), "a finite rotation and translation over (0, 0, 0, 1)")
        object.__setattr__(self, "world_from_camera", pose)

    @property
    def aims_at(self) -> FloatArray:
        """Where its axis meets the floor, or its own place if it does not, x, y, shape (2,) [m]."""
        eye, axis = self.world_from_camera[:3, 3], self.world_from_camera[:3, 2]
        return np.asarray(eye[:2] - axis[:2] * eye[2] / axis[2] if axis[2] < -1e-6 else eye[:2])

    @classmethod
    def looking_at(
        cls,
        name: str,
        *,
        eye_m: npt.ArrayLike,
        target_m: npt.ArrayLike,
        up: npt.ArrayLike = (0.0, 0.0, 1.0),
        width_px: int = 640,
        height_px: int = 480,
        fov_rad: float = math.radians(45.0),
        near_m: float = 0.1,
        far_m: float = 10.0,
    ) -> Camera:
        """Make a camera at one point that looks at another.

        Args:
            name: What it is called in messages.
            eye_m: Where it is, world frame [m], shape (3,).
            target_m: What is in the middle of its image, world frame [m], shape (3,).
            up: Direction in the world that points up in the image, shape (3,); not along the optical axis.
            width_px: See `Camera`, as are the rest.
            height_px: Rows.
            fov_rad: Field of view from top to bottom [rad].
            near_m: Nearest depth seen [m].
            far_m: Farthest depth seen [m].

        Raises:
            SensorError: The direction is undefined, or `Camera` refuses an argument.
        """
        eye, target, above = (np.asarray(x, dtype=np.float64) for x in (eye_m, target_m, up))
        for what, vector in (("eye_m", eye), ("target_m", target), ("up", above)):
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise SensorError(f"camera {name}: {what} is {vector.tolist()}; valid: three finite numbers")
        ahead = target - eye
        right = np.cross(ahead, above)
        if np.linalg.norm(ahead) < 1e-9:
            raise SensorError(f"camera {name}: target_m is {target.tolist()}; valid: a point other than eye_m")
        if np.linalg.norm(right) < 1e-9 * np.linalg.norm(ahead):
            raise SensorError(f"camera {name}: up is {above.tolist()}; valid: a direction across the optical axis")
        z, x = ahead / np.linalg.norm(ahead), right / np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack((x, np.cross(z, x), z))
        pose[:3, 3] = eye
        return cls(
            name=name,
            world_from_camera=pose,
            width_px=width_px,
            height_px=height_px,
            fov_rad=fov_rad,
            near_m=near_m,
            far_m=far_m,
        )

    @property
    def focal_px(self) -> float:
        """Focal length [px], the same along both axes."""
        return self.height_px / (2.0 * math.tan(self.fov_rad / 2.0))

    @property
    def centre_px(self) -> tuple[float, float]:
        """Principal point (u, v)."""
        return (self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0

    @property
    def matrix(self) -> FloatArray:
        """Intrinsic matrix K [px], shape (3, 3): (u, v, 1) ~ K (x, y, z)."""
        u, v = self.centre_px
        return np.array([[self.focal_px, 0.0, u], [0.0, self.focal_px, v], [0.0, 0.0, 1.0]])

    def rays(self) -> FloatArray:
        """Direction through every pixel, camera frame, scaled to z = 1, shape (height, width, 3)."""
        centre_u, centre_v = self.centre_px
        u, v = np.meshgrid(np.arange(self.width_px), np.arange(self.height_px))
        return np.stack(((u - centre_u) / self.focal_px, (v - centre_v) / self.focal_px, np.ones(u.shape)), axis=-1)

    def project(self, points: FloatArray) -> FloatArray:
        """See points of the world.

        Args:
            points: World frame [m], shape (..., 3).

        Returns:
            Image coordinates u, v [px] and depth [m], shape (..., 3); u and v are nan for points not ahead.
        """
        local = (np.asarray(points, dtype=np.float64) - self.world_from_camera[:3, 3]) @ self.world_from_camera[:3, :3]
        depth = np.where(local[..., 2:] > 0.0, local[..., 2:], np.nan)
        uv = self.focal_px * local[..., :2] / depth + np.array(self.centre_px)
        return np.concatenate((uv, local[..., 2:]), axis=-1)

    def _require(self, ok: bool, what: str, value: object, valid: str) -> None:
        if not ok:
            raise SensorError(f"camera {self.name}: {what} is {value}; valid: {valid}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraImage:
    """What a camera saw at one instant."""

    camera: Camera
    rgb: npt.NDArray[np.uint8]
    """Colours, shape (height, width, 3)."""
    depth_m: npt.NDArray[np.float32]
    """Distance along the optical axis, not along the ray [m], inf where nothing is seen, shape (height, width)."""
    body: npt.NDArray[np.int32]
    """The engine's id of the body at each pixel, -1 for none, shape (height, width)."""
    link: npt.NDArray[np.int32]
    """Link of that body, -1 for its base and for no body, shape (height, width)."""
    parcel: npt.NDArray[np.int32]
    """Id of the parcel at each pixel, -1 for anything else, shape (height, width)."""

    def points(self) -> FloatArray:
        """The point seen at each pixel, world frame [m], nan where nothing is seen, shape (height, width, 3)."""
        depth = np.where(np.isfinite(self.depth_m), self.depth_m, np.nan).astype(np.float64)
        pose = self.camera.world_from_camera
        return (self.camera.rays() * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]

    def cloud(self, mask: BoolArray | None = None) -> FloatArray:
        """The points that are seen, world frame [m], shape (k, 3).

        Args:
            mask: Pixels wanted, shape (height, width); None = all.
        """
        seen = np.isfinite(self.depth_m)
        return self.points()[seen if mask is None else seen & mask]
