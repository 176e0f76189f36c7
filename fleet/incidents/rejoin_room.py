"""RejoinRoom: where a car may be while it manoeuvres back onto its lane."""

from __future__ import annotations

from copy import copy

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.run.view import RunView
from maps.vehicle import Footprint

SEARCH_M = 2.2
"""How far from the car a state to rejoin may be."""
MARGIN_M, LEAST_MARGIN_M = 0.05, 0.02
"""Kept free around the body in a manoeuvre: the error of the follower and of the estimate; the second where there is no
way with the first."""
WAY_OUT_M = 0.6
"""A car that stands too near something must have left it this far from where it stands, or after twice the depth."""
TOUCHES_M, SLACK_M, LEAST_SLACK_M = 0.01, 0.002, 0.0005
"""How much nearer than it stands a car may come to something on its way out, from rounding and between the poses that
are looked at: the first beyond which it touches it perhaps has the least."""
FOOT_M = 0.015
"""How much farther the foot of an arm reaches than its outline's circle, in the direction of its corners."""
LEAVES = 0.1
"""How far a way that leaves what the car touches leads away from it, by what is driven, until it touches no more."""
SWING_M = 0.005
"""How much nearer its tail may come where it cannot get out otherwise. A car turns away from a wall beside it with its
tail towards the wall, by the square of what is behind the rear axle over twice the radius: 4 mm in a curve of 1 m."""


class RejoinRoom:
    """Where a car may be while it manoeuvres.

    The body, of a car that lifts pods with one, stays in usable cells and in those it stands in, and `MARGIN_M` from
    walls, obstacles, arms' feet and other cars. What it stands nearer to than that, or inside, it must get away from:
    over the first half of `WAY_OUT_M` it may be as near to that as it stands, and then what it may be too near falls to
    nothing. To all else it keeps the margin.

    Args:
        run: Site, cars, obstacles.
        car: The car.
        start: Where it stands, x, y, yaw.
        usable: Cells nobody else holds, shape (rows, cols).
        margin_m: Kept free around the body [m].
    """

    def __init__(
        self,
        run: RunView,
        car: int,
        start: FloatArray,
        usable: npt.NDArray[np.bool_],
        margin_m: float = MARGIN_M,
    ) -> None:
        self._margin_m, self._way_out_m, self._swing_m = margin_m, WAY_OUT_M, 0.0
        self._leaves = 0.0
        grid = run.site.grid
        models = run.scene.cars
        self._shape, self._cell_m, self._rows = models[car].footprint, grid.cell_m, grid.rows
        open_cells = grid.free & ~run.traffic.blocked.reshape(grid.rows, grid.cols)
        # One more cell all around, so that neighbours need no special case.
        self._open = np.pad(open_cells, 1)
        self.start = start
        body = outline(start[None], self._shape, 0.0)[0]
        row, col = cell_of(body, grid.rows, grid.cell_m)
        self.usable = usable
        allowed = np.pad(usable, 1)
        allowed[np.clip(row + 1, 0, grid.rows + 1), np.clip(col + 1, 0, grid.cols + 1)] = True
        self._allowed = allowed
        self.ground = frozenset((row * grid.cols + col).tolist())
        feet = run.scene.arm_base[:, :2]
        near = np.hypot(*(feet - start[:2]).T) < 2 * SEARCH_M
        self._feet = feet[near]
        self._foot_m = run.scene.arms.foot_m[near] + FOOT_M
        corners = _corners(self._open, self._cell_m)
        self._corners = corners[np.hypot(*(corners - start[:2]).T) < 2 * SEARCH_M]
        poses = run.driver.estimate
        near = np.flatnonzero(np.hypot(*(poses - start)[:, :2].T) < 2 * SEARCH_M)
        self._bodies = [(poses[other], models[other].footprint) for other in near[near != car].tolist()]
        self._depths = self._too_near(start[None])
        touches = self._depths > margin_m - TOUCHES_M
        # Points that touch walls may do so all alike; the others may come near to them, but not touch them.
        walls = slice(len(body))
        deepest = self._depths[0, walls].max()
        borne = np.where(touches[0, walls], deepest, min(deepest, margin_m - TOUCHES_M))
        self._depths[0, walls] = np.maximum(self._depths[0, walls], borne)
        self.touches = bool(touches.any())
        """Whether the car touches something where it stands, as far as can be told."""
        self._touching = touches
        self._slack_m = np.where(touches, LEAST_SLACK_M, SLACK_M)

    def eased(self, *, lead_m: float = 0.0, swing_m: float = 0.0) -> RejoinRoom:
        """Give the same room with an easier way out of what the car stands too near.

        Args:
            lead_m: How much farther it may go before it must have left that [m].
            swing_m: How much nearer to that than where it stands it may be on its way out [m].
        """
        room = copy(self)
        room._way_out_m, room._swing_m = WAY_OUT_M + lead_m, swing_m
        return room

    def leaving(self) -> RejoinRoom:
        """Give the same room for ways that lead off what the car touches from the first centimetre on."""
        room = copy(self)
        room._leaves = LEAVES
        return room

    def valid(self, poses: FloatArray) -> npt.NDArray[np.bool_]:
        """Which of the poses (k, 3) the car may take, shape (k,)."""
        row, col = self._cells(outline(poses, self._shape, 0.0))
        held_by_nobody = (self._allowed | ~self._open)[row, col].all(axis=1)
        away = np.hypot(poses[:, 0] - self.start[0], poses[:, 1] - self.start[1])
        way_out_m = np.maximum(self._way_out_m, 2.0 * self._depths)
        share = np.clip(2.0 * (1.0 - away[:, None] / way_out_m), 0.0, 1.0)
        bearable = (self._depths + self._swing_m) * share + self._slack_m
        bearable -= np.where(self._touching, np.minimum(self._leaves * away[:, None], TOUCHES_M), 0.0)
        return held_by_nobody & (self._too_near(poses) <= bearable).all(axis=1)

    def _cells(self, points: FloatArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        row, col = cell_of(points, self._rows, self._cell_m)
        height, width = self._open.shape
        return np.clip(row + 1, 0, height - 1), np.clip(col + 1, 0, width - 1)

    def _too_near(self, poses: FloatArray) -> FloatArray:
        """How far the body and its margin reach into walls, each arm's foot and each car nearby [m], shape (k, n).

        For walls, each point of the outline counts for itself: a car whose nose stands at a wall must not come to it
        with its tail.
        """
        points = outline(poses, self._shape, self._margin_m)
        edges = _depth_in_body(self._corners[None], poses[:, None], self._shape, self._margin_m).max(
            axis=1, initial=0.0
        )
        # Cells beside an arm are kept clear: who was pushed there may go through them, round the foot.
        feet = [
            self._margin_m + foot_m - _apart(poses, foot, self._shape)
            for foot, foot_m in zip(self._feet, self._foot_m, strict=True)
        ]
        depths = [*self._into_walls(points).T, edges, *(np.maximum(foot, 0.0) for foot in feet)]
        for body, shape in self._bodies:
            inside = _depth_in_body(points, body[None, None], shape)
            corners = outline(body[None], shape, self._margin_m)
            depths.append(
                np.maximum(inside.max(axis=1), _depth_in_body(corners, poses[:, None], self._shape).max(axis=1))
            )
        return np.stack(depths, axis=1)

    def _into_walls(self, points: FloatArray) -> FloatArray:
        """Distance of each point from the nearest open cell [m]; at most a cell, shape (k, m)."""
        row, col = self._cells(points)
        centre_x = (col - 0.5) * self._cell_m
        centre_y = (self._rows - row + 0.5) * self._cell_m
        height, width = self._open.shape
        nearest = np.full(row.shape, self._cell_m)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                is_open = self._open[np.clip(row + down, 0, height - 1), np.clip(col + right, 0, width - 1)]
                dx = np.abs(points[..., 0] - centre_x - right * self._cell_m) - self._cell_m / 2
                dy = np.abs(points[..., 1] - centre_y + down * self._cell_m) - self._cell_m / 2
                gap = np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0))
                nearest = np.where(is_open, np.minimum(nearest, gap), nearest)
        return nearest


