"""Hall: a warehouse that obeys by VDA 5050 and a master of ours, as the programs that users start."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.interop.table import REPOSITORY

MOST_S = 7200
"""Simulated time after which a run ends [s]. No wait goes by the wall clock: a slow machine is no fault."""

PATIENT = ("--patience", "3600")
"""Words for a master that waits for its vehicles."""


@dataclass(kw_only=True)
class Hall:
    """A warehouse that obeys."""

    process: subprocess.Popen[str]
    result: dict[str, Any] = field(default_factory=dict)
    """Of its run, when it has ended."""

    def runs(self) -> bool:
        """Whether its simulated time is not over."""
        return self.process.poll() is None


@contextmanager
def serving(url: str, folder: Path, *words: str) -> Iterator[Hall]:
    """A warehouse that obeys, for some simulated hours at most."""
    words = ("serve", "--vda5050", url, "--duration", str(MOST_S), "--out", str(folder), "--check", *words)
    program = [sys.executable, "-m", "fleet", *words]
    with subprocess.Popen(program, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True) as fleet:
        assert fleet.stdout is not None
        hall = Hall(process=fleet)
        try:
            assert "cars speak VDA 5050" in fleet.stdout.readline()
            yield hall
        finally:
            fleet.send_signal(signal.SIGINT)
            fleet.communicate()
    hall.result |= json.loads((folder / "result.json").read_text(encoding="utf-8"))


def driven(url: str, folder: Path, *words: str) -> dict[str, Any]:
    """Let our master drive vehicles until its orders are done; returns the result of its run."""
    words = ("drive", "--vda5050", url, "--duration", str(MOST_S), "--out", str(folder), *PATIENT, *words)
    program = [sys.executable, "-m", "fleet", *words]
    done = subprocess.run(program, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return result
