"""Scenery: what a recording draws once, before the first frame."""

from __future__ import annotations

import numpy as np
import rerun as rr

from fleet.charts.chart import round_step
from fleet.recording.header import DrawnFloor
from fleet.recording.rerun_stream import palette
from fleet.recording.rerun_stream.poses import Part, at_height
from fleet.robots.spec import CarSpec
from fleet.world.scene import Scene

CAMERA = "world/top"
LABELS = "world/labels"
RULER = "world/ruler"
"""Numbers of rows along the left edge of the floor and of columns along its top, as messages name cells."""
_LABEL_Z = 0.6
"""Height of a station's name [m]; it stands behind the arm, so that a docked car's name has room."""
_CAMERA_Z = 400.0
"""So far up that the projection is nearly parallel [m]."""
_FEW_CARS = 8
"""More cars than this are labelled by number alone, so that neighbours stay legible."""
_RIM_M = 0.19
"""By how much the plates of few cars are larger than their bodies, all around: those of neighbours stay apart [m]."""
MANY_CARS = 30
"""Of more cars than this the names would hide the floor: they are shown where somebody points."""
PIXELS_PER_M = 24.0
"""Resolution of the top-down camera; labels have a fixed size in these pixels."""
_MOST_NUMBERS = 8
"""Numbers along an edge of the floor, at most about."""
_CHEVRON_M = 0.09
"""Half length and half width of a lane's direction mark [m]."""


def log_scenery(rec: rr.RecordingStream, scene: Scene, floor: DrawnFloor) -> None:
    """Log floor, boxes, lanes, parking, docks, station names and the top-down camera."""
    width, depth = scene.size_m
    rec.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rec.log(
        "world/floor/ground",
        rr.Boxes3D(
            centers=[(width / 2, depth / 2, -0.02)],
            half_sizes=[(width / 2, depth / 2, 0.01)],
            colors=_colours([palette.FLOOR]),
            fill_mode="solid",
        ),
        static=True,
    )
    for kind in sorted({box.kind for box in scene.boxes}):
        boxes = [box for box in scene.boxes if box.kind == kind]
        rec.log(
            f"world/boxes/{kind}",
            rr.Boxes3D(
                centers=[box.centre_m for box in boxes],
                half_sizes=[box.half_m for box in boxes],
                colors=_colours([palette.BOX_COLOURS.get(kind, palette.BOX_DEFAULT)] * len(boxes)),
                labels=[f"{kind}: {box.where}" if box.where else kind for box in boxes],
                show_labels=False,  # where somebody points; all at once would cover the cars
                fill_mode="solid",
            ),
            static=True,
        )
    _log_plates(rec, "world/floor/parking", floor.parking_xy, palette.PARKING, floor.cell_m)
    _log_plates(rec, "world/floor/docks", floor.dock_xy, palette.DOCK, floor.cell_m)
    if len(floor.lanes):
        rec.log(
            "world/floor/lanes",
            rr.LineStrips3D(_chevrons(floor.lanes), colors=_colours([palette.LANE]), radii=0.018),
            static=True,
        )
    _log_ruler(rec, floor.cell_xy)
    if floor.station_names:
        away = floor.station_xy - floor.dock_xy
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        # text is centred below its point and keeps its size in pixels: it needs least room south of an arm
        sideways, north = np.abs(away[:, 0]) > 0.5, away[:, 1] > 0.5
        reach = np.select([sideways, north], [1.0 + 0.05 * width, 0.9 + 0.075 * depth], max(0.9, 0.045 * depth))
        rec.log(
            LABELS,
            rr.Points3D(
                at_height(floor.station_xy + reach[:, None] * away, _LABEL_Z),
                labels=list(floor.station_names),
                colors=_colours([palette.LABEL]),
                radii=0.01,
                show_labels=True,
            ),
            static=True,
        )
    rec.log(
        CAMERA,
        rr.Transform3D(
            translation=(width / 2, depth / 2, _CAMERA_Z), quaternion=rr.Quaternion(xyzw=(1.0, 0.0, 0.0, 0.0))
        ),
        rr.Pinhole(
            resolution=(width * PIXELS_PER_M, depth * PIXELS_PER_M),
            focal_length=_CAMERA_Z * PIXELS_PER_M,
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=1.0,
        ),
        static=True,
    )


