"""Columns: component data for `send_columns` made straight from arrays.

The constructors of rerun's archetypes accept anything and cost about 0.1 ms a call, which is most of the price of a
small batch; these know that they get float arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

_INSTANCES = rr.InstancePoses3D(translations=[(0.0, 0.0, 0.0)], quaternions=[rr.Quaternion.identity()])
_BOXES = rr.Boxes3D.from_fields(centers=[(0.0, 0.0, 0.0)], quaternions=[rr.Quaternion.identity()])
_STRIPS = rr.LineStrips3D.from_fields(strips=[[(0.0, 0.0, 0.0)]])
_KINDS = {
    batch.component_descriptor().component: (batch.component_descriptor(), batch.as_arrow_array().type)
    for archetype in (_INSTANCES, _BOXES, _STRIPS)
    for batch in archetype.as_component_batches()
}


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


def offsets_of(lengths: Sequence[int]) -> npt.NDArray[np.int32]:
    """Where each row begins, and the end, shape (n_rows + 1,)."""
    made = np.zeros(len(lengths) + 1, np.int32)
    np.cumsum(lengths, out=made[1:])
    return made


def vectors(component: str, values: npt.NDArray[np.floating], offsets: npt.NDArray[np.int32]) -> ArrowColumn:
    """A column of fixed-size vectors.

    Args:
        component: 'InstancePoses3D:translations', 'Boxes3D:quaternions', ...
        values: Vectors of all rows, shape (k, width).
        offsets: Where each row begins, as by `offsets_of`.
    """
    descriptor, kind = _KINDS[component]
    flat = np.ascontiguousarray(values, np.float32).reshape(-1)
    items = pa.FixedSizeListArray.from_arrays(pa.array(flat), type=kind)
    return ArrowColumn(descriptor, pa.ListArray.from_arrays(offsets, items))


def strips(lines: Sequence[npt.NDArray[np.floating]], height: float, offsets: npt.NDArray[np.int32]) -> ArrowColumn:
    """A column of polylines at a constant height.

    Args:
        lines: Polylines of all rows [m], each (k, 2), k may be 0.
        height: Their z [m].
        offsets: Where each row begins in `lines`.
    """
    descriptor, kind = _KINDS["LineStrips3D:strips"]
    bounds = offsets_of([len(line) for line in lines])
    points = np.full((int(bounds[-1]), 3), height, np.float32)
    if len(points):
        points[:, :2] = np.concatenate([line.reshape(-1, 2) for line in lines])
    vertices = pa.FixedSizeListArray.from_arrays(pa.array(points.reshape(-1)), type=kind.value_type)
    items = pa.ListArray.from_arrays(pa.array(bounds), vertices, type=kind)
    return ArrowColumn(descriptor, pa.ListArray.from_arrays(offsets, items))
