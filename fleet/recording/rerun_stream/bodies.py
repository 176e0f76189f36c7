"""DrawnBodies: cars, arms, parcels and pods as instances of their meshes, and the trails of the cars."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from fleet.arrays import FloatArray, IntArray
from fleet.recording.frame import Frame
from fleet.recording.index import Times, index_of, set_time
from fleet.recording.rerun_stream import palette
from fleet.recording.rerun_stream.columns import ArrowColumn, Chunks, offsets_of, strips, vectors
from fleet.recording.rerun_stream.poses import (
    BODY,
    ArmChain,
    Array,
    Part,
    arm_parts,
    car_link_poses,
    car_parts,
    pod_part,
    snapped,
)
from fleet.recording.rerun_stream.scenery import log_part, log_tags
from fleet.robots.spec import CarSpec
from fleet.world.scene import Scene

CAR_BODIES = f"world/cars/{BODY}"
"""The entity that has one row per frame."""
TRAILS = "world/trails"
RAYS, HITS = "world/scans/rays", "world/scans/hits"
_FEW_CARS = 8
"""Of more cars than this nobody sees the wheels turn: they are drawn as a part of the body."""
_TRAIL_S, _TRAIL_STEP_S = 5.0, 0.5
"""Length of a trail, and time between its points [s]."""


class _DrawnArms(NamedTuple):
    """All arms of a model."""

    arms: IntArray
    """Which they are, shape (k,)."""
    links: dict[int, str]
    """Entity of each drawn link by its number; the base goes once it is placed."""


class _DrawnModel(NamedTuple):
    """The cars of one model."""

    spec: CarSpec
    cars: IntArray
    parts: list[tuple[str, Part]]
    """Their entities and what is drawn there."""


class DrawnBodies:
    """Writes where everything is.

    Args:
        rec: The open recording.
        chunks: Takes the rows of a batch.
        scene: Robots.
    """

    def __init__(self, rec: rr.RecordingStream, chunks: Chunks, scene: Scene) -> None:
        self._rec = rec
        self._chunks = chunks
        self._scene = scene
        n_cars = len(scene.car_start)
        self._wheels = n_cars <= _FEW_CARS
        models, self._models = scene.cars, list[_DrawnModel]()
        for kind, spec in enumerate(models.kinds if n_cars else ()):
            cars = np.flatnonzero(models.kind_of == kind)
            root = f"world/cars/{spec.name}" if kind else "world/cars"
            parts = self._opened(root, car_parts(spec, wheels=self._wheels))
            self._models.append(_DrawnModel(spec, cars, parts))
            log_tags(rec, f"{root}/{BODY}", cars.tolist(), n_cars, spec)
        self._wheel_radius_m = models.each("wheel_radius_m")
        self._arm_models = list(self._opened_arms())
        self._chain = ArmChain(scene.arms)
        self._place_bases()
        self._pods = self._opened("world", [pod_part()] if len(scene.pod_start) else [])
        self._arm_q: FloatArray | None = None
        self._wheel_angle: FloatArray = np.zeros(n_cars)
        self._rolled_s: float | None = None
        self._parcels: IntArray | None = None
        self._trail: deque[Array] = deque(maxlen=round(_TRAIL_S / _TRAIL_STEP_S) + 1)
        self._trail_due_s = 0.0
        colours = palette.identity_colours(range(n_cars), alpha=110)
        rec.log(RAYS, rr.LineStrips3D.from_fields(colors=_packed(palette.RAY), radii=0.004), static=True)
        rec.log(HITS, rr.Points3D.from_fields(colors=_packed(palette.HIT), radii=0.03), static=True)
        rec.log(TRAILS, rr.LineStrips3D.from_fields(colors=colours, radii=0.06), static=True)

    def write(self, frames: Sequence[Frame]) -> None:
        """Append the poses of some frames."""
        index = index_of(frames)
        self._write_cars(frames, index)
        self._write_arms(frames)
        self._write_parcels(frames, index)
        self._write_pods([frame for frame in frames if frame.pod_poses is not None])
        self._write_trails(frames)
        self._write_scans([frame for frame in frames if frame.scans is not None])

    def _opened(self, root: str, parts: Iterable[Part]) -> list[tuple[str, Part]]:
        opened = [(f"{root}/{part.link}", part) for part in parts]
        for path, part in opened:
            log_part(self._rec, path, part)
        return opened

    def _opened_arms(self) -> Iterator[_DrawnArms]:
        """Drawn links of the arms, those of each model by themselves."""
        team = self._scene.arms
        for spec in team.models:
            root = "world/arms" if len(team.models) == 1 else f"world/arms/{spec.name}"
            opened = self._opened(root, arm_parts(spec))
            links = {int(part.link.removeprefix("link_")): path for path, part in opened}
            yield _DrawnArms(np.array([arm for arm, own in enumerate(team.specs) if own.name == spec.name]), links)

    def _place_bases(self) -> None:
        """Bases of arms do not move."""
        position, quat = self._chain.link_poses(self._scene.arm_base, self._scene.arm_start[None])
        for arms, links in self._arm_models:
            if 0 in links:
                base = rr.InstancePoses3D(translations=position[0, 0, arms], quaternions=quat[0, 0, arms])
                self._rec.log(links.pop(0), base, static=True)

    def _write_cars(self, frames: Sequence[Frame], index: list[Times]) -> None:
        if not self._models:
            return
        poses = _stacked([frame.car_poses for frame in frames])
        steering = _stacked([frame.car_steering for frame in frames])
        rolled = self._rolled(frames) if self._wheels else steering
        for spec, cars, parts in self._models:
            own = (poses[:, cars], steering[:, cars], rolled[:, cars])
            links = car_link_poses(spec, *own, wheels=self._wheels)
            for path, part in parts:
                self._chunks.add(path, index, _instances(*links[part.link]))

    def _rolled(self, frames: Sequence[Frame]) -> FloatArray:
        """How far the wheels have turned by what the cars have driven [rad], shape (f, n_cars)."""
        times_s = np.array([frame.sim_s for frame in frames])
        steps_s = np.diff(times_s, prepend=times_s[0] if self._rolled_s is None else self._rolled_s)
        turns = _stacked([frame.car_speeds for frame in frames]) * steps_s[:, None] / self._wheel_radius_m
        angles = self._wheel_angle + np.cumsum(turns, axis=0)
        self._wheel_angle, self._rolled_s = angles[-1], frames[-1].sim_s
        return angles

    def _write_arms(self, frames: Sequence[Frame]) -> None:
        """Rows only for frames in which an arm has moved."""
        if not self._arm_models:
            return
        q = _stacked([frame.arm_q for frame in frames])
        before = np.concatenate([q[:1] if self._arm_q is None else self._arm_q[None], q[:-1]])
        moved = np.abs(q - before).max(axis=(1, 2)) > 0
        moved[0] |= self._arm_q is None
        self._arm_q = q[-1]
        if not moved.any():
            return
        index = index_of([frame for frame, new in zip(frames, moved, strict=True) if new])
        position, quat = self._chain.link_poses(self._scene.arm_base, q[moved])
        n_rows = position.shape[1]
        for arms, links in self._arm_models:
            # The rows of all links but the base, one link after the other.
            own = [part[1:, :, arms].reshape(-1, len(arms), part.shape[3]) for part in (position, quat)]
            columns = _instances(*own)
            for link, path in links.items():
                self._chunks.add(path, index, [column.part((link - 1) * n_rows, n_rows) for column in columns])

    def _write_parcels(self, frames: Sequence[Frame], index: list[Times]) -> None:
        poses = snapped(np.concatenate([frame.parcel_poses for frame in frames]))
        offsets = offsets_of([len(frame.parcel_ids) for frame in frames])
        self._chunks.add(
            "world/parcels",
            index,
            [
                vectors("Boxes3D:centers", poses[:, :3], offsets),
                vectors("Boxes3D:quaternions", poses[:, 3:], offsets),
            ],
        )
        for frame in frames:
            ids = frame.parcel_ids
            # Whoever makes the frames hands over the same array until a parcel comes or goes.
            if ids is not self._parcels and (self._parcels is None or not np.array_equal(ids, self._parcels)):
                set_time(self._rec, frame)
                self._rec.log(
                    "world/parcels",
                    rr.Boxes3D.from_fields(
                        half_sizes=frame.parcel_size_m.reshape(-1, 3) / 2,
                        colors=palette.identity_colours(ids.tolist()),
                        fill_mode="solid",
                    ),
                )
            self._parcels = ids

    def _write_pods(self, frames: Sequence[Frame]) -> None:
        """Where pods stand, or are carried."""
        poses = [frame.pod_poses for frame in frames if frame.pod_poses is not None]
        for path, _ in self._pods if poses else ():
            rows = _stacked(poses)
            self._chunks.add(path, index_of(frames), _instances(rows[..., :3], rows[..., 3:]))

    def _write_trails(self, frames: Sequence[Frame]) -> None:
        """Where the cars were in the last seconds, as lines that are renewed twice a second."""
        due, trails = [], []
        for frame in frames:
            if frame.sim_s >= self._trail_due_s:
                self._trail_due_s = frame.sim_s + _TRAIL_STEP_S - 1e-9
                self._trail.append(snapped(frame.car_poses[:, :2]))
                due.append(frame)
                trails.append(np.stack(self._trail, axis=1))
        if due:
            rows = offsets_of([len(trail) for trail in trails])
            lengths = [trail.shape[1] for trail in trails for _ in trail]
            xy = np.concatenate([trail.reshape(-1, 2) for trail in trails])
            self._chunks.add(TRAILS, index_of(due), [strips(xy, lengths, 0.006, rows)])

    def _write_scans(self, frames: Sequence[Frame]) -> None:
        """Rays of the lidars that hit something, and what they hit."""
        if not frames:
            return
        index = index_of(frames)
        ends = [frame.scans for frame in frames if frame.scans is not None]
        starts = [frame.scan_origins for frame in frames if frame.scan_origins is not None]
        rows = offsets_of([len(hits) for hits in ends])
        hits = snapped(np.concatenate(ends))
        self._chunks.add(HITS, index, [vectors("Points3D:positions", hits, rows)])
        rays = np.stack([snapped(np.concatenate(starts)), hits], axis=1)
        height = float(rays[0, 0, 2]) if len(rays) else 0.0
        self._chunks.add(RAYS, index, [strips(rays[:, :, :2], [2] * len(rays), height, rows)])


def _instances(position: Array, quat: Array) -> list[ArrowColumn]:
    """Columns of poses, positions (rows, n, 3) [m] and quaternions (rows, n, 4)."""
    n_rows, n_instances = position.shape[:2]
    offsets = np.arange(n_rows + 1, dtype=np.int32) * np.int32(n_instances)
    return [
        vectors("InstancePoses3D:translations", snapped(position), offsets),
        vectors("InstancePoses3D:quaternions", snapped(quat), offsets),
    ]


def _stacked(arrays: Sequence[FloatArray]) -> FloatArray:
    """As `np.stack` for arrays of one shape, at a third of its price."""
    return np.concatenate(arrays).reshape(len(arrays), *arrays[0].shape)


def _packed(colour: int) -> np.ndarray:
    """An array, because rerun takes a list of integers for the components of one colour."""
    return np.array([colour], np.uint32)
