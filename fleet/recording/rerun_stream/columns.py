"""Columns: component data made straight from arrays, and the chunks in which they go to a recording.

The constructors of rerun's archetypes accept anything and cost about 0.1 ms a call, which is most of the price of a
small batch; these know that they get float arrays.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import rerun as rr
from numba import njit
from rerun.chunk import Chunk

from fleet.arrays import CellArray, FloatArray
from fleet.recording.index import Times

_POINT = [(0.0, 0.0, 0.0)]
_EXAMPLES = (
    rr.InstancePoses3D(translations=_POINT, quaternions=[rr.Quaternion.identity()]),
    rr.Boxes3D.from_fields(centers=_POINT, half_sizes=_POINT, quaternions=[rr.Quaternion.identity()], colors=[0]),
    rr.LineStrips3D.from_fields(strips=[_POINT]),
    rr.Points3D.from_fields(positions=_POINT),
    rr.Arrows3D.from_fields(vectors=_POINT, origins=_POINT, colors=[0]),
    rr.GraphNodes(["a"], positions=[(0.0, 0.0)], labels=["a"], colors=[0]),
    rr.GraphEdges([("a", "b")]),
    rr.StateChange(state="a"),
    rr.Scalars(0.0),
    rr.TextDocument("a"),
    rr.TextLog("a", level="INFO"),
)
_KINDS = {
    batch.component_descriptor().component: (batch.component_descriptor(), batch.as_arrow_array().type)
    for archetype in _EXAMPLES
    for batch in archetype.as_component_batches()
}

_STRAIGHT_M2 = 1e-6
"""Two steps that span less than this lie on a line."""


@dataclass(frozen=True)
class ArrowColumn:
    """One component over the rows of a batch."""

    descriptor: rr.ComponentDescriptor
    rows: pa.ListArray

    def component_descriptor(self) -> rr.ComponentDescriptor:
        """What the values are."""
        return self.descriptor

    def as_arrow_array(self) -> pa.ListArray:
        """The values, one list per row."""
        return self.rows

    def part(self, first: int, n_rows: int) -> ArrowColumn:
        """Some of its rows, of the same memory."""
        return ArrowColumn(self.descriptor, self.rows.slice(first, n_rows))


class Chunks:
    """The rows of a batch, entity by entity, on their way to a recording.

    They go out together: rerun's threads, which pass them on, compress and write, wake once for a batch and not once
    for each of its entities.

    Args:
        rec: The open recording.
    """

    def __init__(self, rec: rr.RecordingStream) -> None:
        self._rec = rec
        self._made: list[Chunk] = []

    def add(self, path: str, index: Iterable[Times], columns: Iterable[ArrowColumn]) -> None:
        """Add rows of one entity, as columns; rerun's own type of a column is a class, of which it uses two methods."""
        wanted: Iterable[Any] = columns
        self._made.append(Chunk.from_columns(path, indexes=index, columns=wanted))

    def send(self) -> None:
        """Hand over what was added."""
        self._rec.send_chunks(self._made)
        self._made = []


def offsets_of(lengths: Sequence[int] | npt.NDArray[np.integer]) -> npt.NDArray[np.int32]:
    """Where each row begins, and the end, shape (n_rows + 1,)."""
    made = np.zeros(len(lengths) + 1, np.int32)
    np.cumsum(lengths, out=made[1:])
    return made


def vectors(component: str, rows: npt.NDArray[np.floating], offsets: npt.NDArray[np.int32]) -> ArrowColumn:
    """A column of fixed-size vectors.

    Args:
        component: 'InstancePoses3D:translations', 'Boxes3D:quaternions', ...
        rows: Vectors of all rows, shape (k, width).
        offsets: Where each row begins, as by `offsets_of`.
    """
    descriptor, kind = _KINDS[component]
    flat = np.ascontiguousarray(rows, np.float32).reshape(-1)
    items = pa.FixedSizeListArray.from_arrays(pa.array(flat), type=kind)
    return ArrowColumn(descriptor, pa.ListArray.from_arrays(offsets, items))


def values(component: str, items: Sequence[object] | npt.NDArray[Any], offsets: npt.NDArray[np.int32]) -> ArrowColumn:
    """A column of numbers, of colours (0xRRGGBBAA) or of words.

    Args:
        component: 'Boxes3D:colors', 'GraphNodes:labels', ...
        items: Values of all rows, k of them.
        offsets: Where each row begins, as by `offsets_of`.
    """
    descriptor, kind = _KINDS[component]
    return ArrowColumn(descriptor, pa.ListArray.from_arrays(offsets, pa.array(items, type=kind)))


def pairs(component: str, first: Sequence[str], second: Sequence[str], offsets: npt.NDArray[np.int32]) -> ArrowColumn:
    """A column of pairs of words: 'GraphEdges:edges'; k of each."""
    descriptor, kind = _KINDS[component]
    words = [pa.array(first, pa.string()), pa.array(second, pa.string())]
    items = pa.StructArray.from_arrays(words, fields=[kind.field(0), kind.field(1)])
    return ArrowColumn(descriptor, pa.ListArray.from_arrays(offsets, items))


def strips(
    xy: npt.NDArray[np.floating], lengths: Sequence[int], height: float, offsets: npt.NDArray[np.int32]
) -> ArrowColumn:
    """A column of polylines at a constant height, without points that lie straight between their neighbours.

    Args:
        xy: Points of all polylines, one after the other [m], shape (k, 2).
        lengths: Points of each polyline, 0 for none.
        height: Their z [m].
        offsets: Where each row begins in `lengths`.
    """
    descriptor, kind = _KINDS["LineStrips3D:strips"]
    points, bounds = _without_straight(np.asarray(xy, np.float64).reshape(-1, 2), offsets_of(lengths), height)
    vertices = pa.FixedSizeListArray.from_arrays(pa.array(points.reshape(-1)), type=kind.value_type)
    items = pa.ListArray.from_arrays(pa.array(bounds), vertices, type=kind)
    return ArrowColumn(descriptor, pa.ListArray.from_arrays(offsets, items))


@njit(cache=True)
def _without_straight(xy: FloatArray, bounds: CellArray, height: float) -> tuple[npt.NDArray[np.float32], CellArray]:
    """Corners and ends of polylines, (k, 3), and where each polyline begins among them."""
    points = np.empty((len(xy), 3), np.float32)
    begins = np.zeros(len(bounds), np.int32)
    n = 0
    for line in range(len(bounds) - 1):
        first, end = bounds[line], bounds[line + 1]
        for k in range(first, end):
            if first < k < end - 1:
                ax, ay = xy[k, 0] - xy[k - 1, 0], xy[k, 1] - xy[k - 1, 1]
                bx, by = xy[k + 1, 0] - xy[k, 0], xy[k + 1, 1] - xy[k, 1]
                if abs(ax * by - ay * bx) <= _STRAIGHT_M2:
                    continue
            points[n, 0], points[n, 1], points[n, 2] = xy[k, 0], xy[k, 1], height
            n += 1
        begins[line + 1] = n
    return points[:n], begins
