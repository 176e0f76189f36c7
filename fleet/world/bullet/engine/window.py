"""Window: the engine's own window, if there is one: how it shows a world, and what is drawn and asked in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from fleet.arrays import FloatArray
from fleet.config import Connect
from fleet.world.bullet.engine.client import Client

# The window's lens opens 60 degrees from top to bottom and about 75 across: the longer side fits with some air.
_DISTANCE_PER_M = 0.6
_PITCH_DEG = -65.0
# Panels cover 250 px of each side of the window, and 120 px below.
_BESIDE = 1.2
_BELOW_SHARE = 0.06
_TEXT_SIZE = 1.2
_TEXT_RGB = (0.05, 0.05, 0.05)


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


class Window:
    """Names, dotted lines and sliders over a world; every call waits for the window to draw a frame.

    Nothing here has a mass or a shape: the world goes on as it would without.

    Args:
        client: A connection with a window.
        cars: The engine's ids of the cars.
    """

    def __init__(self, client: Client, cars: Sequence[int]) -> None:
        self._client = client
        self._cars = tuple(cars)
        self._dots: dict[str, int] = {}

    @contextmanager
    def held(self) -> Iterator[None]:
        """Draw nothing while the block adds many things, which is several times faster."""
        show = self._client.configureDebugVisualizer
        show(self._client.COV_ENABLE_RENDERING, 0)
        yield
        show(self._client.COV_ENABLE_RENDERING, 1)

    def name_cars(self, names: Sequence[str], height_m: float) -> None:
        """Write a name over each car, which goes with it."""
        for body, name in zip(self._cars, names, strict=True):
            self._write(name, (0.0, 0.0, height_m), parentObjectUniqueId=body)

    def name_places(self, names: Sequence[str], points: FloatArray) -> None:
        """Write names at points x, y, z [m], shape (k, 3)."""
        for name, point in zip(names, points.tolist(), strict=True):
            self._write(name, tuple(point))

    def dots(self, key: str, points: FloatArray, rgb: FloatArray, size: float) -> None:
        """Draw dots in place of those of the same key.

        Args:
            key: What they are, one word.
            points: x, y, z [m], shape (k, 3); none takes them away.
            rgb: Colours 0 to 1, shape (k, 3).
            size: Of a dot [px].
        """
        client, old = self._client, self._dots.pop(key, -1)
        if not len(points):
            if old >= 0:
                client.removeUserDebugItem(old)
            return
        replace = {} if old < 0 else {"replaceItemUniqueId": old}
        self._dots[key] = client.addUserDebugPoints(points.tolist(), rgb.tolist(), size, **replace)

    def frame(self, size_m: tuple[float, float]) -> None:
        """Show all of a floor of an extent along x and y [m] in the part of the window that panels leave."""
        x, y = size_m
        target = (x / 2, (0.5 - _BELOW_SHARE) * y, 0.0)
        self._client.resetDebugVisualizerCamera(
            max(1.0, _BESIDE * _DISTANCE_PER_M * max(x, y)), 0.0, _PITCH_DEG, target
        )

    def slider(self, name: str, low: float, high: float, start: float) -> int:
        """Add a slider to the panel on the right; returns its number."""
        client = self._client
        for view in ("RGB", "DEPTH"):
            client.configureDebugVisualizer(getattr(client, f"COV_ENABLE_{view}_BUFFER_PREVIEW"), 0)
        client.configureDebugVisualizer(client.COV_ENABLE_SEGMENTATION_MARK_PREVIEW, 0)
        client.configureDebugVisualizer(client.COV_ENABLE_GUI, 1)
        return int(client.addUserDebugParameter(name, low, high, start))

    def value(self, slider: int) -> float:
        """Where a slider stands."""
        return float(self._client.readUserDebugParameter(slider))

    def _write(self, text: str, point: tuple[float, ...], **options: int) -> None:
        self._client.addUserDebugText(text, point, _TEXT_RGB, _TEXT_SIZE, **options)
