"""Views: what cameras saw, as compressed colours and depths behind their pinholes."""

from __future__ import annotations

import io

import numpy as np
import rerun as rr
from PIL import Image as Picture

from fleet.sensors.camera import Camera, CameraImage

VIEWS = "world/cameras"
"""Parent of one entity for each camera."""
_JPEG_QUALITY = 85
_DEPTH_STEPS = 65_535
"""Depths are stored as 16-bit integers up to the camera's far distance; 0 stands for nothing seen."""
_FRUSTUM_M = 0.25
"""Size in which a camera is drawn [m]."""


def log_camera(rec: rr.RecordingStream, path: str, camera: Camera) -> None:
    """Log where a camera is and how it projects; once, as station cameras do not move."""
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
        static=True,
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
