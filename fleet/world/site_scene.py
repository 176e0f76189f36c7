"""Scene of a site: floor map and stations become boxes and robot poses."""

from __future__ import annotations

import math

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.config import ArmConfig, Grip
from fleet.errors import ConfigError
from fleet.robots import ARMS, TOOLS, ArmSpec, ArmTeam
from fleet.robots.cars.models import CarModels, usual_car
from fleet.robots.spec import CarSpec
from fleet.world.scene import Scene, StaticBox
from maps.grid import GridMap
from maps.site import Site
from maps.stations import StationPlace

WALL_HEIGHT_M = 0.6
"""Low, so that a viewer looks over the walls; higher than a loaded car."""
SHELF_HEIGHT_M = 1.2
PEDESTAL_HALF_M = 0.08
SHELF_GAP_M = 0.03
"""Kept free around a shelf inside its cells [m]."""
STAND_GAP_M = 0.002
"""Kept free between a stand and the foot of the arm on it [m]."""
USUAL_TRAY_M = 0.18
"""Height of the tray's floor that arms on the floor are made for: for higher trays all arms stand higher [m]."""
_TOLERANCE_M = 1e-6


def scene_of(
    site: Site,
    car_start: FloatArray,
    grip: Grip,
    arms: ArmConfig | None = None,
    cars: CarModels | None = None,
) -> Scene:
    """Build the scene of a site.

    Args:
        site: The site.
        car_start: Rear-axle poses, shape (n_cars, 3).
        grip: Decides the arms' tool.
        arms: Names the arm of stations whose site names none, and may set other speed limits than the real arm's.
        cars: Models of the cars; None = the usual one.

    Returns:
        Walls and shelves merged into as few boxes as rectangles allow, a pedestal for every slot, robots at their
        starts, arms at home, on stands where they need them.

    Raises:
        ConfigError: A station's arm has a name that is none, or cannot reach a slot or the tray of a docked car of one
            of the models.
    """
    boxes = [
        *_merged_boxes(site.grid, site.walls, "wall", WALL_HEIGHT_M, 0.0),
        *_merged_boxes(site.grid, site.shelves, "shelf", SHELF_HEIGHT_M, SHELF_GAP_M),
    ]
    for station in site.stations:
        for x, y, z in station.slots:
            half = (PEDESTAL_HALF_M, PEDESTAL_HALF_M, z / 2)
            boxes.append(StaticBox(kind="pedestal", centre_m=(float(x), float(y), z / 2), half_m=half))
    team = arms_of(site, grip, arms or ArmConfig())
    base = np.array([station.arm.pose for station in site.stations], dtype=np.float64).reshape(-1, 4)
    kinds = cars.kinds if cars else (usual_car(),)
    served = tuple(kind for kind in kinds if kind.lifts is None)
    _check_trays(site, team, served)
    raised_m = max(0.0, 0.0, *(kind.tray_floor_z_m - USUAL_TRAY_M for kind in served))
    for spec, pose in zip(team.specs, base, strict=True):
        stand_m = spec.stand_m + raised_m
        if stand_m > 0.0:
            half_z = (stand_m - STAND_GAP_M) / 2
            x, y = pose[:2].tolist()
            foot = spec.outline.foot_m
            boxes.append(StaticBox(kind="stand", centre_m=(x, y, half_z), half_m=(foot, foot, half_z)))
            pose[2] += stand_m
    return Scene(
        size_m=(site.grid.cols * site.grid.cell_m, site.grid.rows * site.grid.cell_m),
        boxes=tuple(boxes),
        car_kinds=kinds,
        car_start=car_start,
        car_kind_of=cars.kind_of if cars else None,
        arms=team,
        arm_base=base,
        arm_start=team.home_rad.copy(),
        pod_start=pod_starts(site),
    )


def arms_of(site: Site, grip: Grip, arms: ArmConfig) -> ArmTeam:
    """The arms of a site's stations.

    Args:
        site: May name an arm for each station.
        grip: Decides their tool.
        arms: Names the arm of all other stations, and may set other speed limits.

    Raises:
        ConfigError: See `scene_of`.
    """
    models: dict[str, ArmSpec] = {}
    specs = []
    for station in site.stations:
        name = station.arm.model or arms.model
        if name not in models:
            where = "--arms" if station.arm.model is None else f"site {site.name}: stations.{station.name}.arm"
            models[name] = (
                ARMS.named(name, where).spec(TOOLS[grip]).with_limits(arms.velocity_radps, arms.acceleration_radps2)
            )
        _check_reach(site, station, models[name])
        specs.append(models[name])
    return ArmTeam.of(specs)


