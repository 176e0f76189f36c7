"""Stations: where the car stops at a dock, where the arm stands beside it and where the parcel slots are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from maps.errors import LaneError, StationError
from maps.grid import DCOL, DROW, HEADING_YAW, CellOutsideError, GridMap
from maps.plan import FloorPlan
from maps.vehicle import BODY_FRONT_M, ENTRY_INSET_M, TRAY_AHEAD_M, TURN_RADIUS_M

Floats = npt.NDArray[np.float64]

ARM_TO_LANE_M = 0.60
"""Default distance of an arm's base from the centre line of its dock lane, unless that is wider."""
OFF_LANE_M = 0.005
"""The middle of an arm's base is at least so far beside its dock lane [m]."""
SLOT_RADIUS_M = 0.45
SLOT_ANGLES_DEG = (-155.0, -115.0, 115.0, 155.0)
"""Default slots: around the back of the base, measured from the direction to the lane."""
SLOT_TOP_M = 0.25
PEDESTAL_HALF_M = 0.08
"""Half edge of the pedestal under a slot, seen from above."""
REACH_M = (0.35, 0.65)
"""The arm works well on points whose horizontal distance from its base lies in this range."""
MIN_ARM_SPACING_M = 2.0
MIN_PARTNER_SPACING_M = 1.1
"""The same for the two arms of one dock, whose motions are coordinated [m]: each keeps its base and rack to itself."""
ARM_BASE_RADIUS_M = 0.15
NOSE_GAP_M = 0.14
"""A docked car's nose stays this far inside its cell [m]: release tolerance 0.05, following error 0.05, a margin."""
_TOLERANCE_M = 1e-6


@dataclass(frozen=True, kw_only=True)
class StationOptions:
    """What a site file may say about one station; None means the default derived from the plan."""

    stop_offset_m: float | None = None
    """How much deeper than usual the car stops in the dock cell [m]."""
    arm_xy: tuple[float, float] | None = None
    """Arm base on the floor [m]."""
    arm_yaw_deg: float | None = None
    """Direction of the arm's +x, counter-clockwise from east."""
    arm: str | None = None
    """Model of the arm; which there are is known to who runs the site."""
    slots: tuple[tuple[float, float, float], ...] | None = None
    """Slots x, y, z in the arm's base frame [m]; z is the height of the slot's top."""


@dataclass(frozen=True, kw_only=True)
class DockPlace:
    """Where a car stops to be served."""

    cell: int
    heading: int
    pose: tuple[float, float, float]
    """Stop pose of the rear axle: x, y [m], yaw [rad]."""
    stop_offset_m: float
    """How much deeper than the usual 0.1 m behind the entry side the car stops."""

    @property
    def tray_xy(self) -> tuple[float, float]:
        """Centre of the tray of a stopped car [m]."""
        x, y, yaw = self.pose
        return x + TRAY_AHEAD_M * math.cos(yaw), y + TRAY_AHEAD_M * math.sin(yaw)


