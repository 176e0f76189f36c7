"""ShapeRecorder: a recording of drawn shapes whose poses change; for scenes that have no site."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import rerun as rr

from fleet.arrays import FloatArray
from fleet.recording.errors import RecordingError
from fleet.recording.rerun_stream import palette

_MEDIA = {".stl": rr.MediaType.STL, ".obj": rr.MediaType.OBJ}


class Shape(Protocol):
    """What can be drawn."""

    @property
    def name(self) -> str:
        """Unique name; slashes make a tree."""

    @property
    def kind(self) -> str:
        """'box', 'sphere', 'cylinder' or 'mesh'."""

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Edges of a box; radius first of a sphere; length, radius of a cylinder; scale of a mesh."""

    @property
    def mesh(self) -> str:
        """File of a mesh."""

    @property
    def rgba(self) -> tuple[float, float, float, float]:
        """Colour."""


class ShapeRecorder:
    """Writes shapes once and their poses over time into one file, at the end.

    Args:
        path: File to write; replaced if it exists.
        title: Name of the recording.
        shapes: What is drawn.

    Raises:
        RecordingError: The file cannot be opened.
    """

    def __init__(self, path: Path, title: str, shapes: Sequence[Shape]) -> None:
        self._path = path
        self._paths: list[str] = []
        self._scales: list[float] = []
        self._times: list[float] = []
        self._poses: list[FloatArray] = []
        try:
            with path.open("wb"):
                pass
            self._rec = rr.RecordingStream("fleet")
            self._rec.set_sinks(rr.FileSink(str(path)))
        except (OSError, RuntimeError, ValueError) as error:
            raise RecordingError(f"recording {path} cannot be opened: {error}") from error
        self._rec.send_recording_name(title)
        self._rec.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for shape in shapes:
            self._paths.append(f"world/{shape.name}")
            self._scales.append(shape.size_m[0] if shape.kind == "mesh" else 1.0)
            self._rec.log(self._paths[-1], _archetype(shape), static=True)

    def record(self, sim_s: float, poses: FloatArray) -> None:
        """Note a moment: simulated time [s] and poses x, y, z, quat_xyzw of all shapes, shape (k, 7)."""
        self._times.append(sim_s)
        self._poses.append(poses)

    def close(self) -> None:
        """Write the file."""
        if self._times:
            index = [rr.TimeColumn("sim_time", duration=np.array(self._times))]
            table = np.stack(self._poses)
            for number, path in enumerate(self._paths):
                own = table[:, number]
                # What never moves is told once.
                rows = slice(0, 1) if np.array_equal(own, np.broadcast_to(own[0], own.shape)) else slice(None)
                when = index if rows.stop is None else [rr.TimeColumn("sim_time", duration=np.array(self._times[:1]))]
                columns = rr.Transform3D.columns(
                    translation=own[rows, :3],
                    quaternion=own[rows, 3:],
                    scale=np.full((len(own[rows]), 3), self._scales[number]),
                )
                self._rec.send_columns(path, indexes=when, columns=columns)
        self._rec.flush(timeout_sec=10.0)
        self._rec.disconnect()


def _archetype(shape: Shape) -> rr.AsComponents:
    colour = np.array([palette.packed(shape.rgba)], np.uint32)
    a, b, _ = shape.size_m
    if shape.kind == "box":
        return rr.Boxes3D(half_sizes=[[edge / 2 for edge in shape.size_m]], colors=colour, fill_mode="solid")
    if shape.kind == "sphere":
        return rr.Ellipsoids3D(half_sizes=[[a, a, a]], colors=colour, fill_mode="solid")
    if shape.kind == "cylinder":
        return rr.Cylinders3D(lengths=[a], radii=[b], colors=colour, fill_mode="solid")
    mesh = Path(shape.mesh)
    return rr.Asset3D(
        contents=mesh.read_bytes(), media_type=_MEDIA[mesh.suffix.lower()], albedo_factor=palette.packed(shape.rgba)
    )