def outline(poses: FloatArray, car: Footprint, margin_m: float) -> FloatArray:
    """Points around the body and a margin at each pose, at most 0.15 m apart along its sides, shape (k, 12, 2)."""
    along = np.linspace(-car.rear_m - margin_m, car.front_m + margin_m, 5)
    side = car.half_width_m + margin_m
    ahead = np.concatenate([along, along, along[[0, -1]]])
    left = np.concatenate([np.full(5, side), np.full(5, -side), np.zeros(2)])
    cos, sin = np.cos(poses[:, 2:3]), np.sin(poses[:, 2:3])
    return np.stack([poses[:, 0:1] + cos * ahead - sin * left, poses[:, 1:2] + sin * ahead + cos * left], axis=-1)


def _corners(is_open: npt.NDArray[np.bool_], cell_m: float) -> FloatArray:
    """Corners of walls that point into open cells, x, y, shape (n, 2); the cells have one more all around."""
    closed = np.pad(~is_open, 1, constant_values=True)
    a, b, c, d = closed[:-1, :-1], closed[:-1, 1:], closed[1:, :-1], closed[1:, 1:]
    n_closed = a.astype(np.int64) + b + c + d
    row, col = np.nonzero((n_closed == 1) | ((n_closed == 2) & (a == d)))
    return np.stack([col - 1.0, len(is_open) - 1.0 - row], axis=-1) * cell_m


def _depth_in_body(points: FloatArray, poses: FloatArray, car: Footprint, margin_m: float = 0.0) -> FloatArray:
    """How far points (k or 1, m, 2) are inside bodies and a margin at poses (k or 1, 1, 3) [m], shape (k, m)."""
    middle = (car.front_m - car.rear_m) / 2
    dx, dy = points[..., 0] - poses[..., 0], points[..., 1] - poses[..., 1]
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    ahead = margin_m + (car.front_m + car.rear_m) / 2 - np.abs(cos * dx + sin * dy - middle)
    left = margin_m + car.half_width_m - np.abs(cos * dy - sin * dx)
    return np.maximum(np.minimum(ahead, left), 0.0)


def _apart(poses: FloatArray, point: FloatArray, car: Footprint) -> FloatArray:
    """Distance of a point x, y from the body at each pose (k, 3) [m]; 0 inside, shape (k,)."""
    dx, dy = point[0] - poses[:, 0], point[1] - poses[:, 1]
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    ahead, left = cos * dx + sin * dy, np.abs(cos * dy - sin * dx)
    beyond = np.maximum(np.maximum(ahead - car.front_m, -car.rear_m - ahead), 0.0)
    return np.hypot(beyond, np.maximum(left - car.half_width_m, 0.0))


def cell_of(points: FloatArray, rows: int, cell_m: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Row and column of points (..., 2); outside the map they are out of range."""
    col = np.floor(points[..., 0] / cell_m).astype(np.int64)
    return rows - 1 - np.floor(points[..., 1] / cell_m).astype(np.int64), col
