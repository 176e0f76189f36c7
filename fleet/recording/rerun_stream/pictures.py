"""PictureRecorder: an episode that is seen as pictures, as a rerun file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fleet.recording.errors import OutputError, RecordingError


class PictureRecorder:
    """One open recording of pictures and figures.

    Args:
        path: File to write; its folder is made.
        name: What the recording is called.

    Raises:
        OutputError: The folder cannot be made.
        RecordingError: The file cannot be opened.
    """

    def __init__(self, path: Path, name: str) -> None:
        import rerun as rr

        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as reason:
            raise OutputError(f"folder {path.parent} cannot be made: {reason}") from reason
        self._rec = rr.RecordingStream("fleet")
        self._rec.set_log_time_enabled(False)
        try:
            self._rec.set_sinks(rr.FileSink(str(path)))
        except Exception as reason:  # rerun raises what its native part reports, of no common kind
            raise RecordingError(f"{path} cannot be opened: {reason}") from reason
        self._rec.send_recording_name(name)

    def show(self, picture: npt.NDArray[np.uint8], sim_s: float, figures: Mapping[str, float]) -> None:
        """Record one moment.

        Args:
            picture: Shape (height, width, 3).
            sim_s: Simulated time [s].
            figures: Drawn as curves, by name.
        """
        import rerun as rr

        self._rec.set_time("sim_time", duration=sim_s)
        self._rec.log("floor", rr.Image(picture).compress())
        for name, value in figures.items():
            self._rec.log(f"figures/{name}", rr.Scalars(value))

    def close(self) -> None:
        """Finish the file; calling twice is harmless."""
        self._rec.flush()
        self._rec.disconnect()
