"""Coordination: who holds which cell, who waits for whom and why, and where the waiting gathers, in a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import rerun as rr
from numba import njit

from fleet.arrays import CellArray, FloatArray
from fleet.recording.errors import RecordingError
from fleet.recording.frame import Frame, Wait
from fleet.recording.header import DrawnFloor
from fleet.recording.index import index_of, set_time
from fleet.recording.rerun_stream import palette
from fleet.recording.rerun_stream.columns import Chunks, offsets_of, pairs, values, vectors
from fleet.recording.rerun_stream.poses import at_height
from fleet.world.scene import Scene

GRANTED, PLANNED = "world/cells/granted", "world/cells/planned"
WAITS = "world/waits"
"""Who waits for whom and why, in one entity: arrows over the floor, a graph, and a text, each in a view of its own."""
CONGESTION = "world/congestion"
PRIORITIES = "planner/priorities"
_PLATES = {GRANTED: 0.47, PLANNED: 0.16}
"""Half the edge of the plates on cells, as a share of a cell's."""
_PLATE_Z = {GRANTED: 0.001, PLANNED: 0.002}
_ALPHA = {GRANTED: 70, PLANNED: 110}
_N_ROWS = 7
"""Rows of the graph after which chains go on beside it."""
_ARROW_Z = 0.75
"""Over the cars, under the names of stations [m]."""
_NODE_PX = (110.0, 34.0)
"""Distances between nodes of the graph, along chains and across; a node with its name is 20 high."""
_BESIDE_M = 0.6
"""Along both axes [m]."""
_FULL_S = 60.0
"""Standing time in a cell from which on its plate has its full colour [s]."""
_SEEN_S = 1.0
"""Cells in which cars stood for less are left out [s]."""

Place = FloatArray
"""x, y [m], shape (2,)."""


