"""Touch: contact forces and nearest points between bodies, as arrays with units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.world.bullet.engine.client import Client


@dataclass(frozen=True, kw_only=True, eq=False)
class TouchPoints:
    """Pairs of points on a body and on others, one row each."""

    other: IntArray
    """The other body, shape (k,)."""
    link: IntArray
    """Link of the body, -1 for its base, shape (k,)."""
    other_link: IntArray
    """Link of the other body, shape (k,)."""
    position_m: FloatArray
    """Point on the body, world frame, shape (k, 3)."""
    other_position_m: FloatArray
    """Point on the other body, world frame, shape (k, 3)."""
    normal: FloatArray
    """Unit vector from the other body towards the body, world frame, shape (k, 3)."""
    distance_m: FloatArray
    """Distance along the normal, negative for a penetration, shape (k,)."""
    force_n: FloatArray
    """Force on the body in the last physics step, normal part and friction, world frame, shape (k, 3); zero for points
    that were only asked for."""

    def __len__(self) -> int:
        return len(self.distance_m)


def contacts(client: Client, body: int, other: int | None = None) -> TouchPoints:
    """What a body touched in the last physics step, and with what force.

    Args:
        client: Connection.
        body: The body.
        other: Only touches with this one; None for all. A body never counts as touching itself.

    Returns:
        Contact points; the sum of `force_n` is the whole force on the body.
    """
    rows = client.getContactPoints(body) if other is None else client.getContactPoints(body, other)
    # The engine lists the asked body first.
    return _points([row for row in rows if row[2] != body])


def nearest(client: Client, body: int, other: int, within_m: float = 0.1, link: int | None = None) -> TouchPoints:
    """Nearest points of a body to another one, wherever both are now.

    The engine looks at pairs of bounding boxes first, so distances far apart cost next to nothing. Convex hulls stand
    for meshes.

    Args:
        client: Connection.
        body: The body.
        other: The other body.
        within_m: Pairs of links that are farther apart are left out [m].
        link: Only this link of the body, -1 for its base; None for all.

    Returns:
        One row for each pair of links within the distance, nearest first.
    """
    only = {} if link is None else {"linkIndexA": link}
    rows = client.getClosestPoints(body, other, within_m, **only)
    best: dict[tuple[int, int], Any] = {}
    for row in rows:
        key = (row[3], row[4])
        if key not in best or row[8] < best[key][8]:
            best[key] = row
    return _points(sorted(best.values(), key=lambda row: (row[8], row[3], row[4])))


def _points(rows: list[Any]) -> TouchPoints:
    def vectors(column: int) -> FloatArray:
        return np.array([row[column] for row in rows], dtype=np.float64).reshape(-1, 3)

    def numbers(column: int) -> FloatArray:
        return np.array([row[column] for row in rows], dtype=np.float64)

    normal = vectors(7)
    force = (
        numbers(9)[:, None] * normal + numbers(10)[:, None] * vectors(11) + numbers(12)[:, None] * vectors(13)
        if rows
        else np.empty((0, 3))
    )
    return TouchPoints(
        other=numbers(2).astype(np.int64),
        link=numbers(3).astype(np.int64),
        other_link=numbers(4).astype(np.int64),
        position_m=vectors(5),
        other_position_m=vectors(6),
        normal=normal,
        distance_m=numbers(8),
        force_n=force,
    )
