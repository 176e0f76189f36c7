"""EpisodePictures: a recording of pictures and figures for each episode."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:  # heavy, and most trainings record nothing
    from fleet.recording import PictureRecorder


class EpisodePictures:
    """Writes `episode_0000.rrd`, `episode_0001.rrd`, ...

    Args:
        folder: For the files; it is made.
        name: What the recordings are called.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._folder = folder
        self._name = name
        self._n_episodes = 0
        self._recorder: PictureRecorder | None = None

    def begin(self) -> PictureRecorder:
        """Begin the file of the next episode; returns what writes it.

        Raises:
            OutputError: The folder cannot be made.
            RecordingError: The file cannot be opened.
        """
        from fleet.recording import PictureRecorder

        self.close()
        self._recorder = PictureRecorder(self._folder / f"episode_{self._n_episodes:04}.rrd", self._name)
        self._n_episodes += 1
        return self._recorder

    def show(self, picture: npt.NDArray[np.uint8], sim_s: float, figures: Mapping[str, float]) -> None:
        """Record one moment, in a new file if the last one was closed; see `PictureRecorder.show`."""
        recorder = self._recorder or self.begin()
        recorder.show(picture, sim_s, figures)

    def close(self) -> None:
        """Finish the file; calling twice is harmless."""
        if self._recorder is not None:
            self._recorder.close()
            self._recorder = None
