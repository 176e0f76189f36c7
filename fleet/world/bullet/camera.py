"""Camera: renders what a camera sees with the engine's software renderer, which needs no display."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fleet.sensors.camera import Camera, CameraImage
from fleet.world.bullet.engine.client import Client

# OpenGL's camera frame has y up and z backwards.
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
# A pixel of the segmentation holds body + ((link + 1) << 24), -1 for none.
_BODY_BITS = 24


def render(client: Client, camera: Camera, parcel_of: Mapping[int, int]) -> CameraImage:
    """Take an image of the present state.

    Args:
        client: Connection.
        camera: What is looked with.
        parcel_of: Parcel id of every parcel's body.

    Returns:
        The image; its depth is exact to about 1e-6 of the depth squared over the near distance.
    """
    width, height = camera.width_px, camera.height_px
    view = _FLIP @ np.linalg.inv(camera.world_from_camera)
    _, _, rgba, buffer, mask = client.getCameraImage(
        width,
        height,
        viewMatrix=view.T.ravel().tolist(),
        projectionMatrix=_projection(camera).T.ravel().tolist(),
        shadow=0,
        renderer=client.ER_TINY_RENDERER,
        flags=client.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX,
    )
    codes = np.reshape(np.asarray(mask, dtype=np.int32), (height, width))
    seen = codes >= 0
    body = np.where(seen, codes & ((1 << _BODY_BITS) - 1), -1).astype(np.int32)
    # The buffer holds window depths d of OpenGL: z = far near / (far - (far - near) d).
    window = np.reshape(np.asarray(buffer, dtype=np.float64), (height, width))
    near, far = camera.near_m, camera.far_m
    depth = np.where(seen, far * near / (far - (far - near) * window), np.inf)
    parcel = np.full((height, width), -1, dtype=np.int32)
    for found in np.unique(body).tolist():
        if found in parcel_of:
            parcel[body == found] = parcel_of[found]
    return CameraImage(
        camera=camera,
        rgb=np.reshape(np.asarray(rgba, dtype=np.uint8), (height, width, 4))[..., :3].copy(),
        depth_m=depth.astype(np.float32),
        body=body,
        link=np.where(seen, (codes >> _BODY_BITS) - 1, -1).astype(np.int32),
        parcel=parcel,
    )


def _projection(camera: Camera) -> np.ndarray:
    """OpenGL's projection matrix, shape (4, 4).

    The renderer samples a pixel at its lower left corner instead of its centre (measured on the edges of boxes): the
    third column shifts the image by half a pixel along both axes, so that the intrinsics of `Camera` hold.
    """
    near, far, focal = camera.near_m, camera.far_m, camera.focal_px
    width, height = camera.width_px, camera.height_px
    return np.array(
        [
            [2.0 * focal / width, 0.0, 1.0 / width, 0.0],
            [0.0, 2.0 * focal / height, 1.0 / height, 0.0],
            [0.0, 0.0, -(far + near) / (far - near), -2.0 * far * near / (far - near)],
            [0.0, 0.0, -1.0, 0.0],
        ]
    )
