"""Stream: turns batches of frames into rerun columns."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from fleet.recording.frame import Frame, LogLine
from fleet.recording.header import Header
from fleet.recording.index import epochs_of, index_of, set_time
from fleet.recording.rerun_stream import palette
from fleet.recording.rerun_stream.bodies import DrawnBodies
from fleet.recording.rerun_stream.columns import Chunks, offsets_of, strips, values
from fleet.recording.rerun_stream.coordination import Coordination
from fleet.recording.rerun_stream.lanes import StateLanes
from fleet.recording.rerun_stream.layout import layout
from fleet.recording.rerun_stream.scenery import log_scenery
from fleet.recording.rerun_stream.trees import write_trees
from fleet.recording.rerun_stream.views import VIEWS, EyeAtWork, log_camera, log_image

_FLUSH_TICK_S = 60.0
"""Period at which rerun would write to its sinks by itself [s]: every batch is flushed when it is complete."""
_OPEN_S, _CLOSE_S = 10.0, 60.0
"""Wall time that writing the scenery, and what is left at the end, may take [s]."""
_SERVER_MEMORY = "512MB"
"""What a viewer that joins late may still be sent; older frames are dropped, the scenery is kept."""


class Stream:
    """One open recording: a file, and on request a server on the loopback interface.

    Args:
        path: File to write.
        header: What is known before the first frame.
        port: Port of the live server; None = no server.
    """

    def __init__(self, path: Path, header: Header, port: int | None) -> None:
        scene, floor = header.scene, header.floor
        self._plots = {title: tuple(names) for title, names in header.plots.items()}
        self._opened: set[str] = set()
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
        blueprint = layout(
            scene, floor, tuple(self._plots), header.cameras, live=port is not None, internals=header.internals
        )
        self._rec.set_sinks(*sinks, default_blueprint=blueprint)
        self._rec.send_recording_name(f"{floor.name}, {len(scene.car_start)} cars")
        log_scenery(self._rec, scene, floor)
        self._rec.log(
            "about", rr.TextDocument(_markdown(floor.name, header.about), media_type="text/markdown"), static=True
        )
        self._chunks = Chunks(self._rec)
        self._bodies = DrawnBodies(self._rec, self._chunks, scene)
        self._eye = EyeAtWork(self._rec, scene)
        self._coordination = Coordination(self._rec, self._chunks, scene, floor)
        self._lanes = StateLanes(self._rec, self._chunks, len(scene.car_start) + len(scene.arm_base))
        for name in ("granted", "planned"):
            radius, alpha = (0.035, 230) if name == "granted" else (0.012, 150)
            self._rec.log(
                f"world/paths/{name}",
                rr.LineStrips3D.from_fields(
                    colors=palette.identity_colours(range(len(scene.car_start)), alpha=alpha), radii=radius
                ),
                static=True,
            )
        self._rec.flush(timeout_sec=_OPEN_S)

    def write(self, frames: Sequence[Frame], lines: Sequence[LogLine]) -> None:
        """Append frames and log lines, both ascending in time."""
        if frames:
            self._bodies.write(frames)
            self._eye.write(frames)
            self._coordination.write(frames)
            self._write_scalars(frames)
            self._write_paths(frames)
            self._lanes.write(frames)
            self._write_views(frames)
            write_trees(self._rec, frames)
        if lines:
            rows = offsets_of([1] * len(lines))
            text = values("TextLog:text", [line.text for line in lines], rows)
            level = values("TextLog:level", [line.level for line in lines], rows)
            self._chunks.add("log", index_of(lines), [text, level])
        self._chunks.send()
        # Begun, not waited for: threads of rerun's own compress and write.
        self._rec.flush(timeout_sec=0.0)

    def close(self) -> None:
        """Write what is pending and the footer."""
        self._rec.flush(timeout_sec=_CLOSE_S)
        self._rec.disconnect()

    def _write_scalars(self, frames: Sequence[Frame]) -> None:
        counted = [frame for frame in frames if frame.task_counts]
        if counted and not self._counts:
            self._counts = tuple(counted[0].task_counts)
            self._open_series("counts", self._counts, [palette.state_colour(name) for name in self._counts])
        self._send_series("counts", self._counts, counted, [frame.task_counts for frame in counted])
        measured = [frame for frame in frames if frame.metrics]
        if measured and not self._plots:
            self._plots = {"all": tuple(measured[0].metrics)}
        for title, names in self._plots.items():
            path = f"metrics/{title}"
            if path not in self._opened:
                self._opened.add(path)
                self._open_series(path, names, palette.identity_colours(range(len(names))).tolist())
            self._send_series(path, names, measured, [frame.metrics for frame in measured])

    def _open_series(self, path: str, names: Sequence[str], colours: Sequence[int]) -> None:
        style = rr.SeriesLines(
            names=list(names),
            colors=np.array(colours, np.uint32),
            widths=[1.5] * len(names),
            interpolation_mode="StepAfter",
        )
        self._rec.log(path, style, static=True)

    def _send_series(
        self, path: str, names: Sequence[str], frames: Sequence[Frame], rows: Sequence[Mapping[str, float]]
    ) -> None:
        if names and rows:
            figures = [row.get(name, math.nan) for row in rows for name in names]
            column = values("Scalars:scalars", figures, offsets_of([len(names)] * len(rows)))
            self._chunks.add(path, index_of(frames), [column])

    def _write_paths(self, frames: Sequence[Frame]) -> None:
        for name, height, changes in (
            ("granted", 0.03, [(frame, frame.paths) for frame in frames if frame.paths is not None]),
            ("planned", 0.02, [(frame, frame.plans) for frame in frames if frame.plans is not None]),
        ):
            if changes:
                frames_of = [frame for frame, _ in changes]
                index = [*index_of(frames_of), epochs_of([frame.plan_epoch for frame in frames_of])]
                lines = [line for _, row in changes for line in row or ()]
                rows = offsets_of([len(row or ()) for _, row in changes])
                xy = np.concatenate(lines) if lines else np.empty((0, 2))
                column = strips(xy, [len(line) for line in lines], height, rows)
                self._chunks.add(f"world/paths/{name}", index, [column])

    def _write_views(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            if frame.views:
                set_time(self._rec, frame)
            for name, image in frame.views.items():
                path = f"{VIEWS}/{name}"
                if name not in self._cameras:
                    self._cameras.add(name)
                    log_camera(self._rec, path, image.camera)
                log_image(self._rec, path, image)


def _markdown(title: str, about: Mapping[str, object]) -> str:
    rows = []
    for key, value in about.items():
        text = value if isinstance(value, str | int | float) else json.dumps(value, default=str)
        rows.append(f"| {key} | {text} |")
    return "\n".join([f"# {title}", "", "| | |", "|---|---|", *rows])
