"""Window: how the engine's own window shows a world, if there is one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from fleet.config import Connect
from fleet.world.bullet.client import Client

# The window's lens opens 60 degrees from top to bottom and about 75 across: the longer side fits with some air.
_DISTANCE_PER_M = 0.6
_PITCH_DEG = -65.0


@contextmanager
def arranged(client: Client, size_m: tuple[float, float]) -> Iterator[None]:
    """Draw nothing while the block loads a world, then show all of its floor, for looking only.

    Dragging bodies with the mouse is off: a run must depend on nothing but its configuration.

    Args:
        client: Connection; with DIRECT there is no window and nothing happens.
        size_m: Extent of the floor along x and y [m].
    """
    if client.connect is Connect.DIRECT:
        yield
        return
    show = client.configureDebugVisualizer
    show(client.COV_ENABLE_RENDERING, 0)
    show(client.COV_ENABLE_GUI, 0)
    show(client.COV_ENABLE_MOUSE_PICKING, 0)
    yield
    x, y = size_m
    client.resetDebugVisualizerCamera(max(1.0, _DISTANCE_PER_M * max(x, y)), 0.0, _PITCH_DEG, (x / 2, y / 2, 0.0))
    show(client.COV_ENABLE_RENDERING, 1)
