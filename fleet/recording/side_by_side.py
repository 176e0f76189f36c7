"""SideBySide: two recordings in one, each below a root of its own, on the same time line."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader

from fleet.recording.check import repaired
from fleet.recording.errors import RecordingError
from fleet.recording.rerun_stream.coordination import CONGESTION
from fleet.recording.rerun_stream.scenery import CAMERA, PIXELS_PER_M
from fleet.recording.rerun_stream.views import EYE, VIEWS
from fleet.whole_file import draft_of

ROOTS = ("a", "b")
_MARGIN_M = 0.6


def write_side_by_side(
    recordings: Sequence[Path], path: Path, *, titles: Sequence[str], size_m: tuple[float, float]
) -> None:
    """Write both recordings into one, so that one time cursor moves through both.

    Args:
        recordings: Two of them.
        path: File to write; replaced if it exists.
        titles: What the two are called.
        size_m: Extent of the floor along x and y [m].

    Raises:
        RecordingError: One cannot be read, or the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab"):
            pass
    except OSError as error:
        raise RecordingError(f"--out {path}: {error.strerror or error}; valid: a file that can be written") from error
    if any(path.samefile(recording) for recording in recordings):
        raise RecordingError(f"--out {path}: a recording that is compared; valid: another file")
    with draft_of(path) as draft:
        rec = rr.RecordingStream("fleet")
        rec.set_log_time_enabled(False)
        rec.set_sinks(rr.FileSink(str(draft)), default_blueprint=_layout(titles, size_m))
        try:
            rec.send_recording_name(" | ".join(titles))
            for root, recording in zip(ROOTS, recordings, strict=True):
                _send(rec, root, recording)
            rec.flush(timeout_sec=60.0)
        finally:
            rec.disconnect()


def _send(rec: rr.RecordingStream, root: str, recording: Path) -> None:
    """Copy all data of a recording below a root; of one that a killed run left, what is whole."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a missing footer: what is there is copied
        try:
            chunks = list(RrdReader(recording).stream())
        except (OSError, RuntimeError, ValueError) as error:
            with repaired(recording) as copy:
                try:
                    chunks = list(RrdReader(copy).stream())
                except (OSError, RuntimeError, ValueError):
                    raise RecordingError(f"{recording} cannot be read as a recording: {error}") from error
                _send_chunks(rec, root, chunks)
        else:
            _send_chunks(rec, root, chunks)


def _send_chunks(rec: rr.RecordingStream, root: str, chunks: Iterable[Chunk]) -> None:
    for chunk in chunks:
        if not str(chunk.entity_path).startswith("/__"):
            rec.send_chunks(chunk.with_entity_path(f"/{root}{chunk.entity_path}"))


def _layout(titles: Sequence[str], size_m: tuple[float, float]) -> rrb.Blueprint:
    """Both floors from above, what their cars do, how many tasks are done and their logs, left and right."""
    width, depth = size_m
    columns = []
    for root, title in zip(ROOTS, titles, strict=True):
        name = root.upper()
        above = rrb.Spatial2DView(
            origin=f"/{root}/{CAMERA}",
            name=title,
            contents=[
                f"/{root}/world/**",
                *(f"- /{root}/{path}" for path in (EYE, f"{VIEWS}/**", f"{CONGESTION}/**")),
            ],
            visual_bounds=rrb.VisualBounds2D(
                x_range=(-_MARGIN_M * PIXELS_PER_M, (width + _MARGIN_M) * PIXELS_PER_M),
                y_range=(-_MARGIN_M * PIXELS_PER_M, (depth + _MARGIN_M) * PIXELS_PER_M),
            ),
        )
        states = rrb.Tabs(
            rrb.StateTimelineView(origin=f"/{root}/states", name=f"{name}: cars", contents=["$origin/cars/**"]),
            rrb.StateTimelineView(origin=f"/{root}/states", name=f"{name}: arms", contents=["$origin/arms/**"]),
        )
        told = rrb.Tabs(
            rrb.TimeSeriesView(
                origin=f"/{root}/counts", name=f"{name}: tasks", axis_x=rrb.TimeAxis(link="LinkToGlobal")
            ),
            rrb.TextLogView(
                origin=f"/{root}/log",
                name=f"{name}: log",
                columns=rrb.TextLogColumns(timeline_columns=["sim_time"], text_log_columns=["LogLevel", "Body"]),
            ),
        )
        columns.append(rrb.Vertical(above, states, told, row_shares=[5, 3, 2]))
    return rrb.Blueprint(
        rrb.Horizontal(*columns),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
        auto_views=False,
    )
