"""ArmProcess: an arm planning process, seen from the one that started it."""

from __future__ import annotations

import contextlib
import pickle
import queue
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO, Any, cast

from fleet.errors import BrokenRunError

READY, FAILED, KEEP_TREES, BEAT, ENDED = 0, -1, -2, -3, -4
"""First words of messages that are no requests and no answers; those bear their ticket, which is > 0."""


class ArmWorkerError(BrokenRunError):
    """The arm planning process fails, and so do those that are started in its place."""


class ArmProcess:
    """One process of `fleet.stations.arms.worker.arm_worker`; nothing here waits for it longer than it is told to.

    Args:
        setup: The first message: what the process plans with.

    Raises:
        ArmWorkerError: The process cannot be started.
    """

    def __init__(self, setup: bytes) -> None:
        try:
            # A session of its own: Ctrl-C reaches this process only, which then ends the worker in order.
            self._process = subprocess.Popen(
                [sys.executable, "-m", "fleet.stations.arms.worker.arm_worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                cwd=Path(__file__).resolve().parents[3],
                start_new_session=True,
            )
        except OSError as error:
            raise ArmWorkerError(f"arm planning process cannot be started: {error.strerror or error}") from error
        self._said: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()
        self._to_say: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        # Messages are larger than a pipe: somebody has to write and to read while the simulation runs on, and whoever
        # writes to a process that hangs would wait for ever.
        self._threads = [
            threading.Thread(target=work, name=f"arm-{name}", daemon=True)
            for name, work in (("requests", self._write), ("answers", self._read))
        ]
        for thread in self._threads:
            thread.start()
        self.send(setup)

    @property
    def pid(self) -> int:
        """Its number in the system."""
        return self._process.pid

    def send(self, message: bytes) -> None:
        """Hand over a pickled message; one to a process that has ended is lost."""
        self._to_say.put(message)

    def hear(self, timeout_s: float) -> tuple[int, Any] | None:
        """The next message: its first word and its content.

        Args:
            timeout_s: Wall time after which to give up [s].

        Returns:
            None if there was none. `ENDED`, with the exit status, is the last one.
        """
        try:
            return self._said.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def end(self, patience_s: float) -> None:
        """End the process; calling twice is harmless.

        Args:
            patience_s: Wall time in which it may end by itself [s].
        """
        self._to_say.put(None)
        try:
            self._process.wait(timeout=patience_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for thread in self._threads:
            thread.join(timeout=2.0)

    def _write(self) -> None:
        with contextlib.suppress(OSError), cast("IO[bytes]", self._process.stdin) as pipe:
            while (message := self._to_say.get()) is not None:
                pipe.write(message)
                pipe.flush()

    def _read(self) -> None:
        # A process that is killed may leave half a message.
        with contextlib.suppress(EOFError, pickle.UnpicklingError), cast("IO[bytes]", self._process.stdout) as pipe:
            while True:
                self._said.put(pickle.load(pipe))
        self._said.put((ENDED, self._process.wait()))
