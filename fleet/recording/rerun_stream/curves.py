"""Curves: figures over steps as a rerun recording of plots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from fleet.whole_file import draft_of


def write_curves(path: Path, title: str, rows: Sequence[Mapping[str, float]], *, step: str = "steps") -> None:
    """Write one plot per figure.

    Args:
        path: File to write; replaced if it exists.
        title: Name of the recording.
        rows: Figures by name, ascending in `step`; those that are not a number are left out.
        step: Name of what the plots run over.
    """
    names = [name for name in rows[0] if name != step]
    views = [rrb.TimeSeriesView(origin=f"/{name}", name=name) for name in names]
    with draft_of(path) as part:
        recording = rr.RecordingStream("fleet")
        recording.set_log_time_enabled(False)
        blueprint = rrb.Blueprint(rrb.Grid(*views), rrb.TimePanel(state="collapsed", timeline=step))
        recording.set_sinks(rr.FileSink(str(part)), default_blueprint=blueprint)
        recording.send_recording_name(title)
        for name in names:
            known = [(row[step], row[name]) for row in rows if not math.isnan(row[name])]
            if known:
                at, values = np.array(known).T
                index = rr.TimeColumn(step, sequence=at.astype(np.int64))
                recording.send_columns(name, indexes=[index], columns=rr.Scalars.columns(scalars=values))
        recording.flush(timeout_sec=10.0)
        recording.disconnect()
