"""Boxes from an image: where parcels lie, how they are turned, and which of them can be picked, from depth and labels.

Of every labelled body the largest face that looks up is found: planes through sample pixels are voted for by the
points near them, and the best one is fitted by least squares. In that plane the smallest rectangle round the face gives
centre, sides and direction, which the four sides together then refine.
Sources: M. Fischler, R. Bolles, "Random sample consensus", CACM 24(6), 1981 (voting; the samples here are a fixed
grid); H. Freeman, R. Shapira, "Determining the minimum-area encasing rectangle for an arbitrary closed curve", CACM
18(7), 1975.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.sensors.camera import Camera
from fleet.sensors.errors import SensorError

Mask = BoolArray

LEAST_PX = 40
"""A face with fewer pixels than this is not measured."""
N_SAMPLES = 48
"""Pixels of a body through which planes are tried."""
ON_PLANE_M = 0.002
"""Points this near a plane belong to it [m]."""
LEAST_SHARE = 0.2
"""A face has at least this part of a body's points: a plane laid across an edge has about a tenth."""
LEAST_UP = math.cos(math.radians(60.0))
"""A face looks up if the upward part of its normal is at least this: one face of a box always does, even on its corner
(54.7 degrees)."""
IN_FRONT_M = 0.015
"""What is nearer to the camera than its neighbour on a face by more than this hides some of the face [m]; a wall that a
parcel stands at, seen under 10 degrees, is nearer by about 6 mm per millimetre of image."""
HIDDEN_SHARE = 0.03
"""A face whose outline is hidden by more than this is obstructed."""
WHOLE_SHARE = 0.85
"""A face that fills less of its rectangle than this is obstructed: it is no rectangle."""
CORNER_SHARE = 0.15
"""Part of each end of a side that is left out when its direction is measured."""