@dataclass(frozen=True, kw_only=True)
class ArmPlace:
    """Where an arm stands."""

    model: str | None = None
    """What arm it is, if the site says so."""
    pose: tuple[float, float, float, float]
    """Base: x, y, z [m], yaw [rad]; +x points to the dock lane."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StationPlace:
    """One arm, its rack of slots and its dock."""

    name: str
    kind: Literal["pick", "drop"]
    dock: DockPlace
    arm: ArmPlace
    slots: Floats
    """Centre of each slot's top surface in the world [m], shape (n_slots, 3)."""
    pedestal_half_m: Floats
    """Half extents of the axis-aligned pedestal under each slot, floor to top [m], shape (n_slots, 3)."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, StationPlace):
            return NotImplemented
        same_words = (self.name, self.kind, self.dock, self.arm) == (other.name, other.kind, other.dock, other.arm)
        same_slots = np.array_equal(self.slots, other.slots)
        return same_words and same_slots and np.array_equal(self.pedestal_half_m, other.pedestal_half_m)

    __hash__ = None  # type: ignore[assignment]


def name_stations(plan: FloorPlan, arm_sides: Mapping[int, tuple[int, ...]]) -> dict[int, tuple[str, ...]]:
    """Names of the stations at each dock cell, one for each arm, numbered in reading order: pick_1, ..., drop_1, ...

    Args:
        plan: The drawing.
        arm_sides: Headings from each dock to its arms, from `match_arms`.
    """
    names = {}
    for character, kind in (("P", "pick"), ("D", "drop")):
        number = 1
        for cell in plan.cells(character):
            names[cell] = tuple(f"{kind}_{number + k}" for k in range(len(arm_sides[cell])))
            number += len(arm_sides[cell])
    return names


def match_arms(plan: FloorPlan, grid: GridMap, *, where: str) -> dict[int, tuple[int, ...]]:
    """Headings from each dock cell to its own arm cells: one, or two on opposite sides.

    Raises:
        StationError: A dock has no arm beside it, or too many, or an arm stands beside no dock or between two.
    """
    arms = set(plan.cells("A"))
    sides: dict[int, tuple[int, ...]] = {}
    owner: dict[int, str] = {}
    for character, kind in (("P", "pick"), ("D", "drop")):
        number = 1
        for dock in plan.cells(character):
            beside = tuple(heading for heading in range(4) if grid.neighbour(dock, heading) in arms)
            name = f"{kind}_{number}"
            if len(beside) not in (1, 2) or (len(beside) == 2 and (beside[0] + 2) % 4 != beside[1]):
                raise StationError(
                    f"{where}: {name} at {grid.words(dock)} has {len(beside)} arms beside it; "
                    "valid: one 'A', or two on opposite sides"
                )
            for heading in beside:
                arm = grid.neighbour(dock, heading)
                if arm in owner:
                    raise StationError(
                        f"{where}: the arm at {grid.words(arm)} stands beside {owner[arm]} and {name}; "
                        "valid: an arm of its own for each dock"
                    )
                owner[arm] = name
            sides[dock] = beside
            number += len(beside)
    for arm in sorted(arms - set(owner)):
        raise StationError(f"{where}: the arm at {grid.words(arm)} has no dock beside it; valid: beside one 'P' or 'D'")
    return sides


def place_stations(
    plan: FloorPlan,
    grid: GridMap,
    arm_sides: Mapping[int, tuple[int, ...]],
    lanes: npt.NDArray[np.int32],
    options: Mapping[str, StationOptions],
    *,
    where: str,
) -> tuple[StationPlace, ...]:
    """Give every dock its stop pose, arm and slots, picks first, each kind in reading order.

    A car in a dock with a straight exit stops so that its tray lies over the cell's centre; a dock whose exit is a
    turn keeps the usual waiting pose, since a car that stands deeper could not turn out.

    Args:
        plan: The drawing.
        grid: Its floor.
        arm_sides: Headings from each dock to its arms, from `match_arms`.
        lanes: Directed lanes, shape (n, 2).
        options: Entries of the site file by station name.
        where: Name of the site, opens every message.

    Raises:
        LaneError: No lane serves a dock.
        StationError: An entry names no station, or tray, slots, dock or other arms are too near or too far.
    """
    names = name_stations(plan, arm_sides)
    known = [name for own in names.values() for name in own]
    for name in options:
        if name not in known:
            raise StationError(f"{where}: stations.{name} is not in the plan; valid: one of {', '.join(known)}")
    lane_set = {(int(a), int(b)) for a, b in lanes}
    places = []
    for cell, own in names.items():
        entries = [h for h in range(4) if (grid.neighbour(cell, (h + 2) % 4), cell) in lane_set]
        exits = [h for h in range(4) if (cell, grid.neighbour(cell, h)) in lane_set]
        if len(entries) != 1 or not exits:
            raise LaneError(
                f"{where}: {own[0]} at {grid.words(cell)} is a dead end or cut off from the largest connected part of "
                "the lanes; valid: a lane that leads past its arm and on to other cells"
            )
        docks = []
        for name, side in zip(own, arm_sides[cell], strict=True):
            given = options.get(name, StationOptions())
            docks.append(_dock(name, cell, entries[0], entries[0] in exits, grid, given, where))
            station = _station(name, docks[-1], side, grid.cell_m, given)
            _check_reach(station, where)
            places.append(station)
        if docks[0] != docks[-1]:
            raise StationError(
                f"{where}: stations.{own[0]}.stop_offset_m is {docks[0].stop_offset_m:g} and stations.{own[-1]}"
                f".stop_offset_m is {docks[-1].stop_offset_m:g}; valid: equal ones, as both serve the dock at "
                f"{grid.words(cell)}"
            )
    _check_floor(places, plan, grid, where)
    _check_spacing(places, where)
    return tuple(places)


def _dock(
    name: str, cell: int, heading: int, straight_exit: bool, grid: GridMap, given: StationOptions, where: str
) -> DockPlace:
    half = grid.cell_m / 2
    # The car ahead gives its cell back a little before its tail has left it: stop short of the border.
    deepest = grid.cell_m - ENTRY_INSET_M - BODY_FRONT_M - NOSE_GAP_M
    offset = half - ENTRY_INSET_M - TRAY_AHEAD_M if straight_exit else 0.0
    if given.stop_offset_m is not None:
        offset = given.stop_offset_m
    if not 0.0 <= offset <= deepest + _TOLERANCE_M:
        raise StationError(
            f"{where}: stations.{name}.stop_offset_m is {offset:g}; valid: 0 to {deepest:.2f}, so that the car stands "
            "in its cell"
        )
    if offset > half - ENTRY_INSET_M - TURN_RADIUS_M + _TOLERANCE_M and not straight_exit:
        raise StationError(
            f"{where}: stations.{name}.stop_offset_m is {offset:g}; valid: 0, because the dock at {grid.words(cell)} "
            "is left by a turn, which starts at the usual waiting pose"
        )
    ((centre_x, centre_y),) = grid.cell_xy(cell).tolist()
    ahead_x, ahead_y = DCOL[heading], -DROW[heading]
    along = ENTRY_INSET_M + offset - half
    pose = (centre_x + along * ahead_x, centre_y + along * ahead_y, HEADING_YAW[heading])
    return DockPlace(cell=cell, heading=heading, pose=pose, stop_offset_m=offset)


def _station(name: str, dock: DockPlace, arm_side: int, cell_m: float, given: StationOptions) -> StationPlace:
    tray_x, tray_y = dock.tray_xy
    to_lane_m = max(ARM_TO_LANE_M, cell_m / 2 + OFF_LANE_M)
    arm_x = tray_x + to_lane_m * DCOL[arm_side]
    arm_y = tray_y - to_lane_m * DROW[arm_side]
    yaw = HEADING_YAW[(arm_side + 2) % 4]
    if given.arm_xy is not None:
        arm_x, arm_y = given.arm_xy
    if given.arm_yaw_deg is not None:
        yaw = math.radians(given.arm_yaw_deg)
    local = given.slots
    if local is None:
        local = tuple(
            (SLOT_RADIUS_M * math.cos(math.radians(a)), SLOT_RADIUS_M * math.sin(math.radians(a)), SLOT_TOP_M)
            for a in SLOT_ANGLES_DEG
        )
    base_from_slot = np.asarray(local, dtype=np.float64).reshape(-1, 3)
    cos, sin = math.cos(yaw), math.sin(yaw)
    slots = np.column_stack(
        (
            arm_x + cos * base_from_slot[:, 0] - sin * base_from_slot[:, 1],
            arm_y + sin * base_from_slot[:, 0] + cos * base_from_slot[:, 1],
            base_from_slot[:, 2],
        )
    )
    half_extents = np.column_stack((np.full((len(slots), 2), PEDESTAL_HALF_M), slots[:, 2] / 2))
    return StationPlace(
        name=name,
        kind="pick" if name.startswith("pick") else "drop",
        dock=dock,
        arm=ArmPlace(model=given.arm, pose=(arm_x, arm_y, 0.0, yaw)),
        slots=slots,
        pedestal_half_m=half_extents,
    )


def _check_reach(station: StationPlace, where: str) -> None:
    """Tray, dock and slots lie where the arm works well."""
    if len(station.slots) == 0:
        raise StationError(f"{where}: stations.{station.name}.slots is []; valid: at least one [x, y, z]")
    base = np.array(station.arm.pose[:2])
    points = {"the tray of a docked car": station.dock.tray_xy, "the dock's stop pose": station.dock.pose[:2]}
    points |= {f"slot {number}": (slot[0], slot[1]) for number, slot in enumerate(station.slots, start=1)}
    for what, point in points.items():
        distance = float(np.hypot(*(np.array(point) - base)))
        if not REACH_M[0] - _TOLERANCE_M <= distance <= REACH_M[1] + _TOLERANCE_M:
            raise StationError(
                f"{where}: {station.name}: the arm at ({base[0]:.2f}, {base[1]:.2f}) m cannot serve {what} "
                f"at ({point[0]:.2f}, {point[1]:.2f}) m: {distance:.2f} m away; valid: {REACH_M[0]} to {REACH_M[1]} m"
            )


def _check_floor(places: list[StationPlace], plan: FloorPlan, grid: GridMap, where: str) -> None:
    """Arm bases and pedestals stand beside the lanes, not on them."""
    lanes = plan.open
    for station in places:
        base = np.array([station.arm.pose[:2]])
        boxes = [("the arm's base", point, ARM_BASE_RADIUS_M) for point in base]
        boxes += [(f"slot {number}", slot[:2], PEDESTAL_HALF_M) for number, slot in enumerate(station.slots, start=1)]
        for what, centre, half in boxes:
            # The base may lean out of its cell by less than a car's clearance: cars keep to the centre lines.
            reach = half - _TOLERANCE_M if what.startswith("slot") else 0.0
            for dx, dy in ((-reach, -reach), (-reach, reach), (reach, -reach), (reach, reach)):
                try:
                    row, col = grid.cell_at(float(centre[0]) + dx, float(centre[1]) + dy)
                except CellOutsideError as error:
                    raise StationError(
                        f"{where}: {station.name}: {what} at ({centre[0]:.2f}, {centre[1]:.2f}) m lies outside of the "
                        f"floor; valid: on blocked cells (one of # = _ A)"
                    ) from error
                if lanes[row, col]:
                    raise StationError(
                        f"{where}: {station.name}: {what} at ({centre[0]:.2f}, {centre[1]:.2f}) m stands on the lane "
                        f"cell {grid.words(grid.index(row, col))}; valid: on blocked cells (one of # = _ A)"
                    )


def _check_spacing(places: list[StationPlace], where: str) -> None:
    from scipy.spatial import KDTree  # with stations come lanes, whose packages are heavy too

    bases = np.array([station.arm.pose[:2] for station in places])
    for first, second in sorted(KDTree(bases).query_pairs(MIN_ARM_SPACING_M)):
        partners = places[first].dock.cell == places[second].dock.cell
        least = MIN_PARTNER_SPACING_M if partners else MIN_ARM_SPACING_M
        distance = float(np.hypot(*(bases[first] - bases[second])))
        if distance < least - _TOLERANCE_M:
            raise StationError(
                f"{where}: the arms of {places[first].name} and {places[second].name} stand "
                f"{distance:.2f} m apart; valid: at least {least} m"
            )