def log_part(rec: rr.RecordingStream, path: str, part: Part) -> None:
    """Log the mesh of a part; its instances come with the poses."""
    mesh = part.mesh
    rec.log(
        path,
        rr.Mesh3D(
            vertex_positions=mesh.positions,
            vertex_normals=mesh.normals,
            triangle_indices=mesh.triangles,
            vertex_colors=mesh.colours,
        ),
        static=True,
    )


def log_tags(rec: rr.RecordingStream, path: str, cars: list[int], n_cars: int, spec: CarSpec) -> None:
    """Log the coloured plates with the names of some of the cars that lie under the bodies and move with them."""
    length, width = plate_size_m(spec, n_cars)
    rec.log(
        path,
        rr.Boxes3D(
            centers=[((spec.front_m - spec.rear_m) / 2, 0.0, 0.012)] * len(cars),
            half_sizes=[(length / 2, width / 2, 0.004)] * len(cars),
            colors=palette.identity_colours(cars),
            labels=[f"car_{i}" if n_cars <= _FEW_CARS else str(i) for i in cars],
            show_labels=n_cars <= MANY_CARS,
            fill_mode="solid",
        ),
        static=True,
    )


def plate_size_m(spec: CarSpec, n_cars: int) -> tuple[float, float]:
    """Length and width of the plate of a car [m].

    Few cars are seen from afar, where a car is a few pixels wide: their plates show beyond their bodies.

    Args:
        spec: The car.
        n_cars: Of the run.
    """
    rim = _RIM_M if n_cars <= _FEW_CARS else 0.0
    return spec.front_m + spec.rear_m + 2 * rim, 2 * (spec.half_width_m + rim)


def _log_plates(rec: rr.RecordingStream, path: str, xy: np.ndarray, colour: int, cell_m: float) -> None:
    if not len(xy):
        return
    rec.log(
        path,
        rr.Boxes3D(
            centers=at_height(xy, -0.008),
            half_sizes=[(0.42 * cell_m, 0.42 * cell_m, 0.008)] * len(xy),
            colors=_colours([colour] * len(xy)),
            fill_mode="solid",
        ),
        static=True,
    )


def _log_ruler(rec: rr.RecordingStream, cell_xy: np.ndarray) -> None:
    """Number rows and columns at round numbers, in the outermost cells: beyond them stand names of stations."""
    if not len(cell_xy):
        return
    x, y = np.unique(cell_xy[:, 0]), np.unique(cell_xy[:, 1])[::-1]  # rows count from the top
    rows, columns = (range(0, n, max(1, int(round_step(n, _MOST_NUMBERS)))) for n in (len(y), len(x)))
    left = np.column_stack([np.full(len(rows), x[0]), y[rows]])
    top = np.column_stack([x[columns], np.full(len(columns), y[0])])
    rec.log(
        RULER,
        rr.Points3D(
            at_height(np.concatenate([left, top]), 0.0),
            labels=[str(number) for number in (*rows, *columns)],
            colors=_colours([palette.RULER]),
            radii=0.01,
            show_labels=True,
        ),
        static=True,
    )


def _chevrons(lanes: np.ndarray) -> np.ndarray:
    """A flat V in the middle of each lane that points along it, shape (k, 3, 3)."""
    along = lanes[:, 1] - lanes[:, 0]
    along = along * (_CHEVRON_M / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9))
    aside = np.column_stack([-along[:, 1], along[:, 0]])
    middle = lanes.mean(axis=1)
    points = np.stack([middle - along + aside, middle + along, middle - along - aside], axis=1)
    return np.concatenate([points, np.full((len(lanes), 3, 1), 0.005)], axis=2)


def _colours(packed: list[int]) -> np.ndarray:
    """An array, because rerun takes a list of integers for the components of one colour."""
    return np.array(packed, np.uint32)