class LocateStatus(Enum):
    """How a search for boxes ended."""

    FOUND = "found"
    """At least one box can be picked."""
    NOTHING_SEEN = "nothing_seen"
    """No labelled pixel has a depth."""
    NO_FACE = "no_face"
    """Labelled bodies are seen, but no face of them looks up and is large enough."""
    ALL_OBSTRUCTED = "all_obstructed"
    """Every box is partly hidden or cut off by the edge of the image."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenBox:
    """A box by its upper face."""

    label: int
    """Label of its pixels."""
    world_from_top: FloatArray
    """Frame of the upper face: origin in its centre, x along the longer side, z out of the box, shape (4, 4)."""
    size_m: tuple[float, float, float]
    """Longer side, shorter side, and height over the support below the centre."""
    obstructed: bool
    """Whether something hides a part of the upper face, or the edge of the image cuts it off."""

    @property
    def centre_m(self) -> FloatArray:
        """Middle of the box, world frame [m], shape (3,)."""
        return self.world_from_top[:3, 3] - self.world_from_top[:3, 2] * (self.size_m[2] / 2)

    @property
    def yaw_rad(self) -> float:
        """Direction of the longer side, seen from above, in (-pi/2, pi/2] [rad]."""
        x, y = self.world_from_top[:2, 0]
        yaw = math.atan2(y, x)
        return yaw - math.pi if yaw > math.pi / 2 else yaw + math.pi if yaw <= -math.pi / 2 else yaw

    @property
    def tilt_rad(self) -> float:
        """Angle between the upper face and the horizontal [rad]."""
        return math.acos(min(1.0, float(self.world_from_top[2, 2])))


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxSearch:
    """Outcome of a search."""

    status: LocateStatus
    boxes: tuple[SeenBox, ...]
    """Unobstructed ones first, the highest first."""

    @property
    def best(self) -> SeenBox | None:
        """The highest box that nothing hides; None unless the status is FOUND."""
        return self.boxes[0] if self.status is LocateStatus.FOUND else None


def locate_boxes(
    camera: Camera, depth_m: npt.NDArray[np.floating], labels: npt.NDArray[np.integer], support_z_m: float
) -> BoxSearch:
    """Locate boxes.

    Args:
        camera: What the image was taken with.
        depth_m: Distance along the optical axis [m], not finite where nothing is seen, shape (height, width).
        labels: Body of every pixel, < 0 for what is no box, shape (height, width).
        support_z_m: Height of what the boxes stand on [m]; decides the heights of the boxes only.

    Returns:
        The boxes, or a status that says why there are none.

    Raises:
        SensorError: An array that is not of the camera's shape, or a support that is no number.
    """
    shape = (camera.height_px, camera.width_px)
    for what, array in (("depth_m", depth_m), ("labels", labels)):
        if array.shape != shape:
            raise SensorError(
                f"locate_boxes: {what} is of shape {array.shape}; valid: {shape}, as camera {camera.name}"
            )
    if not math.isfinite(support_z_m):
        raise SensorError(f"locate_boxes: support_z_m is {support_z_m}; valid: a finite height [m]")
    found = np.unique(labels[(labels >= 0) & np.isfinite(depth_m)]).tolist()
    if not found:
        return BoxSearch(status=LocateStatus.NOTHING_SEEN, boxes=())
    scan = _Scan(camera, np.asarray(depth_m, dtype=np.float64), np.asarray(labels, dtype=np.int64))
    boxes = [box for label in found if (box := scan.box(label, support_z_m)) is not None]
    if not boxes:
        return BoxSearch(status=LocateStatus.NO_FACE, boxes=())
    boxes.sort(key=lambda box: (box.obstructed, -float(box.world_from_top[2, 3])))
    status = LocateStatus.ALL_OBSTRUCTED if boxes[0].obstructed else LocateStatus.FOUND
    return BoxSearch(status=status, boxes=tuple(boxes))


@dataclass(frozen=True, eq=False)
class _Scan:
    """An image whose bodies are measured one by one."""

    camera: Camera
    depth: FloatArray
    labels: IntArray

    def box(self, label: int, support_z_m: float) -> SeenBox | None:
        """Measure one body; None if no face of it looks up and is large enough."""
        window = self._window(label)
        body = (self.labels[window] == label) & np.isfinite(self.depth[window])
        rays, points = self._points(window)
        plane = _upper_plane(points, body)
        if plane is None:
            return None
        centre, normal = plane
        face = body & (np.abs((points - centre) @ normal) < ON_PLANE_M)
        outline = face & ~_surrounded(face)
        # Where the rays of the outline meet the plane: free of what is left of noise across it.
        eye = self.camera.world_from_camera[:3, 3]
        edge = eye + rays[outline] * ((centre - eye) @ normal / (rays[outline] @ normal))[:, None]
        along = np.array([normal[2], 0.0, -normal[0]]) / math.hypot(normal[0], normal[2])
        basis = np.column_stack((along, np.cross(normal, along)))
        depth_m = float(np.median(self.depth[window][face]))
        rectangle = _rectangle((edge - centre) @ basis, depth_m / self.camera.focal_px)
        if rectangle is None:
            return None
        middle, direction, length, width = rectangle
        world_from_top = np.eye(4)
        world_from_top[:3, 0] = basis @ direction
        world_from_top[:3, 1] = np.cross(normal, world_from_top[:3, 0])
        world_from_top[:3, 2] = normal
        world_from_top[:3, 3] = centre + basis @ middle
        n_pixels = int(face.sum())
        # A pixel covers (z / f)^2 across the optical axis, more on a face that looks aside.
        slant = abs(float(rays[face].mean(axis=0) @ normal))
        seen_m2 = n_pixels * (depth_m / self.camera.focal_px) ** 2 / slant
        whole = seen_m2 >= WHOLE_SHARE * length * width
        return SeenBox(
            label=label,
            world_from_top=world_from_top,
            size_m=(length, width, max(0.0, float(world_from_top[2, 3]) - support_z_m)),
            obstructed=not whole or self._hidden_share(window, face, body) > HIDDEN_SHARE,
        )

    def _window(self, label: int) -> tuple[slice, slice]:
        """Rows and columns of a body and, inside the image, one pixel around it."""
        v, u = np.nonzero(self.labels == label)
        rows, cols = self.labels.shape
        return (
            slice(max(int(v.min()) - 1, 0), min(int(v.max()) + 2, rows)),
            slice(max(int(u.min()) - 1, 0), min(int(u.max()) + 2, cols)),
        )

    def _points(self, window: tuple[slice, slice]) -> tuple[FloatArray, FloatArray]:
        """Rays with a depth of 1 in the world frame, and the points seen, both (rows, columns, 3)."""
        centre_u, centre_v = self.camera.centre_px
        v, u = np.mgrid[window]
        local = np.stack((u - centre_u, v - centre_v, np.full(u.shape, self.camera.focal_px)), axis=-1)
        pose = self.camera.world_from_camera
        rays = (local / self.camera.focal_px) @ pose[:3, :3].T
        depth = np.where(np.isfinite(self.depth[window]), self.depth[window], np.nan)
        return rays, rays * depth[..., None] + pose[:3, 3]

    def _hidden_share(self, window: tuple[slice, slice], face: Mask, body: Mask) -> float:
        """Part of a face's outline at which something in front of it, or the edge of the image, cuts it off."""
        depth = np.where(np.isfinite(self.depth[window]), self.depth[window], np.inf)
        hidden, outline = 0, 0
        for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
            # Beyond the window there is nothing but the end of the image: a depth of zero is in front of everything.
            beyond = _shifted(depth, axis, step, 0.0)
            own = _shifted(body, axis, step, False)
            outline += int((face & ~_shifted(face, axis, step, False)).sum())
            hidden += int((face & ~own & (beyond < depth - IN_FRONT_M)).sum())
        return hidden / max(outline, 1)


def _shifted(image: npt.NDArray[Any], axis: int, step: int, fill: float | bool) -> npt.NDArray[Any]:
    """Every pixel's neighbour one step along an axis."""
    moved = np.roll(image, -step, axis=axis)
    edge = -1 if step > 0 else 0
    moved[(edge, slice(None)) if axis == 0 else (slice(None), edge)] = fill
    return moved


