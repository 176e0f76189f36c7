"""Stream: turns batches of frames into rerun columns; runs in the recorder's worker thread."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from fleet.recording import palette
from fleet.recording.columns import offsets_of, strips, vectors
from fleet.recording.frame import FloorPlan, Frame, LogLine
from fleet.recording.layout import layout
from fleet.recording.poses import Array, Part, arm_link_poses, car_link_poses, parts
from fleet.recording.scenery import log_part, log_scenery, log_tags
from fleet.recording.views import VIEWS, log_camera, log_image
from fleet.world.scene import Scene

CAR_TAGS = "world/cars/tag"
"""The entity that has one row per frame."""
_FLUSH_TICK_S = 0.2
"""Period at which rerun writes to its sinks [s]; a killed process loses up to two of them (measured)."""
_SERVER_MEMORY = "512MB"
"""What a viewer that joins late may still be sent; older frames are dropped, the scenery is kept."""


class Stream:
    """One open recording: a file, and on request a server on the loopback interface.

    Args:
        path: File to write.
        scene: Robots and boxes.
        floor: Lanes, stations, parking.
        about: Facts on the run for the reader: seed, settings, versions.
        plots: Title -> names of the metrics drawn together; empty = all metrics in one plot.
        cameras: Names of the cameras whose views may come.
        port: Port of the live server; None = no server.
    """

    def __init__(
        self,
        *,
        path: Path,
        scene: Scene,
        floor: FloorPlan,
        about: Mapping[str, object],
        plots: Mapping[str, Sequence[str]],
        cameras: Sequence[str],
        port: int | None,
    ) -> None:
        self._scene = scene
        self._plots = {title: tuple(names) for title, names in plots.items()}
        self._parcels: tuple[int, ...] | None = None
        self._seen: dict[str, str] = {}
        self._words: tuple[object, ...] = ()
        self._states: dict[str, set[str]] = {}
        self._counts: tuple[str, ...] = ()
        self._cameras: set[str] = set()
        self._rec = rr.RecordingStream("fleet", batcher_config=rr.ChunkBatcherConfig(flush_tick=_FLUSH_TICK_S))
        self._rec.set_log_time_enabled(False)
        self.uri = ""
        sinks: list[rr.FileSink | rr.GrpcServerSink] = [rr.FileSink(str(path))]
        if port is not None:
            server = rr.GrpcServerSink(bind_ip="127.0.0.1", port=port, server_memory_limit=_SERVER_MEMORY)
            self.uri = server.uri
            sinks.append(server)
        self._rec.set_sinks(*sinks, default_blueprint=layout(scene, floor, tuple(self._plots), cameras))
        self._rec.send_recording_name(f"{floor.name}, {len(scene.car_start)} cars")
        log_scenery(self._rec, scene, floor)
        self._rec.log("about", rr.TextDocument(_markdown(floor.name, about), media_type="text/markdown"), static=True)
        self._car_parts = self._open_parts("world/cars", parts(scene.car.visuals), len(scene.car_start))
        length, width = scene.car.front_m + scene.car.rear_m, 2 * scene.car.half_width_m
        self._tag_ahead = (scene.car.front_m - scene.car.rear_m) / 2
        log_tags(self._rec, CAR_TAGS, len(scene.car_start), (length, width))
        fixed = [v for v in scene.arm.visuals if v.link == "link_0"]
        moving = [v for v in scene.arm.visuals if v.link != "link_0"]
        self._arm_parts = self._open_parts("world/arms", parts(moving), len(scene.arm_base))
        self._log_bases(parts(fixed))
        for name in ("granted", "planned"):
            radius, alpha = (0.035, 230) if name == "granted" else (0.012, 150)
            self._rec.log(
                f"world/paths/{name}",
                rr.LineStrips3D.from_fields(
                    colors=palette.identity_colours(range(len(scene.car_start)), alpha=alpha), radii=radius
                ),
                static=True,
            )

    def write(self, frames: Sequence[Frame], lines: Sequence[LogLine]) -> None:
        """Append frames and log lines, both ascending in time."""
        if frames:
            index = _index([frame.tick for frame in frames], [frame.sim_s for frame in frames])
            self._write_cars(frames, index)
            self._write_arms(frames, index)
            self._write_parcels(frames, index)
            self._write_scalars(frames, index)
            self._write_paths(frames)
            self._write_states(frames)
            self._write_views(frames)
        if lines:
            index = _index([line.tick for line in lines], [line.sim_s for line in lines])
            columns = rr.TextLog.columns(text=[line.text for line in lines], level=[line.level for line in lines])
            self._send("log", index, columns)

    def close(self) -> None:
        """Write what is pending and the footer."""
        self._rec.flush(timeout_sec=10.0)
        self._rec.disconnect()

    def _open_parts(self, root: str, members: Iterable[Part], n_robots: int) -> list[tuple[str, Part]]:
        opened = [(f"{root}/{part.name}", part) for part in members if n_robots]
        for path, part in opened:
            log_part(self._rec, path, part, n_robots)
        return opened

    def _log_bases(self, members: Iterable[Part]) -> None:
        links = arm_link_poses(self._scene.arm, self._scene.arm_base, self._scene.arm_start[None])
        for path, part in self._open_parts("world/arms/base", members, len(self._scene.arm_base)):
            position, quat = part.poses(links)
            self._rec.log(path, rr.InstancePoses3D(translations=position[0], quaternions=quat[0]), static=True)

    def _write_cars(self, frames: Sequence[Frame], index: list[rr.TimeColumn]) -> None:
        poses = np.stack([frame.car_poses for frame in frames])
        links = car_link_poses(
            self._scene.car,
            poses,
            np.stack([frame.car_steering for frame in frames]),
            np.stack([frame.wheel_angle for frame in frames]),
        )
        for path, part in self._car_parts:
            self._send_instances(path, index, *part.poses(links))
        position, quat = links["chassis"]
        plate = position.copy()
        plate[..., 0] += self._tag_ahead * np.cos(poses[..., 2])
        plate[..., 1] += self._tag_ahead * np.sin(poses[..., 2])
        plate[..., 2] = 0.012
        self._send_instances(CAR_TAGS, index, plate, quat)

    def _write_arms(self, frames: Sequence[Frame], index: list[rr.TimeColumn]) -> None:
        if not self._arm_parts:
            return
        links = arm_link_poses(self._scene.arm, self._scene.arm_base, np.stack([frame.arm_q for frame in frames]))
        for path, part in self._arm_parts:
            self._send_instances(path, index, *part.poses(links))

    def _send_instances(self, path: str, index: list[rr.TimeColumn], position: Array, quat: Array) -> None:
        n_rows, n_instances = position.shape[:2]
        offsets = np.arange(n_rows + 1, dtype=np.int32) * np.int32(n_instances)
        self._send(
            path,
            index,
            [
                vectors("InstancePoses3D:translations", position, offsets),
                vectors("InstancePoses3D:quaternions", quat, offsets),
            ],
        )

    def _write_parcels(self, frames: Sequence[Frame], index: list[rr.TimeColumn]) -> None:
        poses = np.concatenate([frame.parcel_poses.reshape(-1, 7) for frame in frames])
        offsets = offsets_of([len(frame.parcel_ids) for frame in frames])
        centres = vectors("Boxes3D:centers", poses[:, :3], offsets)
        self._send("world/parcels", index, [centres, vectors("Boxes3D:quaternions", poses[:, 3:], offsets)])
        for frame in frames:
            ids = tuple(int(i) for i in frame.parcel_ids)
            if ids != self._parcels:
                self._parcels = ids
                self._at(frame)
                self._rec.log(
                    "world/parcels",
                    rr.Boxes3D.from_fields(
                        half_sizes=frame.parcel_size_m.reshape(-1, 3) / 2,
                        colors=palette.identity_colours(ids),
                        fill_mode="solid",
                    ),
                )

    def _write_scalars(self, frames: Sequence[Frame], index: list[rr.TimeColumn]) -> None:
        if not self._counts and frames[0].task_counts:
            self._counts = tuple(frames[0].task_counts)
            self._open_series("counts", self._counts, [palette.state_colour(name) for name in self._counts])
        self._send_series("counts", self._counts, [frame.task_counts for frame in frames], index)
        if not self._plots and frames[0].metrics:
            self._plots = {"all": tuple(frames[0].metrics)}
        for title, names in self._plots.items():
            path = f"metrics/{title}"
            if path not in self._states:
                self._states[path] = set(names)
                self._open_series(path, names, palette.identity_colours(range(len(names))).tolist())
            self._send_series(path, names, [frame.metrics for frame in frames], index)

    def _open_series(self, path: str, names: Sequence[str], colours: Sequence[int]) -> None:
        style = rr.SeriesLines(
            names=list(names),
            colors=np.array(colours, np.uint32),
            widths=[1.5] * len(names),
            interpolation_mode="StepAfter",
        )
        self._rec.log(path, style, static=True)

    def _send_series(
        self, path: str, names: Sequence[str], rows: Sequence[Mapping[str, float]], index: list[rr.TimeColumn]
    ) -> None:
        if names:
            values = np.array([[row.get(name, math.nan) for name in names] for row in rows], float)
            columns = rr.Scalars.columns(scalars=values.reshape(-1))
            self._send(path, index, columns.partition([len(names)] * len(rows)))

    def _write_paths(self, frames: Sequence[Frame]) -> None:
        for name, height, changes in (
            ("granted", 0.03, [(frame, frame.paths) for frame in frames if frame.paths is not None]),
            ("planned", 0.02, [(frame, frame.plans) for frame in frames if frame.plans is not None]),
        ):
            if changes:
                index = _index([frame.tick for frame, _ in changes], [frame.sim_s for frame, _ in changes])
                index.append(rr.TimeColumn("plan_epoch", sequence=[frame.plan_epoch for frame, _ in changes]))
                lines = [line for _, row in changes for line in row or ()]
                rows = offsets_of([len(row or ()) for _, row in changes])
                self._send(f"world/paths/{name}", index, [strips(lines, height, rows)])

    def _write_states(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            words = (frame.car_state, frame.arm_state, frame.task_state)
            if words == self._words:
                continue
            self._words = words
            named = itertools.chain(
                ((f"states/cars/car_{i}", state) for i, state in enumerate(frame.car_state)),
                ((f"states/arms/arm_{i}", state) for i, state in enumerate(frame.arm_state)),
                ((f"states/tasks/{task}", state) for task, state in frame.task_state.items()),
            )
            changed = [(path, state) for path, state in named if self._seen.get(path) != state]
            if changed:
                self._at(frame)
            for path, state in changed:
                self._seen[path] = state
                known = self._states.setdefault(path, set())
                if state not in known:
                    known.add(state)
                    self._configure(path, sorted(known))
                self._rec.log(path, rr.StateChange(state=state))

    def _write_views(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            if frame.views:
                self._at(frame)
            for name, image in frame.views.items():
                path = f"{VIEWS}/{name}"
                if name not in self._cameras:
                    self._cameras.add(name)
                    log_camera(self._rec, path, image.camera)
                log_image(self._rec, path, image)

    def _configure(self, path: str, states: Sequence[str]) -> None:
        """Give every state seen so far its colour: states without one may look alike."""
        colours = np.array([palette.state_colour(state) for state in states], np.uint32)
        self._rec.log(path, rr.StateConfiguration(values=states, labels=states, colors=colours), static=True)

    def _at(self, frame: Frame) -> None:
        self._rec.reset_time()
        self._rec.set_time("sim_time", duration=frame.sim_s)
        self._rec.set_time("tick", sequence=frame.tick)

    def _send(self, path: str, index: Iterable[rr.TimeColumn], columns: Iterable[Any]) -> None:
        self._rec.send_columns(path, indexes=index, columns=columns)


def _index(ticks: Sequence[int], times_s: Sequence[float]) -> list[rr.TimeColumn]:
    nanoseconds = np.rint(np.asarray(times_s) * 1e9).astype("timedelta64[ns]")
    return [rr.TimeColumn("sim_time", duration=nanoseconds), rr.TimeColumn("tick", sequence=np.asarray(ticks))]


def _markdown(title: str, about: Mapping[str, object]) -> str:
    rows = []
    for key, value in about.items():
        text = value if isinstance(value, str | int | float) else json.dumps(value, default=str)
        rows.append(f"| {key} | {text} |")
    return "\n".join([f"# {title}", "", "| | |", "|---|---|", *rows])
