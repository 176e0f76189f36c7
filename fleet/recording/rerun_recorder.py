"""RerunRecorder: collects the frames of a run and hands them to rerun in batches."""

from __future__ import annotations

import math
import socket
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from fleet.recording.errors import RecordingError
from fleet.recording.frame import Frame, LogLine
from fleet.recording.header import Header
from fleet.recording.output_file import require_room
from fleet.recording.rerun_cli import compact

if TYPE_CHECKING:
    from fleet.recording.rerun_stream.stream import Stream

_BATCH_FRAMES = 240
"""Frames that are written at once, whatever their age."""
_BATCH_S = 0.45
"""Wall time after which the oldest frame is written [s]: what a killed process loses, but for the time of writing."""
_QUEUE_FRAMES = 960
"""Frames that may wait while serving; more are dropped."""
_COMPACT_BATCHES = 100
"""Batches from which on a finished recording is worth compacting, which takes as long as writing thirty of them."""
_JOIN_S = 60.0
"""Wall time that `close` gives the other thread to finish its batch [s]."""


class RerunRecorder:
    """A `Recorder` that writes `path` and, with a `port`, also feeds viewers on the loopback interface.

    Batches are made in the thread of the run, because two threads that run Python take turns every 5 ms: what takes
    5 ms here would take a second beside it. Threads of rerun's own compress and write, and nobody waits for them. If
    the run takes so long for a tick that no frame comes, another thread writes what there is.

    That thread writes everything while serving, because rerun waits for a viewer that has stopped to read. Frames are
    dropped and counted then, so that a viewer never slows the run; to a file alone nothing is lost.

    Args:
        path: File to write; replaced if it exists.
        header: What is known before the first frame.
        tick_s: Length of a tick [s].
        rate_hz: Frames per simulated second at most; a slower tick records every tick.
        port: Port of a live server on 127.0.0.1; None = no server.

    Raises:
        OutputError: There is no room on the disk.
        RecordingError: The file cannot be opened, or the port is taken.
    """

    def __init__(
        self, path: Path, header: Header, *, tick_s: float, rate_hz: float = 30.0, port: int | None = None
    ) -> None:
        # rerun takes a second to load and is needed by recorded runs only
        from fleet.recording.rerun_stream.stream import Stream

        self._path = path
        self._every = max(1, round(1.0 / (rate_hz * tick_s)))
        self._live = port is not None
        self._frames: list[Frame] = []
        self._lines: list[LogLine] = []
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self._wake = threading.Event()
        self._closing = False
        self._failure: Exception | None = None
        self._due_s = math.inf
        self._seen_s = 0.0
        self._n_batches = 0
        self.n_dropped = 0
        """Frames that were dropped to keep a live run going."""
        self.n_written = 0
        """Frames written so far."""
        try:
            if port is not None:
                require_free_port(port)
            with path.open("wb"):
                pass
            self._stream: Stream = Stream(path, header, port)
        except (OSError, RuntimeError, ValueError) as error:
            if path.parent.is_dir():
                require_room(path.parent)  # else a full disk is told in rerun's words, without the cure
            raise RecordingError(f"recording {path} cannot be opened: {error}") from error
        self._watchdog = threading.Thread(target=self._write_late, name="recorder", daemon=True)
        self._watchdog.start()

    @property
    def uri(self) -> str:
        """Address for ``rerun --connect``; empty when not serving."""
        return self._stream.uri

    def due(self, tick: int) -> bool:
        """True if a frame of this tick is wanted."""
        return tick % self._every == 0

    def record(self, frame: Frame) -> None:
        """Take a frame; nobody else may change its arrays from now on."""
        now_s = time.perf_counter()
        with self._lock:
            if self._live and len(self._frames) >= _QUEUE_FRAMES:
                self.n_dropped += 1
                return
            self._frames.append(frame)
            self._due_s = min(self._due_s, now_s + _BATCH_S)
        # The next frame comes after as long a time as this one.
        due = 2.0 * now_s - self._seen_s >= self._due_s or len(self._frames) >= _BATCH_FRAMES
        self._seen_s = now_s
        if due and self._live:
            self._wake.set()
        elif due:
            self._write()

    def log(self, line: LogLine) -> None:
        """Take a line of the event log."""
        with self._lock:
            self._lines.append(line)
            self._due_s = min(self._due_s, time.perf_counter() + _BATCH_S)

    def close(self) -> None:
        """Write what is left and the footer, and compact the file.

        Raises:
            RecordingError: Writing failed at some time in the run, or does not come to an end.
        """
        if self._closing:
            return
        self._closing = True
        self._wake.set()
        self._watchdog.join(_JOIN_S)
        if self._watchdog.is_alive():
            raise RecordingError(f"recording {self._path}: the writer did not finish within {_JOIN_S:.0f} s")
        self._write()
        try:
            self._stream.close()
        except Exception as error:
            self._failure = self._failure or error
        if self._failure is not None:
            raise RecordingError(f"recording {self._path} is incomplete: {self._failure}") from self._failure
        if self._n_batches >= _COMPACT_BATCHES:
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

    def _write(self) -> None:
        """Write what there is; who comes second waits for who came first."""
        with self._writing:
            with self._lock:
                frames, lines = list(self._frames), list(self._lines)
                self._due_s = math.inf
            if self._failure is None and (frames or lines):
                self._n_batches += 1
                try:
                    require_room(self._path.parent)
                    self._stream.write(frames, lines)
                    self.n_written += len(frames)
                except Exception as error:  # told by `close`: a broken recording must not end the run
                    self._failure = error
            # Not earlier: an interrupt leaves them here, to be written once more. Better twice than in part.
            with self._lock:
                del self._frames[: len(frames)], self._lines[: len(lines)]

    def _write_late(self) -> None:
        """Write what is due and nobody else has written, until the end."""
        while not self._closing:
            woken = self._wake.wait(max(0.0, min(_BATCH_S, self._due_s - time.perf_counter())))
            self._wake.clear()
            if woken or time.perf_counter() >= self._due_s:
                self._write()


def require_rerun() -> None:
    """Load rerun, before a run has files.

    Raises:
        ModuleNotFoundError: It is not installed.
    """
    import rerun  # noqa: F401


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
            reason = getattr(error, "strerror", None) or error
            raise RecordingError(f"port {port} for the live viewer: {reason}; valid: a free port") from error
