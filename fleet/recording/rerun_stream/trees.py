"""Trees: what the searches behind the plans of arms have looked at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from fleet.recording.frame import Frame
from fleet.recording.index import set_time
from fleet.recording.rerun_stream import palette

TREES = "world/trees"
"""Parent of one entity for each arm."""
_RADIUS_M = 0.003


def write_trees(rec: rr.RecordingStream, frames: Sequence[Frame]) -> None:
    """Append the edges of new trees, as lines of the tool's tip; they stay until the arm's next plan."""
    for frame in frames:
        for arm, edges in frame.trees.items():
            set_time(rec, frame)
            colour = np.array([palette.TREE], np.uint32)
            rec.log(f"{TREES}/arm_{arm}", rr.LineStrips3D(list(edges), colors=colour, radii=_RADIUS_M))
