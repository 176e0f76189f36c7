"""TileBoard: memory that the processes of a tiled world share, so that no tick has to copy it between them."""

from __future__ import annotations

import mmap
import os
import tempfile
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from fleet.arrays import BoolArray, FloatArray, IntArray

MOST_PARCELS = 1 << 18
"""Room for poses; memory is taken when a row is used."""


class TileBoard:
    """What robots are told in a tick, and what became of them.

    Attributes:
        commands: Of the cars, steering [rad] and speed [m/s], shape (n_cars, 2).
        arm_q, arm_qd: Joint targets of the arms and velocities there [rad, rad/s], shape (n_arms, n_joints).
        grip: Whether each arm holds, shape (n_arms,).
        tile_of: Tile that each car is in, shape (n_cars,).
        before: Poses of the cars before the tick, shape (n_cars, 3).
        poses, speeds, steering: Of the cars after it, shapes (n_cars, 3), (n_cars,), (n_cars,).
        q, qd: Of the arms after it, shape (n_arms, n_joints).
        held: Parcel in each arm's grip, -1 for none, shape (n_arms,).
        parcels: Poses of the parcels, by their rows, shape (`MOST_PARCELS`, 7).
        of_cars, of_arms: Contacts of each so far, shapes (n_cars,) and (n_arms,).
        counts: Contacts with robots and with fixed things in each tile so far, shape (n_tiles, 2).
        clearance: Smallest one in each tile so far [m], shape (n_tiles,).

    Args:
        sizes: Numbers of cars, arms, joints of an arm, and tiles.
        file: Memory of another board to share; None = new one.
    """

    commands: FloatArray
    arm_q: FloatArray
    arm_qd: FloatArray
    grip: BoolArray
    tile_of: IntArray
    before: FloatArray
    poses: FloatArray
    speeds: FloatArray
    steering: FloatArray
    q: FloatArray
    qd: FloatArray
    held: IntArray
    parcels: FloatArray
    of_cars: IntArray
    of_arms: IntArray
    counts: IntArray
    clearance: FloatArray

    def __init__(self, sizes: tuple[int, int, int, int], file: BinaryIO | None = None) -> None:
        self.sizes = sizes
        layout = _layout(*sizes)
        places, n_bytes = {}, 0
        for name, (shape, kind) in layout.items():
            places[name] = n_bytes
            n_bytes += -(-int(np.prod(shape)) * np.dtype(kind).itemsize // 64) * 64
        if file is None:
            file = _nameless_file()
            file.truncate(n_bytes)
        self.file = file
        """The memory, as a file without a name."""
        memory = mmap.mmap(file.fileno(), n_bytes)
        for name, (shape, kind) in layout.items():
            count = int(np.prod(shape))
            setattr(self, name, np.frombuffer(memory, kind, count, places[name]).reshape(shape))

    def copies(self) -> dict[str, npt.NDArray[np.generic]]:
        """Copies of all but the parcels' poses, by name."""
        return {name: getattr(self, name).copy() for name in _layout(*self.sizes) if name != "parcels"}

    def recall(self, copies: dict[str, npt.NDArray[np.generic]]) -> None:
        """Return to what `copies` gave."""
        for name, values in copies.items():
            getattr(self, name)[:] = values


def _layout(n_cars: int, n_arms: int, n_joints: int, n_tiles: int) -> dict[str, tuple[tuple[int, ...], type]]:
    """Shape and kind of each array."""
    joints = (n_arms, n_joints)
    return {
        "commands": ((n_cars, 2), np.float64),
        "arm_q": (joints, np.float64),
        "arm_qd": (joints, np.float64),
        "grip": ((n_arms,), np.bool_),
        "tile_of": ((n_cars,), np.int64),
        "before": ((n_cars, 3), np.float64),
        "poses": ((n_cars, 3), np.float64),
        "speeds": ((n_cars,), np.float64),
        "steering": ((n_cars,), np.float64),
        "q": (joints, np.float64),
        "qd": (joints, np.float64),
        "held": ((n_arms,), np.int64),
        "of_cars": ((n_cars,), np.int64),
        "of_arms": ((n_arms,), np.int64),
        "counts": ((n_tiles, 2), np.int64),
        "clearance": ((n_tiles,), np.float64),
        "parcels": ((MOST_PARCELS, 7), np.float64),
    }


def _nameless_file() -> BinaryIO:
    """A file in memory that ends with the processes that have it open."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("fleet-board"), "w+b")
    return tempfile.TemporaryFile()