def _surrounded(face: Mask) -> Mask:
    """Pixels all four neighbours of which are in the mask."""
    inside = face.copy()
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        inside &= _shifted(face, axis, step, False)
    return inside


def _upper_plane(points: FloatArray, body: Mask) -> tuple[FloatArray, FloatArray] | None:
    """A point on, and the outward normal of, the face that looks up and has most of a body's points; None if none."""
    normals = np.zeros_like(points)
    across = np.full(body.shape, False)
    inner = (slice(1, -1), slice(1, -1))
    along_v, along_u = points[2:, 1:-1] - points[:-2, 1:-1], points[1:-1, 2:] - points[1:-1, :-2]
    normals[inner] = np.cross(along_v, along_u)
    across[inner] = _surrounded(body)[inner]
    length = np.linalg.norm(normals, axis=-1)
    across &= length > 0.0
    chosen = np.flatnonzero(across)
    cloud = points[body]
    if len(chosen) == 0 or len(cloud) < LEAST_PX:
        return None
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(N_SAMPLES, len(chosen))).round().astype(np.int64)]
    tried = normals.reshape(-1, 3)[chosen] / length.ravel()[chosen][:, None]
    # Which way round they came out depends on the camera: all are turned to look up.
    tried *= np.where(tried[:, 2:] < 0.0, -1.0, 1.0)
    offsets = np.einsum("ij,ij->i", points.reshape(-1, 3)[chosen], tried)
    votes = (np.abs(tried @ cloud.T - offsets[:, None]) < ON_PLANE_M).sum(axis=1)
    votes[tried[:, 2] < LEAST_UP] = 0
    best = int(np.argmax(votes))
    if votes[best] < max(LEAST_PX, LEAST_SHARE * len(cloud)):
        return None
    normal, offset = tried[best], offsets[best]
    for _ in range(2):
        near = cloud[np.abs(cloud @ normal - offset) < ON_PLANE_M]
        centre = near.mean(axis=0)
        _, axes = np.linalg.eigh((near - centre).T @ (near - centre))
        normal = axes[:, 0] if axes[2, 0] > 0 else -axes[:, 0]
        offset = centre @ normal
        if normal[2] < LEAST_UP:
            return None
    return centre, normal


def _rectangle(edge: FloatArray, pixel_m: float) -> tuple[FloatArray, FloatArray, float, float] | None:
    """Middle (2,), direction of the longer side (2,), longer and shorter side of the rectangle round an outline (k, 2).

    Pixels of an outline lie up to one pixel inside the true edge, half a pixel on average: the sides are moved out by
    that.
    """
    try:
        hull = edge[ConvexHull(edge).vertices]
    except (QhullError, ValueError):
        return None
    sides = np.roll(hull, -1, axis=0) - hull
    directions = sides / np.linalg.norm(sides, axis=1)[:, None]
    u, v = hull @ directions.T, hull @ np.column_stack((-directions[:, 1], directions[:, 0])).T
    best = int(np.argmin(np.ptp(u, axis=0) * np.ptp(v, axis=0)))
    direction = _refined(edge, directions[best], pixel_m)
    middle, extent = np.zeros(2), np.zeros(2)
    for k, axis in enumerate((direction, np.array([-direction[1], direction[0]]))):
        low, high = (_side(edge, axis, sign, pixel_m) for sign in (-1.0, 1.0))
        middle += axis * ((high - low) / 2)
        extent[k] = high + low
    if extent.min() <= 0.0:
        return None
    if extent[0] < extent[1]:
        direction, extent = np.array([-direction[1], direction[0]]), extent[::-1]
    return middle, direction, float(extent[0]), float(extent[1])


def _side(edge: FloatArray, axis: FloatArray, sign: float, pixel_m: float) -> float:
    """How far the true side lies along plus or minus an axis: half a pixel beyond the outline's mean there."""
    along, across = sign * (edge @ axis), edge @ np.array([-axis[1], axis[0]])
    return float(along[_on_side(along, across, pixel_m)].mean()) + pixel_m / 2


def _on_side(along: FloatArray, across: FloatArray, pixel_m: float) -> Mask:
    """Outline points of the side with the greatest `along`, without its corners."""
    low, high = across.min(), across.max()
    off = CORNER_SHARE * (high - low)
    near = along > along.max() - 1.5 * pixel_m
    middle = near & (across > low + off) & (across < high - off)
    return middle if middle.any() else near


def _refined(edge: FloatArray, direction: FloatArray, pixel_m: float) -> FloatArray:
    """The direction that fits all four sides best: least squares of the distances across them."""
    scatter = np.zeros((2, 2))
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    for k, axis in enumerate((direction, quarter @ direction)):
        for sign in (-1.0, 1.0):
            side = edge[_on_side(sign * (edge @ axis), edge @ (quarter @ axis), pixel_m)]
            off = side - side.mean(axis=0)
            # Sides that the direction leads to are turned by a right angle, so that all four count for the same one.
            off = off @ quarter if k == 0 else off
            scatter += off.T @ off
    _, axes = np.linalg.eigh(scatter)
    refined = axes[:, 1]
    return refined if refined @ direction > 0 else -refined
