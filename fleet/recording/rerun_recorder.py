"""RerunRecorder: writes a rerun recording from a worker thread; the simulation only hands over frames."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from fleet.recording.cli import compact
from fleet.recording.errors import RecordingError
from fleet.recording.frame import FloorPlan, Frame, LogLine
from fleet.world.scene import Scene

if TYPE_CHECKING:
    from fleet.recording.stream import Stream

_BATCH_N = 240
"""Frames that wake the worker early; larger batches are cheaper per frame."""
_BATCH_S = 0.4
"""Wall time after which a smaller batch is written anyway [s]: what a killed process loses, and the time of writing."""
_QUEUE_N = 960
"""Frames that may wait; beyond it the simulation waits (file) or frames are dropped (live)."""
_COMPACT_N = 60
"""Batches from which on a finished recording is worth compacting, which takes as long as writing fifty of them."""
_JOIN_S = 60.0
"""Wall time that `close` gives the worker to write what is queued [s]."""


class RerunRecorder:
    """A `Recorder` that writes `path` and, with `serve`, also feeds viewers on the loopback interface.

    To a file nothing is lost: if the worker falls behind, `record` waits. While serving, frames are dropped and
    counted instead, so that a viewer never slows the run.

    Args:
        path: File to write; replaced if it exists.
        scene: Robots and boxes.
        floor: Lanes, stations, parking.
        about: Facts on the run for the reader: seed, settings, versions.
        tick_s: Length of a tick [s].
        rate_hz: Frames per simulated second at most; a slower tick records every tick.
        plots: Title -> names of the metrics drawn together; empty = all metrics in one plot.
        cameras: Names of the cameras whose views come with frames.
        internals: Whether frames come with what the planners think.
        serve: Host a live server on 127.0.0.1.
        port: Its port.

    Raises:
        RecordingError: The file cannot be opened, or the port is taken.
    """

    def __init__(
        self,
        *,
        path: Path,
        scene: Scene,
        floor: FloorPlan,
        about: Mapping[str, object],
        tick_s: float,
        rate_hz: float = 30.0,
        plots: Mapping[str, Sequence[str]] | None = None,
        cameras: Sequence[str] = (),
        internals: bool = False,
        serve: bool = False,
        port: int = 9876,
    ) -> None:
        # rerun takes a second to load and is needed by recorded runs only
        from fleet.recording.stream import Stream

        self._path = path
        self._every = max(1, round(1.0 / (rate_hz * tick_s)))
        self._live = serve
        self._frames: list[Frame] = []
        self._lines: list[LogLine] = []
        self._changed = threading.Condition()
        self._closing = False
        self._failure: Exception | None = None
        self._batches_n = 0
        self.dropped_n = 0
        """Frames that were dropped to keep a live run going."""
        self.written_n = 0
        """Frames written so far."""
        self.cpu_s = 0.0
        """CPU time of the worker thread so far [s]."""
        try:
            if serve:
                require_free_port(port)
            with path.open("wb"):
                pass
            self._stream: Stream = Stream(
                path=path,
                scene=scene,
                floor=floor,
                about=about,
                plots=plots or {},
                cameras=cameras,
                internals=internals,
                port=port if serve else None,
            )
        except (OSError, RuntimeError, ValueError) as error:
            raise RecordingError(f"recording {path} cannot be opened: {error}") from error
        self._worker = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._worker.start()

    @property
    def uri(self) -> str:
        """Address for ``rerun --connect``; empty when not serving."""
        return self._stream.uri

    def due(self, tick: int) -> bool:
        """True if a frame of this tick is wanted."""
        return tick % self._every == 0

    def record(self, frame: Frame) -> None:
        """Queue a frame; nobody else may change its arrays from now on."""
        with self._changed:
            if len(self._frames) >= _QUEUE_N and self._live:
                self.dropped_n += 1
                return
            while len(self._frames) >= _QUEUE_N and self._failure is None:
                self._changed.wait()
            self._frames.append(frame)
            if len(self._frames) == _BATCH_N:
                self._changed.notify_all()

    def log(self, line: LogLine) -> None:
        """Queue a line of the event log."""
        with self._changed:
            self._lines.append(line)

    def close(self) -> None:
        """Write what is queued and the footer, and compact the file.

        Raises:
            RecordingError: Writing failed at some time in the run, or does not come to an end.
        """
        with self._changed:
            if self._closing:
                return
            self._closing = True
            self._changed.notify_all()
        self._worker.join(_JOIN_S)
        if self._worker.is_alive():
            raise RecordingError(f"recording {self._path}: the writer did not finish within {_JOIN_S:.0f} s")
        if self._failure is not None:
            raise RecordingError(f"recording {self._path} is incomplete: {self._failure}") from self._failure
        if self._batches_n >= _COMPACT_N:
            compact(self._path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except RecordingError:
            # the error that ended the run matters more
            if error is None:
                raise

    def _work(self) -> None:
        closing = False
        while not closing:
            with self._changed:
                self._changed.wait_for(lambda: self._closing or len(self._frames) >= _BATCH_N, _BATCH_S)
                closing = self._closing
                frames, self._frames = self._frames, []
                lines, self._lines = self._lines, []
                self._changed.notify_all()
            if self._failure is None and (frames or lines):
                self._batches_n += 1
                self._attempt(partial(self._stream.write, frames, lines))
                self.written_n += len(frames) if self._failure is None else 0
        self._attempt(self._stream.close)

    def _attempt(self, write: Callable[[], None]) -> None:
        started = time.thread_time()
        try:
            write()
        except Exception as error:  # told by `close`: a broken recording must not end the run
            self._failure = self._failure or error
        self.cpu_s += time.thread_time() - started


def require_free_port(port: int) -> None:
    """Try the port of a live viewer: the server itself only logs that it could not listen.

    Raises:
        RecordingError: It is taken, or no port of this machine.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            raise RecordingError(f"port {port} for the live viewer: {error}; valid: a free port") from error
