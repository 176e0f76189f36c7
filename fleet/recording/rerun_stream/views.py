"""Views: what cameras saw, as compressed colours and depths behind their pinholes; and an eye on the arm at work."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np
import rerun as rr
from PIL import Image as Picture

from fleet.arrays import FloatArray
from fleet.recording.frame import Frame
from fleet.recording.index import set_time
from fleet.sensors.camera import Camera, CameraImage
from fleet.world.scene import Scene

VIEWS = "world/cameras"
"""Parent of one entity for each camera."""
_JPEG_QUALITY = 85
_DEPTH_STEPS = 65_535
"""Depths are stored as 16-bit integers up to the camera's far distance; 0 stands for nothing seen."""
_FRUSTUM_M = 0.25
"""Size in which a camera is drawn [m]."""
EYE = "world/eye"
"""A camera before the arm at work, which a view looks through."""
_RESTS = ("idle", "awaiting", "fault")
"""What an arm does that is not at work."""


def close_up(base: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eye across the lane from an arm, and a target between arm and tray [m].

    Args:
        base: x, y, z and yaw of the arm.
    """
    x, y, z, yaw = base
    cos, sin = math.cos(yaw), math.sin(yaw)

    def at(ahead: float, aside: float, height: float) -> FloatArray:
        return np.array([x + cos * ahead - sin * aside, y + sin * ahead + cos * aside, z + height])

    return at(2.1, 1.3, 1.55), at(0.25, 0.0, 0.4)


class EyeAtWork:
    """Moves the eye before an arm that works: it stays there until the arm is idle and another one is not.

    Args:
        rec: The open recording.
        scene: Gives the arms.
    """

    def __init__(self, rec: rr.RecordingStream, scene: Scene) -> None:
        self._rec = rec
        ends = [close_up(base) for base in scene.arm_base]
        self._cameras = [Camera.looking_at("eye", eye_m=eye, target_m=target) for eye, target in ends]
        self._words: tuple[str, ...] | None = None
        self._arm = 0

    def write(self, frames: Sequence[Frame]) -> None:
        """Go where arms work in some frames."""
        for frame in frames if self._cameras else ():
            words = frame.arm_state
            if words is self._words:
                continue
            begins, self._words = self._words is None, words
            works = [arm for arm, word in enumerate(words) if word not in _RESTS]
            if begins or (works and self._arm not in works):
                self._arm = works[0] if works else self._arm
                set_time(self._rec, frame)
                _log_camera(self._rec, EYE, self._cameras[self._arm], static=False)


def log_camera(rec: rr.RecordingStream, path: str, camera: Camera) -> None:
    """Log where a camera is and how it projects; once, as station cameras do not move."""
    _log_camera(rec, path, camera, static=True)


def _log_camera(rec: rr.RecordingStream, path: str, camera: Camera, *, static: bool) -> None:
    pose = camera.world_from_camera
    rec.log(
        path,
        rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]),
        rr.Pinhole(
            # The viewer counts from the corner of the first pixel, `Camera` from its centre.
            image_from_camera=camera.matrix + np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]]),
            resolution=(camera.width_px, camera.height_px),
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=_FRUSTUM_M,
        ),
        static=static,
    )


def log_image(rec: rr.RecordingStream, path: str, image: CameraImage) -> None:
    """Log colours as JPEG and depths as 16-bit PNG at the present time of the stream."""
    per_m = _DEPTH_STEPS / image.camera.far_m
    depth = np.where(np.isfinite(image.depth_m), np.rint(image.depth_m * per_m), 0).astype(np.uint16)
    rec.log(
        f"{path}/rgb",
        rr.EncodedImage(contents=_encoded(image.rgb, "JPEG", quality=_JPEG_QUALITY), media_type="image/jpeg"),
    )
    # A low level is three times as quick, and the file hardly larger.
    rec.log(
        f"{path}/depth",
        rr.EncodedDepthImage(blob=_encoded(depth, "PNG", compress_level=3), media_type="image/png", meter=per_m),
    )


def _encoded(pixels: np.ndarray, kind: str, **options: int) -> bytes:
    buffer = io.BytesIO()
    Picture.fromarray(pixels).save(buffer, kind, **options)
    return buffer.getvalue()
