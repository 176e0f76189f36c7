"""Portrait: a picture of one robot on a bare floor, by the software renderer."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fleet.sensors.camera import Camera
from fleet.world.bullet.camera import render
from fleet.world.bullet.engine.client import Client

WIDTH_PX, HEIGHT_PX = 800, 600
_FOV_RAD = math.radians(30.0)
_ROOM = 1.25
"""The robot's sphere takes up the image's height but for this."""
_FROM = np.array([0.74, -0.55, 0.39])
"""Direction from which the camera looks: from ahead, the right and above."""
_BACKDROP = np.array([235, 238, 241], dtype=np.uint8)


def portrait(client: Client, body: int) -> npt.NDArray[np.uint8]:
    """Paint a body from ahead, so far away that it fills the image.

    Args:
        client: Connection.
        body: The robot.

    Returns:
        Colours, shape (HEIGHT_PX, WIDTH_PX, 3).
    """
    boxes = np.array([client.getAABB(body, link) for link in range(-1, client.getNumJoints(body))])
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    away = _ROOM * radius / math.sin(_FOV_RAD / 2)
    camera = Camera.looking_at(
        "portrait",
        eye_m=middle + away * _FROM / np.linalg.norm(_FROM),
        target_m=middle,
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        fov_rad=_FOV_RAD,
        near_m=0.05,
        far_m=away + 60.0,
    )
    image = render(client, camera, {})
    rgb: npt.NDArray[np.uint8] = image.rgb
    rgb[image.body < 0] = _BACKDROP
    return rgb