def pod_starts(site: Site) -> FloatArray:
    """Where pods stand that nobody has moved: x, y [m] and yaw [rad] of a car that comes to them, shape (n, 3)."""
    lane_into = {end: start for start, end in site.lanes.tolist()}
    xy = site.grid.cell_xy(list(site.storage)).reshape(-1, 2)
    along = xy - site.grid.cell_xy([lane_into[cell] for cell in site.storage]).reshape(-1, 2)
    return np.column_stack((xy, np.arctan2(along[:, 1], along[:, 0])))


def dock_pose(site: Site, station: StationPlace, car: CarSpec) -> tuple[float, float, float]:
    """Where a car stops to be served: x, y [m], yaw [rad]; one that turns on the spot, in the middle of the cell."""
    x, y, yaw = station.dock.pose
    if car.footprint.pivots:
        x, y = site.grid.xy(*site.grid.row_col(station.dock.cell))
    return x, y, yaw


def _check_trays(site: Site, team: ArmTeam, kinds: tuple[CarSpec, ...]) -> None:
    """The trays of models that dock at places of their own lie where arms serve them from above."""
    for kind in kinds:
        if not kind.footprint.pivots:
            continue
        for station, arm in zip(site.stations, team.specs, strict=True):
            x, y, yaw = dock_pose(site, station, kind)
            tray = x + kind.tray_x_m * math.cos(yaw), y + kind.tray_x_m * math.sin(yaw)
            least, most = arm.reach_m
            away = math.dist(tray, station.arm.pose[:2])
            if not least - _TOLERANCE_M <= away <= most + _TOLERANCE_M:
                raise ConfigError(
                    f"site {site.name}: {station.name}: arm {arm.name!r} does not reach the tray of a {kind.name} in "
                    f"the middle of the dock, {away:.2f} m from its base; valid: {least} to {most} m"
                )


def _check_reach(site: Site, station: StationPlace, arm: ArmSpec) -> None:
    """Slots and the tray of a docked car lie where an arm serves them from above."""
    base = np.array(station.arm.pose[:2])
    points = {"the tray of a docked car": station.dock.tray_xy}
    points |= {f"slot {number}": (slot[0], slot[1]) for number, slot in enumerate(station.slots, start=1)}
    least, most = arm.reach_m
    for what, point in points.items():
        away = float(np.hypot(*(np.array(point) - base)))
        if not least - _TOLERANCE_M <= away <= most + _TOLERANCE_M:
            raise ConfigError(
                f"site {site.name}: {station.name}: arm {arm.name!r} does not reach {what} at ({point[0]:.2f}, "
                f"{point[1]:.2f}) m, {away:.2f} m from its base; valid: {least} to {most} m"
            )


def _merged_boxes(grid: GridMap, mask: BoolArray, kind: str, height_m: float, gap_m: float) -> list[StaticBox]:
    """Cover the marked cells with disjoint rectangles, each grown to the right, then down."""
    left = mask.copy()
    boxes = []
    for row, col in np.argwhere(mask):
        if not left[row, col]:
            continue
        end_col = col
        while end_col + 1 < grid.cols and left[row, end_col + 1]:
            end_col += 1
        end_row = row
        while end_row + 1 < grid.rows and left[end_row + 1, col : end_col + 1].all():
            end_row += 1
        left[row : end_row + 1, col : end_col + 1] = False
        x0, y0 = grid.xy(int(row), int(col))
        x1, y1 = grid.xy(int(end_row), int(end_col))
        half_x = (x1 - x0 + grid.cell_m) / 2 - gap_m
        half_y = (y0 - y1 + grid.cell_m) / 2 - gap_m
        centre = ((x0 + x1) / 2, (y0 + y1) / 2, height_m / 2)
        where = f"{_span('row', row, end_row)}, {_span('column', col, end_col)}"
        boxes.append(StaticBox(kind=kind, centre_m=centre, half_m=(half_x, half_y, height_m / 2), where=where))
    return boxes


def _span(word: str, first: int, last: int) -> str:
    return f"{word} {first}" if first == last else f"{word}s {first} to {last}"