class Coordination:
    """Writes what a run's robots have to do with each other.

    Args:
        rec: The open recording.
        chunks: Takes the rows of a batch.
        scene: Number and places of the robots.
        floor: Cells and stations.
    """

    def __init__(self, rec: rr.RecordingStream, chunks: Chunks, scene: Scene, floor: DrawnFloor) -> None:
        self._rec = rec
        self._chunks = chunks
        self._cell_xy, self._cell_m = floor.cell_xy, floor.cell_m
        cars = range(len(scene.car_start))
        self._car_colours = {path: palette.identity_colours(cars, alpha=alpha) for path, alpha in _ALPHA.items()}
        self._fixed_xy = {f"arm_{k}": base[:2] for k, base in enumerate(scene.arm_base)}
        self._fixed_xy |= dict(zip(floor.station_names, floor.dock_xy, strict=True))
        self._car_of = {f"car_{k}": k for k in cars}
        self._causes: set[str] = set()
        self._waits: Sequence[Wait] = ()
        self._told = _sentences({})
        self._plates = {path: at_height(floor.cell_xy, z).astype(np.float32) for path, z in _PLATE_Z.items()}
        # A floor without cells has no plates; one without a place would lie in the corner.
        for path, share in _PLATES.items() if len(floor.cell_xy) else ():
            half_m = share * floor.cell_m
            rec.log(path, rr.Boxes3D.from_fields(half_sizes=[(half_m, half_m, 0.001)], fill_mode="solid"), static=True)
        markdown = rr.TextDocument.from_fields(media_type="text/markdown")
        rec.log(WAITS, rr.Arrows3D.from_fields(radii=0.04), markdown, static=True)

    def write(self, frames: Sequence[Frame]) -> None:
        """Append what changed in some frames."""
        self._write_cells(GRANTED, [(frame, frame.held_by) for frame in frames if frame.held_by is not None])
        self._write_cells(PLANNED, [(frame, frame.next_of) for frame in frames if frame.next_of is not None])
        self._write_waits([frame for frame in frames if frame.waits is not None or frame.explanations is not None])
        for frame in frames:
            if frame.stood_s is not None:
                self._write_congestion(frame, frame.stood_s)
            if frame.priorities is not None:
                set_time(self._rec, frame)
                self._rec.set_time("plan_epoch", sequence=frame.plan_epoch)
                self._rec.log(PRIORITIES, rr.BarChart(frame.priorities))

    def _write_cells(self, path: str, changes: Sequence[tuple[Frame, npt.NDArray[np.int32]]]) -> None:
        if not changes or not len(self._cell_xy):
            return
        owners = np.concatenate([owner for _, owner in changes])
        centres, colours, offsets = _owned(owners, self._plates[path], self._car_colours[path])
        columns = [vectors("Boxes3D:centers", centres, offsets), values("Boxes3D:colors", colours, offsets)]
        self._chunks.add(path, index_of([frame for frame, _ in changes]), columns)

    def _write_waits(self, frames: Sequence[Frame]) -> None:
        """The wait-for graph, the same as arrows over the floor, red for whoever waits in a circle, and sentences."""
        if not frames:
            return
        looks = [self._look(frame) for frame in frames]
        nodes = [name for look in looks for name in look.names]
        places = np.concatenate([look.places for look in looks])
        rows = offsets_of([len(look.names) for look in looks])
        waits = [wait for look in looks for wait in look.waits]
        edges = offsets_of([len(look.waits) for look in looks])
        origins = np.concatenate([look.origins for look in looks])
        ends = np.concatenate([look.ends for look in looks])
        self._chunks.add(
            WAITS,
            index_of(frames),
            [
                values("GraphNodes:node_ids", nodes, rows),
                vectors("GraphNodes:positions", places, rows),
                values("GraphNodes:labels", nodes, rows),
                values("GraphNodes:colors", np.concatenate([look.colours for look in looks]), rows),
                pairs("GraphEdges:edges", [wait.who for wait in waits], [wait.whom for wait in waits], edges),
                vectors("Arrows3D:origins", at_height(origins, _ARROW_Z), edges),
                vectors("Arrows3D:vectors", at_height(ends - origins, 0.0), edges),
                values("Arrows3D:colors", np.concatenate([look.arrow_colours for look in looks]), edges),
                values("TextDocument:text", [look.told for look in looks], offsets_of([1] * len(looks))),
            ],
        )

    def _look(self, frame: Frame) -> _Look:
        if frame.waits is not None:
            self._waits = frame.waits
        if frame.explanations is not None:
            self._told = _sentences(frame.explanations)
        waits = self._waits
        ring = cyclic((wait.who, wait.whom) for wait in waits)
        arrows = np.array([self._arrow(wait, frame) for wait in waits], np.float64).reshape(-1, 2, 2)
        names = sorted({name for wait in waits for name in (wait.who, wait.whom)})
        inside = [wait.who in ring and wait.whom in ring for wait in waits]
        return _Look(
            waits=waits,
            told=self._told,
            names=names,
            places=chains(names, {wait.who: wait.whom for wait in waits}) * _NODE_PX,
            colours=np.array([_node_colour(name, ring) for name in names], np.uint32),
            origins=arrows[:, 0],
            ends=arrows[:, 1],
            arrow_colours=np.where(inside, palette.CYCLE, palette.WAIT).astype(np.uint32),
        )

    def _arrow(self, wait: Wait, frame: Frame) -> tuple[Place, Place]:
        """From who waits to what it waits for [m]."""
        origin, end = self._place(wait.who, frame), self._place(wait.whom, frame)
        if origin is None:
            raise RecordingError(f"{wait.who} waits and is no robot; valid: car_0, arm_0, ...")
        if end is None:
            # What is nowhere, such as a plan that is late, is drawn beside who waits for it.
            end = self._cell_xy[wait.cell] if wait.cell >= 0 else origin + _BESIDE_M
        return origin, end

    def _place(self, name: str, frame: Frame) -> Place | None:
        """Where a robot or a station is [m]; None for other things."""
        car = self._car_of.get(name)
        return self._fixed_xy.get(name) if car is None else frame.car_poses[car, :2]

    def _write_congestion(self, frame: Frame, stood_s: Mapping[str, FloatArray]) -> None:
        """In every cell one strip per cause, as wide as its share of the time; opaque where cars stood long."""
        total = np.sum([np.zeros(len(self._cell_xy)), *stood_s.values()], axis=0)
        left = np.zeros(len(self._cell_xy))
        set_time(self._rec, frame)
        for cause, seconds in stood_s.items():
            cells = np.flatnonzero((total >= _SEEN_S) & (seconds > 0))
            share = seconds[cells] / total[cells]
            if cause not in self._causes:
                if not len(cells):
                    continue
                self._causes.add(cause)
                self._rec.log(f"{CONGESTION}/{cause}", rr.Boxes3D.from_fields(fill_mode="solid"), static=True)
            ahead = left[cells] + share / 2 - 0.5
            centre = self._cell_xy[cells] + self._cell_m * np.column_stack([ahead, np.zeros(len(cells))])
            left[cells] += share
            alpha = (60 + 195 * np.minimum(1.0, total[cells] / _FULL_S)).astype(np.uint32)
            self._rec.log(
                f"{CONGESTION}/{cause}",
                rr.Boxes3D.from_fields(
                    centers=at_height(centre, 0.003),
                    half_sizes=np.column_stack(
                        [self._cell_m * share / 2, np.full((len(cells), 2), (self._cell_m / 2, 0.001))]
                    ),
                    colors=(palette.cause_colour(cause) & 0xFFFFFF00) | alpha,
                ),
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Look:
    """How the waits of one moment are told and drawn: nodes of the graph, then arrows."""

    waits: Sequence[Wait]
    told: str
    names: list[str]
    places: FloatArray
    colours: npt.NDArray[np.uint32]
    origins: FloatArray
    ends: FloatArray
    arrow_colours: npt.NDArray[np.uint32]


def cyclic(edges: Iterable[tuple[str, str]]) -> frozenset[str]:
    """Names from which a way along the edges leads back to themselves."""
    ahead: dict[str, set[str]] = {}
    for who, whom in edges:
        ahead.setdefault(who, set()).add(whom)

    def returns(name: str) -> bool:
        seen: set[str] = set()
        open_ = list(ahead[name])
        while open_:
            at = open_.pop()
            if at == name:
                return True
            if at not in seen:
                seen.add(at)
                open_ += ahead.get(at, ())
        return False

    return frozenset(name for name in ahead if returns(name))


def chains(names: Sequence[str], ahead: Mapping[str, str]) -> FloatArray:
    """Where to draw who waits for whom: who waits stands right of whom it waits for, each chain in rows of its own.

    Args:
        names: All nodes.
        ahead: Who waits -> whom it waits for.

    Returns:
        Column and row of each node, shape (k, 2); a circle is drawn as a chain that begins anywhere in it.
    """
    behind: dict[str, list[str]] = {}
    for who, whom in ahead.items():
        behind.setdefault(whom, []).append(who)
    place: dict[str, tuple[float, float]] = {}
    left, widest, row = 0.0, 0, 0
    # Roots first; what is left then are circles.
    for start in sorted(names, key=lambda name: name in ahead):
        if row >= _N_ROWS:
            left, widest, row = left + widest + 1.5, 0, 0
        open_ = [(start, 0)]
        while open_:
            name, column = open_.pop()
            if name in place:
                continue
            place[name] = (left + column, row)
            widest = max(widest, column)
            waiting = [who for who in behind.get(name, ()) if who not in place]
            open_ += [(who, column + 1) for who in reversed(waiting)]
            row += not waiting
    return np.array([place[name] for name in names], dtype=np.float64).reshape(-1, 2)


def _node_colour(name: str, ring: frozenset[str]) -> int:
    if name in ring:
        return palette.CYCLE
    kind, _, number = name.partition("_")
    return palette.identity_colour(int(number)) if kind == "car" and number.isdigit() else palette.LABEL


def _sentences(explanations: Mapping[str, str]) -> str:
    if not explanations:
        return "Nobody waits."
    return "\n\n".join(f"**{robot}**: {text.removeprefix(robot).strip()}" for robot, text in explanations.items())


@njit(cache=True)
def _owned(
    owners: CellArray,
    plates: npt.NDArray[np.float32],
    colours: npt.NDArray[np.uint32],
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32], CellArray]:
    """Plates of the cells that belong to a car, row by row.

    Args:
        owners: Car of each cell, -1 = nobody, of all rows, shape (rows * n_cells,).
        plates: Centre of each cell's plate [m], shape (n_cells, 3).
        colours: Of each car.

    Returns:
        Centres (k, 3), colours (k,), and where each row begins among them, (rows + 1,).
    """
    n_cells = len(plates)
    n = (owners >= 0).sum()
    centres, hues = np.empty((n, 3), np.float32), np.empty(n, np.uint32)
    offsets = np.zeros(len(owners) // n_cells + 1, np.int32)
    n = 0
    for k in range(len(owners)):
        if owners[k] >= 0:
            centres[n] = plates[k % n_cells]
            hues[n] = colours[owners[k]]
            n += 1
        offsets[k // n_cells + 1] = n
    return centres, hues, offsets
