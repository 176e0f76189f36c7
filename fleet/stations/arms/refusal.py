"""PlaceRefusal: why an arm cannot serve its station, and what would have to be drawn differently."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fleet.arrays import BoolArray
from fleet.robots.arms.spec import ArmSpec
from fleet.stations.arms.arm_cell import ArmCell
from fleet.stations.arms.arm_motions import UnreachableError
from fleet.stations.arms.cell_planner import HOME, CellPlanner, PlaceError
from fleet.stations.arms.transfer import TRAY
from maps.stations import ARM_TO_LANE_M, SLOT_RADIUS_M, SLOT_TOP_M

N_NEAREST = 6
"""So many things are looked at as what is in the way: each look may take seconds."""


@dataclass(frozen=True, kw_only=True)
class PlaceRefusal:
    """A place that an arm cannot serve."""

    place: int
    """Slot index, `TRAY` or `HOME`."""
    why: str
    """Begins with the place."""
    in_the_way: tuple[int, ...]
    """Boxes of the cell without which the place could be served; empty if taking away boxes does not help."""

    def words(self, station: str, arm: ArmSpec, cell: ArmCell) -> str:
        """The refusal in one line.

        Args:
            station: Name of the station.
            arm: Its arm with the tool.
            cell: The station's surroundings.
        """
        return f"station {station}, arm {arm.name}, grip {arm.tool.name}, {self.why}; valid: {self._cure(cell)}"

    def _cure(self, cell: ArmCell) -> str:
        names = list(dict.fromkeys(cell.box_name[k] for k in self.in_the_way))
        drawn = [name for name in names if not name.startswith("slot")]
        slots = [name for name in names if name.startswith("slot")]
        cures = [f"'_' for the {' and the '.join(drawn)}"] if drawn else []
        cures += [f"more room between this and {' and '.join(slots)}"] if slots else []
        if cures:
            return ", ".join(cures)
        if self.place in (TRAY, HOME):
            return f"the arm at its default place, {ARM_TO_LANE_M} m beside the dock's lane and turned to it"
        return f"slots at their default places, {SLOT_RADIUS_M} m from the arm's base and {SLOT_TOP_M} m high"


def refusal_of(planner: CellPlanner, make: Callable[[ArmCell], CellPlanner]) -> PlaceRefusal | None:
    """Prepare a planner; if it refuses a place, find out what is in the way, nearest to the place first.

    Args:
        planner: Of the station's arm.
        make: Makes a planner for other surroundings of the same arm.

    Returns:
        None if the arm can serve its station.
    """
    try:
        planner.prepare()
    except PlaceError as error:
        return PlaceRefusal(place=error.place, why=str(error), in_the_way=_in_the_way(planner.cell, error.place, make))
    return None


def _in_the_way(cell: ArmCell, place: int, make: Callable[[ArmCell], CellPlanner]) -> tuple[int, ...]:
    """Boxes without which a place could be served: of one thing if that is enough, else of the nearest."""

    def served(names: list[str]) -> bool:
        try:
            make(_without(cell, np.isin(cell.box_name, names))).prepare((place,))
        except UnreachableError:
            return False
        return True

    nearest = _things(cell, place)[:N_NEAREST]
    if not served(nearest):
        return ()
    enough = next(([name] for name in nearest if served([name])), nearest)
    return tuple(np.flatnonzero(np.isin(cell.box_name, enough)).tolist())


def _things(cell: ArmCell, place: int) -> list[str]:
    """Names of what could be drawn differently, nearest to a place first."""
    at = {HOME: np.zeros(3), TRAY: cell.tray}[place] if place < 0 else cell.slots[place]
    cos, sin = np.cos(cell.box_yaw), np.sin(cell.box_yaw)
    dx, dy = (at[:2] - cell.box_centre[:, :2]).T
    along = np.abs(cos * dx + sin * dy) - cell.box_half[:, 0]
    across = np.abs(-sin * dx + cos * dy) - cell.box_half[:, 1]
    gap_m = np.hypot(along.clip(0.0), across.clip(0.0))
    own = f"slot {place + 1}"
    names = [cell.box_name[k] for k in np.argsort(gap_m, kind="stable")]
    return [name for name in dict.fromkeys(names) if name not in ("", own)]


def _without(cell: ArmCell, gone: BoolArray) -> ArmCell:
    """The cell without some of its boxes."""
    return replace(
        cell,
        box_centre=cell.box_centre[~gone],
        box_half=cell.box_half[~gone],
        box_yaw=cell.box_yaw[~gone],
        box_min_frame=cell.box_min_frame[~gone],
        box_name=tuple(name for name, out in zip(cell.box_name, gone, strict=True) if not out),
    )
